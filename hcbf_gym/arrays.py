"""Arrays by their content; shapes and units are in the docstrings of functions."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hcbf_gym import _core

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]
Field = NDArray[np.float32]
"""One number for each cell of a grid."""
Ranks = NDArray[np.int8]
"""One rank for each cell of a grid."""
Places = NDArray[np.int32]
"""Cells of a grid by their numbers."""
Record = np.record
"""One entry of a structured array, whose fields are its attributes, in compiled code, too."""
Records = NDArray[np.void]
"""Structured arrays, whose records have named fields."""

Info = dict[str, Any]
"""What an environment reports: numbers and arrays by their names, nested."""

Pair = tuple[float, float]


def record_type(name: str, **behind: int) -> np.dtype[np.void]:
    """Return the dtype of a struct of the core, whose header documents its fields.

    Args:
        name: in `_core.RECORDS`.
        behind: so many numbers each stand behind the struct, under these names.
    """
    struct = _core.RECORDS[name]
    end = struct["itemsize"]
    names, formats, offsets = (list(struct[key]) for key in ("names", "formats", "offsets"))
    for part, count in behind.items():
        names.append(part)
        formats.append(("f8", (count,)))
        offsets.append(end)
        end += 8 * count
    whole: Any = {"names": names, "formats": formats, "offsets": offsets, "itemsize": end}
    return np.dtype((np.record, np.dtype(whole)))


def attributes(array: Records) -> np.record:
    """Return the first record of an array as a view whose fields are its attributes."""
    record: np.record = array.view((np.record, array.dtype))[0]
    return record


def numbers_of(records: Records) -> Array:
    """Return N records as the rows (N, …) of numbers that the core takes; one memory."""
    return records.view(np.float64).reshape(len(records), -1)


def words_of(record: Records) -> Array:
    """Return the numbers of one record (1,) as the core takes it; one memory."""
    return record.view(np.float64)


def packed(fields: Iterable[object], dtype: DTypeLike) -> Array:
    """Return the numbers of one record with these fields."""
    return words_of(np.array([tuple(fields)], dtype=dtype))
