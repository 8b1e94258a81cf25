"""The samples of N plants: what a reader returned of each, in one record a plant.

A value that is malformed, too old or NaN is a *fault* of that plant, a `Reason` by its number. The
core (`state_check.hpp`) *accepts* a state where there is none.
"""

from types import EllipsisType
from typing import NamedTuple

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
"""What an `Estimate.fault` may be."""


class State(NamedTuple):
    """The states of N plants as they were given, and as they were accepted last."""

    x: Array  # (N, n) as the rows read it
    model: Array  # (N, n) the reduced-order model's own
    lag: Array  # (N, n) the body's minus the model's
    covariance: Array  # (N, n, n) of x
    accepted: Array  # (N, n) the last x that was accepted


class Samples:
    """The records of N plants, and their states.

    States of planar double integrators are in the records; those `apart` have their own arrays.

    Attributes:
        plants: (N,) `plants.PLANT`.
        words: (N, …) the numbers of which `plants` consists.
        states: of the plants.
        input: (N, n_u) which was applied last.
        time: (N,) of the states [s].
        steps: (N,) since the reset; they make the time where an estimate has none.
        has_parts: whether the latest sample held a model, a lag or a covariance besides x.
        wrong_age: why a state is of the wrong age, for plants of the reason AGE.
        origin: the position from which positions count.
        is_rebased: whether the latest sample moved it.
        fresh: (N,) the plants whose episode begins.
    """

    def __init__(self, plant: Plant, n_u: int, count: int, apart: bool):
        self.origin = Origin(plant.model)
        self._max_age = np.inf if plant.max_age is None else plant.max_age
        self._period = 0.0 if plant.period is None else float(plant.period)
        self._drives = plant.axle is not None
        # if the latest sample had a fault, parts besides x, an elapsed time, which the next resets
        self._faulty, self.has_parts, self._varies = False, False, False
        self.wrong_age, self.is_rebased = "", False
        self.fresh: Mask = np.ones(count, dtype=np.bool_)
        self.steps: Array = np.zeros(count)
        n = plant.model.n
        shapes = (n,), (n,), (n,), (n, n), (n,)
        own = State(*(np.zeros((count, *shape)) for shape in shapes)) if apart else None
        self._name_parts(np.zeros(count, dtype=plant_dtype(n_u)), own)
        self.forget(np.ones(count, dtype=np.bool_))

    def _name_parts(self, plants: Records, own: State | None) -> None:
        """Name parts of the records, which look into their memory, and of states of their own."""
        self.plants, self._own = plants, own
        self.words = arrays.numbers_of(plants)
        self.states = State(*(plants[name] for name in State._fields)) if own is None else own
        self.input: Array = plants["input"]
        self.time: Array = plants["time"]
        self._fault: NDArray[np.int64] = plants["fault"]
        self._has_model: NDArray[np.int64] = plants["has_model"]
        self._states, *self._parts = (_bare(array) for array in self.states[:4])
        self._times, self._headings = _bare(self.time), _bare(plants["heading"])

    @property
    def is_apart(self) -> bool:
        """Whether the states stand beside the records."""
        return self._own is not None

    @property
    def x(self) -> Array:
        """(N, n) the states."""
        return self.states.x

    def forget(self, mask: Mask) -> None:
        """Know nothing of the masked plants (N,)."""
        self.fresh |= mask
        if mask.all():
            self.origin.forget()
        self.plants[mask] = 0
        self.plants["elapsed"][mask] = self._period
        for array in self._own or ():
            array[mask] = 0.0

    def remembered(self) -> tuple[Records, list[Array]]:
        """Return copies of all that is known."""
        return self.plants.copy(), [array.copy() for array in self._own or ()]

    def restore(self, remembered: tuple[Records, list[Array]]) -> None:
        """Know what `remembered` returned."""
        plants, own = remembered
        self.plants[:] = plants
        for place, array in zip(self._own or (), own, strict=True):
            place[:] = array

    def __getstate__(self) -> dict[str, object]:
        """Return what a copy needs; it names the parts of its records."""
        views = "words", "states", "input", "time", "_fault", "_has_model", "_states", "_parts"
        views += "_times", "_headings"
        return {name: value for name, value in vars(self).items() if name not in views}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)
        self._name_parts(self.plants, self._own)

    def take(self, estimate: Estimate) -> None:
        """Note what is known of the plants, as their reader returned it."""
        if estimate.fault is not None or self._faulty:
            self._faulty = estimate.fault is not None
            self._fault[:] = self._alarms(estimate.fault) if self._faulty else 0
        noted = sound = self._note(self._states, estimate.x)
        if estimate.time is None:
            self.time[:] = self.steps * self._period
        elif not self._note(self._times, estimate.time):
            self.time[:] = -np.inf  # before any other
        if estimate.elapsed is not None or self._varies:
            self._varies = estimate.elapsed is not None
            sound &= self._take_elapsed(estimate.elapsed)
        has_parts = not (estimate.covariance is estimate.model is estimate.lag is None)
        if has_parts or self.has_parts:
            self.has_parts = has_parts
            sound &= self._take_parts(estimate)
        if self._drives:
            sound &= self._note(self._headings, estimate.heading)
        if not sound:
            self.blame(Reason.STATE)
        elif estimate.age is not None:
            self._check_age(estimate.age)
        origin = self.origin
        was_far = origin.is_far
        if noted and not origin.is_decided:
            good = (self._fault == 0) | (self._fault >= FIRST_ALARM)
            origin.decide(self.x[good])
        if origin.is_far:
            if noted:
                origin.shift(self.x)
            if estimate.model is not None:
                origin.shift(self.states.model)
        self.is_rebased = origin.is_far != was_far

    def _take_elapsed(self, elapsed: object) -> bool:
        """Note how long ago the samples before were [s]; return whether that is made of numbers."""
        since = self.plants["elapsed"]
        since[:] = self._period
        if elapsed is None:
            return True
        numbers = np.empty(len(since))
        if not self._note(_bare(numbers), elapsed):
            return False
        is_time = (numbers > 0.0) & (numbers <= LONGEST)
        since[is_time] = numbers[is_time]
        if not is_time.all():
            self.blame(Reason.STATE, ~is_time)
        return True

    def blame(self, reason: ArrayLike, mask: Mask | EllipsisType = ...) -> None:
        """Note why the masked plants are not accepted."""
        self._fault[mask] = reason
        self._faulty = True

    def doubt(self, reason: Reason, wrong_age: str = "") -> None:
        """Note why plants are not accepted that would be: an alarm does not hide it."""
        self.wrong_age = wrong_age or self.wrong_age
        fault = self.plants["fault"]
        self.blame(reason, (fault == 0) | (fault >= FIRST_ALARM))

    def _take_parts(self, estimate: Estimate) -> bool:
        """Note model, lag and covariance, and return whether they are made of numbers."""
        self._has_model[:] = estimate.model is not None
        sound = True
        given = estimate.model, estimate.lag, estimate.covariance
        for place, value in zip(self._parts, given, strict=True):
            if value is None:
                place[...] = 0.0
            elif not self._note(place, value):
                place[...] = 0.0
                sound = False
        return sound

    def _note(self, place: Array, value: object) -> bool:
        """Copy a value of N plants, or of one with or without a leading 1, to where it belongs."""
        if type(value) is np.ndarray and value.dtype is _FLOAT and value.shape == place.shape:
            place[...] = value
            return True
        if isinstance(value, float) and place.ndim == 0:
            place[...] = value
            return True
        shapes = (place.shape, (1, *place.shape)) if len(self.plants) == 1 else (place.shape,)
        if type(value) is not np.ndarray or value.dtype.char != "d":
            found = (numbers_of(value, shape) for shape in shapes)
            value = next((numbers for numbers in found if numbers is not None), None)
        if value is None or value.shape not in shapes:
            return False
        place[...] = value
        return True

    def _alarms(self, fault: object) -> ArrayLike:
        """Return the alarms (N,) that the plants raise themselves; what is none is a bad state."""
        alarms = np.zeros(len(self.plants))
        if not self._note(_bare(alarms), fault):
            return Reason.STATE
        return np.where(np.isin(alarms, KNOWN_FAULTS), alarms, Reason.STATE)

    def _check_age(self, age: object) -> None:
        """Note which states are older than the plant allows, ahead of it, or of no age at all."""
        ages = np.full(len(self.plants), np.nan)
        self._note(_bare(ages), age)
        wrong = ~clocks.is_accepted(ages, self._max_age)
        self.blame(Reason.AGE, wrong)
        known = ages[wrong & np.isfinite(ages)]
        self.wrong_age = ""
        if known.size:
            self.wrong_age = f"the state: {clocks.refusal(float(known[0]), self._max_age)}"


def _bare(numbers: Array) -> Array:
    """Return numbers of N plants (N, …), without the N where there is one plant: a view."""
    return numbers.squeeze(axis=0) if len(numbers) == 1 else numbers


def real_numbers(value: object, shape: tuple[int, ...]) -> Array | None:
    """Return `value` as a new float64 array if it is one of finite real numbers; else None."""
    numbers = numbers_of(value, shape)
    return None if numbers is None or not np.isfinite(numbers).all() else numbers


def numbers_of(value: object, shape: tuple[int, ...]) -> Array | None:
    """Return `value` as a new float64 array if it is a real one of that shape; else None.

    Half precision holds no state, and a masked entry is not a number. Some may be infinite or NaN.
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
