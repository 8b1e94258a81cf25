"""A plant's state as numbers; the core's `state_check.hpp` checks whether it is valid."""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.errors import holds_numbers
from hcbf_gym.models.plant import Reason

_FLOAT = np.dtype(np.float64)
KNOWN_FAULTS = (0, *(int(reason) for reason in Reason if reason.lasts))
"""What an `Estimate.fault` may be."""


class State(NamedTuple):
    """What is told of one plant, and the state that was believed last; of N with a leading axis.

    Attributes:
        x: (n,) as the rows read it.
        model: (n,) the reduced-order model's own.
        lag: (n,) the body's minus the model's.
        covariance: (n, n) of x.
        believed: (n,) the last that was.
    """

    x: Array
    model: Array
    lag: Array
    covariance: Array
    believed: Array


def real_numbers(value: object, shape: tuple[int, ...]) -> Array | None:
    """Return `value` as a new float64 array if it is one of finite real numbers; else None."""
    numbers = numbers_of(value, shape)
    return None if numbers is None or not np.isfinite(numbers).all() else numbers


def numbers_of(value: object, shape: tuple[int, ...]) -> Array | None:
    """Return `value` as a new float64 array if it is a real one of that shape; else None.

    Half precision holds no state, and what a mask hides is no number. Some of the numbers may be
    infinite or none.
    """
    if type(value) is np.ndarray and value.dtype is _FLOAT and value.shape == shape:
        return value.copy()
    try:
        if np.ma.is_masked(value):
            return None
        array = np.asarray(value)
    except Exception:  # whatever a foreign object raises when it is asked for its numbers
        return None
    if not holds_numbers(array.dtype) or array.shape != shape:
        return None
    with np.errstate(all="ignore"):
        return array.astype(np.float64)
