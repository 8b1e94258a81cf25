"""Arrays by what they hold; shapes and units stand in the docstrings of who takes them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]
Records = NDArray[Any]
"""Structured arrays, whose records have named fields."""

Pair = tuple[float, float]
