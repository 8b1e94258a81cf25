"""The latest samples of N plants, one record for each plant, which the compiled filter reads.

A reader returns an `Estimate`. A value of it that is malformed, too old or NaN is a *fault* of that
plant: the number of a `Reason`. The core (`state_check.hpp`) accepts a state that has no fault.
"""

from types import EllipsisType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hcbf_gym import arrays
from hcbf_gym._core import FIRST_ALARM, Reason
from hcbf_gym.arrays import Array, Mask, Records
from hcbf_gym.errors import holds_numbers
from hcbf_gym.filter.origin import Origin
from hcbf_gym.filter.plants import plant_dtype
from hcbf_gym.models import clocks
from hcbf_gym.models.constants import LONGEST
from hcbf_gym.models.plant import Estimate, Plant

_FLOAT = np.dtype(np.float64)
KNOWN_FAULTS = (0, *(int(reason) for reason in Reason if reason.lasts))
"""The numbers that an `Estimate.fault` may have: none, and the alarms of a plant's own."""


class State(NamedTuple):
    """The states of N plants in their latest samples, and those that were accepted last."""

    x: Array  # (N, n) as the rows read it
    model: Array  # (N, n) the reduced-order model's own
    lag: Array  # (N, n) the body's state minus the model's
    covariance: Array  # (N, n, n) of x
    accepted: Array  # (N, n) the last x that was accepted


class Snapshot(NamedTuple):
    """Copies of what a filter remembers of N plants."""

    plants: Records  # (N,)
    states: list[Array]  # the arrays of a `State` beside the records; none of planar plants
    step: Any = None  # of a `ModelRows`: what its compiled step remembers


class Samples:
    """The records of N plants, and their states.

    States of planar double integrators are in the records. Those of other models, which are of
    another size, are `apart`: in arrays of their own.

    Attributes:
        plants: (N,) records of the type `plants.PLANT`.
        words: (N, …) the numbers of which `plants` consists.
        states: of the plants, views of `plants` or the arrays of their own.
        input: (N, n_u) the input that was applied last.
        time: (N,) of the states [s].
        steps: (N,) counts the steps since the reset; times the period it is the time of an
            estimate without one.
        has_parts: whether the latest sample had a model's state, a lag or a covariance besides x.
        wrong_age: in words, why a state is too old or ahead of the clock.
        origin: the position from which positions count.
        is_rebased: whether the latest sample moved the origin.
        fresh: (N,) the plants whose episode begins.
    """

    def __init__(self, plant: Plant, n_u: int, count: int, apart: bool):
        self.origin = Origin(plant.model)
        self._max_age = np.inf if plant.max_age is None else plant.max_age
        self._period = 0.0 if plant.period is None else float(plant.period)
        self._drives = plant.axle is not None
        # whether the latest sample had faults, parts or elapsed times, which the next one resets
        self._has_faults, self.has_parts, self._has_elapsed = False, False, False
        self.wrong_age, self.is_rebased = "", False
        self.fresh: Mask = np.ones(count, dtype=np.bool_)
        self.steps: Array = np.zeros(count)
        n = plant.model.n
        shapes = (n,), (n,), (n,), (n, n), (n,)
        states = State(*(np.zeros((count, *shape)) for shape in shapes)) if apart else None
        self._set_views(np.zeros(count, dtype=plant_dtype(n_u)), states)
        self.forget(np.ones(count, dtype=np.bool_))

    def _set_views(self, plants: Records, apart: State | None) -> None:
        """Set records and states, and the attributes that are views of them."""
        self.plants, self._apart = plants, apart
        self.words = arrays.numbers_of(plants)
        self.states = State(*(plants[name] for name in State._fields)) if apart is None else apart
        self.input: Array = plants["input"]
        self.time: Array = plants["time"]
        self._fault: NDArray[np.int64] = plants["fault"]
        self._has_model: NDArray[np.int64] = plants["has_model"]
        self._x, *self._parts = (_of_one_or_many(array) for array in self.states[:4])
        self._times, self._headings = _of_one_or_many(self.time), _of_one_or_many(plants["heading"])

    @property
    def is_apart(self) -> bool:
        """Whether the states are in arrays of their own."""
        return self._apart is not None

    @property
    def x(self) -> Array:
        """(N, n) the states, as the rows read them."""
        return self.states.x

    @property
    def sound(self) -> Mask:
        """(N,) the plants whose sample has no fault, or an alarm alone."""
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
        """Return copies of the records and the states, for `restore`."""
        return Snapshot(self.plants.copy(), [array.copy() for array in self._apart or ()])

    def restore(self, snapshot: Snapshot) -> None:
        """Set the records and the states back to a snapshot."""
        self.plants[:] = snapshot.plants
        for array, before in zip(self._apart or (), snapshot.states, strict=True):
            array[:] = before

    def __getstate__(self) -> dict[str, object]:
        """Return the attributes for a copy, which sets its own views."""
        views = "words", "states", "input", "time", "_fault", "_has_model", "_x", "_parts"
        views += "_times", "_headings"
        return {name: value for name, value in vars(self).items() if name not in views}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)
        self._set_views(self.plants, self._apart)

    def take(self, estimate: Estimate) -> None:
        """Copy an estimate into the records, with the faults of its values."""
        if estimate.fault is not None or self._has_faults:
            self._has_faults = estimate.fault is not None
            self._fault[:] = self._alarms(estimate.fault) if self._has_faults else 0
        has_x = sound = self._copy(self._x, estimate.x)
        if estimate.time is None:
            self.time[:] = self.steps * self._period
        elif not self._copy(self._times, estimate.time):
            self.time[:] = -np.inf  # before any other, so that the core refuses it
        if estimate.elapsed is not None or self._has_elapsed:
            self._has_elapsed = estimate.elapsed is not None
            sound &= self._take_elapsed(estimate.elapsed)
        has_parts = not (estimate.covariance is estimate.model is estimate.lag is None)
        if has_parts or self.has_parts:
            self.has_parts = has_parts
            sound &= self._take_parts(estimate)
        if self._drives:
            sound &= self._copy(self._headings, estimate.heading)
        if not sound:
            self.set_fault(Reason.STATE)
        elif estimate.age is not None:
            self._check_age(estimate.age)
        self.is_rebased = False
        if self.origin.is_far or not self.origin.is_decided:
            self._rebase(has_x, estimate.model is not None)

    def _rebase(self, has_x: bool, has_model: bool) -> None:
        """Let the first valid states decide the origin, and count new positions from it."""
        origin, was_far = self.origin, self.origin.is_far
        if has_x and not origin.is_decided:
            origin.decide(self.x[self.sound])
        if origin.is_far and has_x:
            origin.shift(self.x)
        if origin.is_far and has_model:
            origin.shift(self.states.model)
        self.is_rebased = origin.is_far != was_far

    def set_fault(self, reason: ArrayLike, mask: Mask | EllipsisType = ...) -> None:
        """Set the reason why the samples of the masked plants (N,) are not accepted."""
        self._fault[mask] = reason
        self._has_faults = True

    def reject(self, reason: Reason, wrong_age: str = "") -> None:
        """Set a fault of all plants that have none; it takes the place of an alarm."""
        self.wrong_age = wrong_age or self.wrong_age
        self.set_fault(reason, self.sound)

    def _take_elapsed(self, elapsed: object) -> bool:
        """Copy the times since the samples before [s]; return whether they are numbers."""
        since = self.plants["elapsed"]
        since[:] = self._period
        if elapsed is None:
            return True
        numbers = np.empty(len(since))
        if not self._copy(_of_one_or_many(numbers), elapsed):
            return False
        is_time = (numbers > 0.0) & (numbers <= LONGEST)
        since[is_time] = numbers[is_time]
        if not is_time.all():
            self.set_fault(Reason.STATE, ~is_time)
        return True

    def _take_parts(self, estimate: Estimate) -> bool:
        """Copy the model's state, lag and covariance; return whether all are of numbers."""
        self._has_model[:] = estimate.model is not None
        sound = True
        given = estimate.model, estimate.lag, estimate.covariance
        for part, value in zip(self._parts, given, strict=True):
            if value is None:
                part[...] = 0.0
            elif not self._copy(part, value):
                part[...] = 0.0
                sound = False
        return sound

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
        shapes = (target.shape, (1, *target.shape)) if len(self.plants) == 1 else (target.shape,)
        if type(value) is not np.ndarray or value.dtype.char != "d":
            fits = (real_array(value, shape) for shape in shapes)
            value = next((numbers for numbers in fits if numbers is not None), None)
        if value is None or value.shape not in shapes:
            return False
        target[...] = value
        return True

    def _alarms(self, fault: object) -> ArrayLike:
        """Return (N,) the alarms that plants raise themselves; all other numbers are bad states."""
        alarms = np.zeros(len(self.plants))
        if not self._copy(_of_one_or_many(alarms), fault):
            return Reason.STATE
        return np.where(np.isin(alarms, KNOWN_FAULTS), alarms, Reason.STATE)

    def _check_age(self, age: object) -> None:
        """Set the fault of states that are too old, ahead of the clock, or of no valid age."""
        ages = np.full(len(self.plants), np.nan)
        self._copy(_of_one_or_many(ages), age)
        wrong = ~clocks.is_accepted(ages, self._max_age)
        self.set_fault(Reason.AGE, wrong)
        finite = ages[wrong & np.isfinite(ages)]
        self.wrong_age = ""
        if finite.size:
            self.wrong_age = f"the state: {clocks.refusal(float(finite[0]), self._max_age)}"


def _of_one_or_many(numbers: Array) -> Array:
    """Return a view of numbers (N, …), without the leading axis if N is 1."""
    return numbers.squeeze(axis=0) if len(numbers) == 1 else numbers


def real_numbers(value: object, shape: tuple[int, ...]) -> Array | None:
    """Return `value` as a new float64 array; None if it is not of that shape and finite."""
    numbers = real_array(value, shape)
    return None if numbers is None or not np.isfinite(numbers).all() else numbers


def real_array(value: object, shape: tuple[int, ...]) -> Array | None:
    """Return `value` as a new float64 array; None if it is not of that shape and of real numbers.

    Entries may be infinite or NaN. Arrays of half precision, which is too coarse for a state, and
    those with masked entries are refused.
    """
    if type(value) is np.ndarray and value.dtype is _FLOAT and value.shape == shape:
        return value.copy()
    try:
        if np.ma.is_masked(value):
            return None
        array = np.asarray(value)
    except Exception:  # a foreign object may raise anything
        return None
    if not holds_numbers(array.dtype) or array.shape != shape:
        return None
    with np.errstate(all="ignore"):
        return array.astype(np.float64)
