"""Which ages of data are accepted, the present minus their stamp on one clock.

Two clocks never agree, so that a stamp may be ahead by `AHEAD`.
"""

import math
from typing import Any

import numpy as np

AHEAD = 0.1
"""By which a stamp may be ahead of the clock [s]."""
SEEN_FOR = 60.0
"""What was seen longer ago, or on another clock, is not accepted [s]."""
ROUNDING = 1e-9
"""Of an age [s]."""


def is_accepted(age: Any, oldest: float, ahead: float = AHEAD) -> Any:
    """Return whether data of an age, or of an array of ages, are accepted.

    Args:
        age: [s]; NaN or infinite where there is none.
        oldest: the greatest age that is accepted [s].
        ahead: by which a stamp may be ahead [s].
    """
    return np.isfinite(age) & (age >= -ahead - ROUNDING) & (age <= oldest + ROUNDING)


def refusal(age: float, oldest: float, ahead: float = AHEAD) -> str:
    """Return in words why an age is not accepted (`is_accepted`); "" where there is no age."""
    if not math.isfinite(age):
        return ""
    if age < 0.0:
        return f"stamp {-age:.2f} s ahead of the clock, at most {ahead:g} s allowed"
    return f"{age:.2f} s old, at most {oldest:g} s allowed"
