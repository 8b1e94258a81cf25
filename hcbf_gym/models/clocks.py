"""Which ages of data are accepted: one law for filters, scans and the ROS node.

The age of data is the present minus their stamp, on one clock. Two clocks are never one, so that
a stamp may be ahead by `AHEAD`.
"""

import math
from typing import Any

import numpy as np

AHEAD = 0.1
"""By which a stamp may be ahead of the clock [s]."""
SEEN_FOR = 60.0
"""What was seen longer ago, or on another clock, is not accepted [s]."""
ROUNDING = 1e-9
"""By how much an age may seem to be another one [s]."""


def is_accepted(age: Any, oldest: float, ahead: float = AHEAD) -> Any:
    """Return whether data of an age, or of an array of ages, are accepted.

    Args:
        age: [s]; NaN or infinite where there is none.
        oldest: the greatest age that is accepted [s].
        ahead: by which a stamp may be ahead [s].
    """
    return np.isfinite(age) & (age >= -ahead - ROUNDING) & (age <= oldest + ROUNDING)


def says(age: float, oldest: float, ahead: float = AHEAD) -> str:
    """Return in words why an age is not accepted (`is_accepted`); "" where there is none."""
    if not math.isfinite(age):
        return ""
    if age < 0.0:
        return f"stamp {-age:.2f} s ahead of the clock, at most {ahead:g} s allowed"
    return f"{age:.2f} s old, at most {oldest:g} s allowed"
