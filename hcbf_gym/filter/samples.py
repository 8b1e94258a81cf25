"""The latest samples of N plants, one record for each plant, which the compiled filter reads.

A plant's reader returns an `Estimate` at every step. A malformed or too old value is a *fault* of
the plant: its record gets the number of a `Reason`. The core (`state_check.hpp`) accepts the states
of plants without a fault.
"""

from types import EllipsisType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hcbf_gym import arrays
from hcbf_gym._core import FIRST_ALARM, Reason
from hcbf_gym.arrays import Array, Mask, Records
from hcbf_gym.errors import reals
from hcbf_gym.filter.origin import Origin
from hcbf_gym.filter.plants import plant_dtype
from hcbf_gym.models import clocks
from hcbf_gym.models.constants import LONGEST
from hcbf_gym.models.plant import Estimate, Plant

_FLOAT = np.dtype(np.float64)
KNOWN_FAULTS = (0, *(int(reason) for reason in Reason if reason.lasts))
"""The numbers that `Estimate.fault` may have: 0, and the alarms that last until a reset."""


class States(NamedTuple):
    """The states of N plants in their latest samples, and the states that were accepted last."""

    x: Array  # (N, n) as the rows read it
    model: Array  # (N, n) the reduced-order model's own
    lag: Array  # (N, n) the body's state minus the model's
    covariance: Array  # (N, n, n) of x
    accepted: Array  # (N, n) the last x that was accepted


class Snapshot(NamedTuple):
    """A copy of a filter's memory of N plants, by which a step is undone."""

    plants: Records  # (N,)
    states: list[Array]  # the `States` that are not in the records; empty for planar plants
    model_step: Any = None  # the memory of the compiled step of a `ModelRows`


class WrongAge(NamedTuple):
    """The age of a state or of a scan that is not accepted."""

    source: str  # "the state", or the scan with its name
    age: float  # the present minus its stamp [s]; negative if the stamp is ahead of the clock
    oldest: float  # the greatest age that is accepted [s]


class Samples:
    """The records of N plants, and their states.

    States of planar double integrators are in the records. States of other models, which have
    another size, are `apart`: in arrays of their own.

    Attributes:
        plants: (N,) the records, of the type `plants.plant_dtype`.
        words: (N, …) a view of `plants` as numbers, for the core.
        states: the states, views of `plants` or the arrays of their own.
        input: (N, n_u) the inputs that were applied last, a view of `plants`.
        time: (N,) the times of the states [s], a view of `plants`.
        steps: (N,) the steps since the reset, which count the time of an estimate without one.
        is_uncertain: whether the latest sample has a model's state, a lag or a covariance.
        wrong_age: the latest age that was not accepted; None if it is not finite.
        origin: the place from which positions count.
        is_rebased: whether the latest sample moved the origin.
        fresh: (N,) the plants whose episode begins.
    """

    def __init__(self, plant: Plant, n_u: int, count: int, apart: bool):
        self.origin = Origin(plant.model)
        self._max_age = np.inf if plant.max_age is None else plant.max_age
        self._period = 0.0 if plant.period is None else float(plant.period)
        self._drives = plant.axle is not None
        # whether the latest sample had such values, which the next one has to clear
        self._has_faults, self.is_uncertain, self._has_elapsed = False, False, False
        self.wrong_age: WrongAge | None = None
        self.is_rebased = False
        self.fresh: Mask = np.ones(count, dtype=np.bool_)
        self.steps: Array = np.zeros(count)
        n = plant.model.n
        shapes = (n,), (n,), (n,), (n, n), (n,)
        states = States(*(np.zeros((count, *shape)) for shape in shapes)) if apart else None
        self._set_views(np.zeros(count, dtype=plant_dtype(n_u)), states)
        self.forget(np.ones(count, dtype=np.bool_))

    def _set_views(self, plants: Records, apart: States | None) -> None:
        """Set the records and the states apart, and the attributes that are views of them."""
        self.plants, self._apart = plants, apart
        self.words = arrays.numbers_of(plants)
        self.states = apart or States(*(plants[name] for name in States._fields))
        self.input: Array = plants["input"]
        self.time: Array = plants["time"]
        self._fault: NDArray[np.int64] = plants["fault"]
        self._has_model: NDArray[np.int64] = plants["has_model"]
        # an estimate is copied into these views, which have no leading axis if N is 1
        x, model, lag, covariance, _ = (_without_axis_of_one(array) for array in self.states)
        self._x_view, self._uncertain_views = x, (model, lag, covariance)
        self._time_view = _without_axis_of_one(self.time)
        self._heading_view = _without_axis_of_one(plants["heading"])

    @property
    def is_apart(self) -> bool:
        """Whether the states are in arrays of their own."""
        return self._apart is not None

    @property
    def x(self) -> Array:
        """(N, n) the states, as the rows read them."""
        return self.states.x

    @property
    def is_sound(self) -> Mask:
        """(N,) whether the sample of a plant has no fault, or no other fault than an alarm."""
        return (self._fault == 0) | (self._fault >= FIRST_ALARM)

    def forget(self, mask: Mask) -> None:
        """Clear the records and the states of the masked plants (N,)."""
        self.fresh |= mask
        if mask.all():
            self.origin.forget()
        self.plants[mask] = 0
        self.plants["elapsed"][mask] = self._period
        for array in self._apart or ():
            array[mask] = 0.0

    def snapshot(self) -> Snapshot:
        """Return a copy of the records and the states, for `restore`."""
        return Snapshot(self.plants.copy(), [array.copy() for array in self._apart or ()])

    def restore(self, snapshot: Snapshot) -> None:
        """Set the records and the states back to a snapshot."""
        self.plants[:] = snapshot.plants
        for array, before in zip(self._apart or (), snapshot.states, strict=True):
            array[:] = before

    def __getstate__(self) -> dict[str, object]:
        """Return the attributes for a copy, which sets its own views."""
        views = "words", "states", "input", "time", "_fault", "_has_model"
        views += "_x_view", "_uncertain_views", "_time_view", "_heading_view"
        return {name: value for name, value in vars(self).items() if name not in views}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)
        self._set_views(self.plants, self._apart)

    def take(self, estimate: Estimate) -> None:
        """Copy an estimate into the records, with the faults of its values."""
        if estimate.fault is not None or self._has_faults:
            self._has_faults = estimate.fault is not None
            self._fault[:] = self._alarms(estimate.fault) if self._has_faults else 0
        has_x = is_valid = self._copy(self._x_view, estimate.x)
        if estimate.time is None:
            self.time[:] = self.steps * self._period
        elif not self._copy(self._time_view, estimate.time):
            self.time[:] = -np.inf  # before any other time, so that the core refuses it
        if estimate.elapsed is not None or self._has_elapsed:
            self._has_elapsed = estimate.elapsed is not None
            is_valid &= self._take_elapsed(estimate.elapsed)
        has_model, has_lag = estimate.model is not None, estimate.lag is not None
        is_uncertain = has_model or has_lag or estimate.covariance is not None
        if is_uncertain or self.is_uncertain:
            self.is_uncertain = is_uncertain
            is_valid &= self._take_uncertain(estimate)
        if self._drives:
            is_valid &= self._copy(self._heading_view, estimate.heading)
        if not is_valid:
            self.set_fault(Reason.STATE)
        elif estimate.age is not None:
            self._check_age(estimate.age)
        self.is_rebased = False
        if self.origin.is_far or not self.origin.is_decided:
            self._rebase(has_x, has_model)

    def _rebase(self, has_x: bool, has_model: bool) -> None:
        """Let the first valid states decide the origin, and count new positions from it."""
        origin, was_far = self.origin, self.origin.is_far
        if has_x and not origin.is_decided:
            origin.decide(self.x[self.is_sound])
        if origin.is_far and has_x:
            origin.shift(self.x)
        if origin.is_far and has_model:
            origin.shift(self.states.model)
        self.is_rebased = origin.is_far != was_far

    def set_fault(self, reason: ArrayLike, mask: Mask | EllipsisType = ...) -> None:
        """Set why the samples of the masked plants (N,), or of all, are not accepted."""
        self._fault[mask] = reason
        self._has_faults = True

    def reject(self, reason: Reason) -> None:
        """Set a fault of all plants that have none; it takes the place of an alarm."""
        self.set_fault(reason, self.is_sound)

    def _take_elapsed(self, elapsed: object) -> bool:
        """Copy the times since the samples before [s]; return whether they are numbers."""
        target = self.plants["elapsed"]
        target[:] = self._period
        if elapsed is None:
            return True
        numbers = np.empty(len(target))
        if not self._copy(_without_axis_of_one(numbers), elapsed):
            return False
        is_time = (numbers > 0.0) & (numbers <= LONGEST)
        target[is_time] = numbers[is_time]
        if not is_time.all():
            self.set_fault(Reason.STATE, ~is_time)
        return True

    def _take_uncertain(self, estimate: Estimate) -> bool:
        """Copy the model's state, the lag and the covariance; return whether they are numbers."""
        self._has_model[:] = estimate.model is not None
        is_valid = True
        values = estimate.model, estimate.lag, estimate.covariance
        for target, value in zip(self._uncertain_views, values, strict=True):
            if value is None:
                target[...] = 0.0
            elif not self._copy(target, value):
                target[...] = 0.0
                is_valid = False
        return is_valid

    def _copy(self, target: Array, value: object) -> bool:
        """Copy a value into its array; return False, and copy nothing, if it is malformed.

        The value of one plant may have a leading axis of length 1, or none.
        """
        if type(value) is np.ndarray and value.dtype is _FLOAT and value.shape == target.shape:
            target[...] = value
            return True
        if isinstance(value, float) and target.ndim == 0:
            target[...] = value
            return True
        shapes = [target.shape]
        if len(self.plants) == 1:
            shapes.append((1, *target.shape))
        if type(value) is not np.ndarray or value.dtype.char != "d":
            converted = (real_array(value, shape) for shape in shapes)
            value = next((numbers for numbers in converted if numbers is not None), None)
        if value is None or value.shape not in shapes:
            return False
        target[...] = value
        return True

    def _alarms(self, fault: object) -> ArrayLike:
        """Return (N,) the alarms that plants raise themselves; any other number is `STATE`."""
        alarms = np.zeros(len(self.plants))
        if not self._copy(_without_axis_of_one(alarms), fault):
            return Reason.STATE
        return np.where(np.isin(alarms, KNOWN_FAULTS), alarms, Reason.STATE)

    def _check_age(self, age: object) -> None:
        """Set the fault of states that are too old, ahead of the clock, or of no valid age."""
        ages = np.full(len(self.plants), np.nan)
        self._copy(_without_axis_of_one(ages), age)
        is_wrong = ~clocks.is_accepted(ages, self._max_age)
        self.set_fault(Reason.AGE, is_wrong)
        finite_ages = ages[is_wrong & np.isfinite(ages)]
        self.wrong_age = None
        if finite_ages.size:
            self.wrong_age = WrongAge("the state", float(finite_ages[0]), self._max_age)


def _without_axis_of_one(numbers: Array) -> Array:
    """Return a view of numbers (N, …), without the leading axis if N is 1."""
    return numbers.squeeze(axis=0) if len(numbers) == 1 else numbers


def real_numbers(value: object, shape: tuple[int, ...]) -> Array | None:
    """Return `value` as a new float64 array; None if it has another shape or is not finite."""
    numbers = real_array(value, shape)
    return None if numbers is None or not np.isfinite(numbers).all() else numbers


def real_array(value: object, shape: tuple[int, ...]) -> Array | None:
    """Return `value` as a new float64 array; None if it has another shape or no real numbers.

    Entries may be infinite or NaN. Arrays with masked entries are refused, and arrays of half
    precision, which is too coarse for a state.
    """
    if type(value) is np.ndarray and value.dtype is _FLOAT and value.shape == shape:
        return value.copy()
    try:
        with np.errstate(all="ignore"):
            array = reals("value", value)
    except Exception:  # no real numbers, or a foreign object that raises anything
        return None
    return array if array.shape == shape else None
