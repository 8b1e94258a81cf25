"""What a filter believes of the estimate that it is handed, or why it believes nothing."""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from hcbf_gym.arrays import Array
from hcbf_gym.models.constants import FARTHEST
from hcbf_gym.models.plant import FIRST_ALARM, Estimate, Reason

_FLOAT = np.dtype(np.float64)
_ROUNDING = 1e-6
"""Of a covariance: how far its correlations may be from those of one."""
KNOWN_FAULTS = (0, *(int(reason) for reason in Reason if reason >= FIRST_ALARM))
"""What an `Estimate.fault` may be."""


class Belief(NamedTuple):
    """An `Estimate` whose every entry is made of finite numbers of the right shape.

    Attributes:
        x: (n,) state.
        time: [s]; None where the filter counts.
        covariance: (n, n) of x; None where x is the truth.
        model: (n,) the reduced-order model's own state; x where there is no other.
        lag: (n,) the body's state minus the model's; None where they are one.
    """

    x: Array
    time: float | None
    covariance: Array | None
    model: Array
    lag: Array | None

    @property
    def body(self) -> Array:
        """(n,) the body's own state: rows may read its position with the model's velocity."""
        return self.x if self.lag is None else self.model + self.lag


def examine(estimate: Estimate, n: int, last_time: float, max_age: float | None) -> Belief | Reason:
    """Return what can be believed of an estimate, or why nothing can.

    Args:
        estimate: whatever a plant's reader returned.
        n: the number of states.
        last_time: of the estimate that was believed before; −∞ where there was none [s].
        max_age: the greatest age that is believed; None for any [s].
    """
    x = _of_one(estimate.x, (n,))
    if x is None or not are_near(x):
        return Reason.STATE
    model, lag, covariance = x, None, None
    if estimate.model is not None:
        model = _of_one(estimate.model, (n,))
    if estimate.lag is not None:
        lag = _of_one(estimate.lag, (n,))
    if model is None or not are_near(model):
        return Reason.STATE
    if estimate.lag is not None and (lag is None or not are_near(lag)):
        return Reason.STATE
    if estimate.covariance is not None:
        covariance = _of_one(estimate.covariance, (n, n))
        if covariance is None or not is_covariance(covariance):
            return Reason.STATE
    if estimate.age is not None:
        age = real_number(estimate.age)
        if age is None or age < 0.0 or (max_age is not None and age > max_age):
            return Reason.AGE
    elapsed = None if estimate.elapsed is None else real_number(estimate.elapsed)
    if estimate.elapsed is not None and (elapsed is None or elapsed <= 0.0):
        return Reason.STATE
    time = None if estimate.time is None else real_number(estimate.time)
    if estimate.time is not None and (time is None or time <= last_time):
        return Reason.CLOCK
    return Belief(x, time, covariance, model, lag)


def _of_one(value: Any, shape: tuple[int, ...]) -> Array | None:
    """Return numbers of one plant, given with or without a leading 1; None if they are none."""
    numbers = real_numbers(value, shape)
    if numbers is None:
        numbers = real_numbers(value, (1, *shape))
    return None if numbers is None else numbers.reshape(shape)


def alarm_of(estimate: Estimate) -> Reason | None:
    """Return the alarm that a plant raises by itself, NONE for none; None if it is no such code."""
    if estimate.fault is None:
        return Reason.NONE
    fault = real_number(estimate.fault)
    return None if fault is None or fault not in KNOWN_FAULTS else Reason(int(fault))


def real_numbers(value: Any, shape: tuple[int, ...]) -> Array | None:
    """Return `value` as a new float64 array if it is one of finite real numbers; else None.

    What a mask hides is no number.
    """
    if type(value) is np.ndarray and value.dtype is _FLOAT and value.shape == shape:
        return value.copy() if np.isfinite(value).all() else None
    try:
        if np.ma.is_masked(value):
            return None
        array = np.asarray(value)
    except Exception:  # whatever a foreign object raises when it is asked for its numbers
        return None
    if array.dtype.kind not in "fiu" or array.shape != shape:
        return None
    with np.errstate(all="ignore"):
        numbers = array.astype(np.float64)
    return numbers if np.isfinite(numbers).all() else None


def real_number(value: Any) -> float | None:
    """Return `value` as a float if it is one finite real number, or an array of one; else None."""
    if type(value) is float:
        return value if math.isfinite(value) else None
    number = real_numbers(value, ())
    number = real_numbers(value, (1,)) if number is None else number
    return None if number is None else float(number.item())


@njit(cache=True, error_model="numpy")
def are_near(values: Array) -> bool:
    """Return whether no entry is beyond `FARTHEST`; of what is not finite that is false, too."""
    near = True
    for value in values:
        near &= abs(value) <= FARTHEST
    return near


@njit(cache=True, error_model="numpy")
def is_covariance(matrix: Array) -> bool:
    """Return whether a matrix (n, n) is symmetric without negative eigenvalues, up to rounding.

    It is zero, or the correlations that are left of it have a Cholesky factor.
    """
    n = matrix.shape[0]
    zero = True
    for j in range(n):
        if not (matrix[j, j] >= 0.0 and np.isfinite(matrix[j, j])):
            return False
        for k in range(n):
            zero &= matrix[j, k] == 0.0
    if zero:  # the truth
        return True
    rest = np.empty((n, n))
    for j in range(n):
        for k in range(n):
            size = np.sqrt(matrix[j, j]) * np.sqrt(matrix[k, k])
            if not abs(matrix[j, k]) <= (1.0 + _ROUNDING) * size:
                return False
            if not abs(matrix[j, k] - matrix[k, j]) <= _ROUNDING * size:
                return False
            rest[j, k] = matrix[j, k] / size if size > 0.0 else 0.0
    for j in range(n):
        pivot = rest[j, j]
        if pivot < -_ROUNDING * n:
            return False
        for k in range(j + 1, n):
            if pivot <= _ROUNDING * n:
                if abs(rest[k, j]) > np.sqrt(_ROUNDING) * n:
                    return False
                continue
            factor = rest[k, j] / pivot
            for i in range(j + 1, n):
                rest[k, i] -= factor * rest[j, i]
    return True
