"""Types of arrays, and structured arrays whose memory the C++ core shares."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hcbf_gym import _core

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]
Field = NDArray[np.float32]
"""A number for each cell of a grid."""
Ranks = NDArray[np.int8]
"""A rank for each cell of a grid."""
Places = NDArray[np.int32]
"""Indices of cells of a grid."""
Record = np.record
"""A record of a structured array, whose fields are its attributes."""
Records = NDArray[np.void]
"""A structured array, whose records have named fields."""

Info = dict[str, Any]
"""The info of an environment's step: numbers and arrays by name, nested."""

Pair = tuple[float, float]


def record_type(name: str, **appended: int) -> np.dtype[np.void]:
    """Return the dtype of a struct of the core, whose C++ header documents the fields.

    Args:
        name: the struct's name in `_core.RECORDS`.
        appended: name → size of arrays of floats that follow the struct in memory.
    """
    struct = _core.RECORDS[name]
    end = struct["itemsize"]
    names, formats, offsets = (list(struct[key]) for key in ("names", "formats", "offsets"))
    for field, size in appended.items():
        names.append(field)
        formats.append(("f8", (size,)))
        offsets.append(end)
        end += 8 * size  # bytes of its floats
    layout: Any = {"names": names, "formats": formats, "offsets": offsets, "itemsize": end}
    return np.dtype((np.record, np.dtype(layout)))


def attributes(array: Records) -> np.record:
    """Return a view of an array's first record, whose fields are attributes."""
    record: np.record = array.view((np.record, array.dtype))[0]
    return record


def numbers_of(records: Records) -> Array:
    """Return a view of N records as rows (N, …) of numbers, which the core takes."""
    return records.view(np.float64).reshape(len(records), -1)


def words_of(record: Records) -> Array:
    """Return a view of the numbers of one record (1,), which the core takes."""
    return record.view(np.float64)


def packed(fields: Iterable[object], dtype: DTypeLike) -> Array:
    """Return the numbers of a new record that has these fields."""
    return words_of(np.array([tuple(fields)], dtype=dtype))
