"""Arrays by what they hold; shapes and units stand in the docstrings of who takes them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

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


def numbers_of(records: Records) -> Array:
    """Return N records as the rows (N, …) of numbers that the core takes; one memory."""
    return records.view(np.float64).reshape(len(records), -1)
