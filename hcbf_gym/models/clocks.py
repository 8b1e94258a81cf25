"""The ages of data that are accepted: an age is the present minus the stamp of the data.

Clocks of two computers differ, so a stamp may be ahead of the present by `AHEAD`.
"""

import math
from typing import Any

import numpy as np

AHEAD = 0.1
"""The greatest time by which a stamp may be ahead of the clock [s]."""
SEEN_FOR = 60.0
"""The greatest age of a scan that is accepted [s]; a greater one is of another clock."""
ROUNDING = 1e-9
"""The error of an age by rounding [s]."""


def is_accepted(age: Any, oldest: float, ahead: float = AHEAD) -> Any:
    """Return whether data of an age, or of an array of ages, are accepted.

    Args:
        age: the age, or an array of ages [s]; NaN or infinite where there are no data.
        oldest: the greatest age that is accepted [s].
        ahead: the greatest time by which a stamp may be ahead [s].
    """
    return np.isfinite(age) & (age >= -ahead - ROUNDING) & (age <= oldest + ROUNDING)


def refusal(age: float, oldest: float, ahead: float = AHEAD) -> str:
    """Return in words why `is_accepted` refused an age; "" if it is NaN or infinite: no data."""
    if not math.isfinite(age):
        return ""
    if age < 0.0:
        return f"stamp {-age:.2f} s ahead of the clock, at most {ahead:g} s allowed"
    return f"{age:.2f} s old, at most {oldest:g} s allowed"
