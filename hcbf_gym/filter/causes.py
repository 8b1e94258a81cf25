"""Finds in words why a filter brakes: which of its inputs is wrong, and where."""

import numpy as np

from hcbf_gym import _core
from hcbf_gym._core import FIRST_ALARM, Reason
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.barrier import Barrier, checked
from hcbf_gym.barriers.kinks import SMOOTH
from hcbf_gym.barriers.many import Shapes
from hcbf_gym.errors import InvalidInputError, SafetyWarning, in_words, shown, warn_caller
from hcbf_gym.filter.guide import Guide
from hcbf_gym.filter.row_maker import RowMaker
from hcbf_gym.filter.samples import Samples, real_array
from hcbf_gym.filter.scenes import Scenes
from hcbf_gym.models import clocks
from hcbf_gym.models.constants import FARTHEST, LONGEST
from hcbf_gym.models.plant import Estimate

JET_FIELDS = ("h", "gradient", "second derivative", "∂h/∂t", "∂∇h/∂t", "∂²h/∂t²")
"""The fields of a `Jet` in words, in their order."""


class CauseFinder:
    """Finds the cause of a reason in the samples, scenes, rows or guidance of N plants."""

    def __init__(self, samples: Samples, scenes: Scenes, rows: RowMaker, guide: Guide):
        self._samples, self._scenes, self._rows, self._guide = samples, scenes, rows, guide
        self._plant, self._count = scenes.plant, len(samples.plants)

    def find(self, reason: Reason, plants: Mask, estimate: Estimate) -> str:
        """Return in words why the first of the masked plants (N,) has a reason to brake.

        `estimate` is the latest one, which the samples have taken. The cause is "" if no more is
        known than the reason.
        """
        find_cause = {
            Reason.STATE: self._state_fault,
            Reason.AGE: self._age_fault,
            Reason.CLOCK: self._clock_fault,
            Reason.BARRIERS: self._barrier_fault,
            Reason.GOAL: self._guidance_fault,
            Reason.MOVES: self._moving_region,
        }.get(reason)
        first_plant = int(np.flatnonzero(plants)[0])
        try:
            return "" if find_cause is None else find_cause(first_plant, estimate)
        except Exception as error:  # of a user's own object that is read or shown
            return in_words(error)

    def _state_fault(self, i: int, estimate: Estimate) -> str:
        """Return which value in the estimate of plant i is invalid; "" if all seem valid."""
        n = self._plant.model.n
        required = ("x",) if self._plant.axle is None else ("x", "heading")
        checks = {  # of each field of an estimate: its shape, and why its numbers are invalid
            "x": ((n,), _range_fault),
            "model": ((n,), _range_fault),
            "lag": ((n,), _range_fault),
            "covariance": ((n, n), _covariance_fault),
            "heading": ((), _range_fault),
            "elapsed": ((), _elapsed_fault),
        }
        for name, (shape, find_fault) in checks.items():
            value = getattr(estimate, name)
            if value is None and name not in required:
                continue
            numbers = self._of_plant(i, value, shape)
            if numbers is None:
                return f"{name}: got {shown(value)}, expected real numbers of shape {shape}"
            fault = find_fault(name, numbers)
            if fault:
                return fault
        return ""

    def _age_fault(self, i: int, estimate: Estimate) -> str:
        wrong = self._samples.wrong_age
        return f"{wrong.source}: {clocks.refusal(wrong.age, wrong.oldest)}" if wrong else ""

    def _clock_fault(self, i: int, estimate: Estimate) -> str:
        """Return why the time of plant i's state does not advance."""
        if estimate.time is None:
            return "barriers move without a time: expected Plant(period=…) or Estimate(time=…)"
        time = self._of_plant(i, estimate.time, ())
        if time is None or not np.isfinite(time):
            return f"got {shown(estimate.time)}, expected a finite time [s]"
        accepted_at = float(self._samples.plants["accepted_at"][i])
        return f"got {float(time):.9g} s after {accepted_at:.9g} s"

    def _barrier_fault(self, i: int, estimate: Estimate) -> str:
        """Return why barriers are refused, or what in the rows of plant i is not finite."""
        if self._scenes.is_refused and self._scenes.error:
            return in_words(self._scenes.error)
        x, t, model = self._samples.x[i].copy(), float(self._samples.time[i]), self._plant.model
        place = f"at x = {shown(x.tolist())}, t = {t:.6g} s"
        try:
            f, g = model.terms(x)
        except Exception as error:  # a user's own model may raise anything
            return f"{model} has no f and g {place}: {in_words(error)}"
        if not (np.isfinite(f).all() and np.isfinite(g).all()):
            return f"f or g of {model} is not finite {place}"
        condition = 0
        for element in self._scenes.current.listed[i]:
            if isinstance(element, Barrier):
                with np.errstate(all="ignore"):
                    fault = _jet_fault(element, x, t)
                if fault:
                    named = f"{element.name!r} of rank {element.priority}"
                    return f"condition {condition}, {named}: {fault} {place}"
            condition += len(element) if isinstance(element, Shapes) else 1
        return f"{self._rows.errors.get(i) or 'the margin that rows reserve'}, {place}"

    def _guidance_fault(self, i: int, estimate: Estimate) -> str:
        return self._guide.why_lost([i])

    def _moving_region(self, i: int, estimate: Estimate) -> str:
        return repr(self._scenes.moving_region) if self._scenes.moving_region else ""

    def _of_plant(self, i: int, value: object, shape: tuple[int, ...]) -> Array | None:
        """Return the part of plant i in a value of N plants; None unless it is of real numbers."""
        batch = real_array(value, (self._count, *shape))
        if batch is not None:
            return batch[i]
        return real_array(value, shape) if self._count == 1 else None


def _range_fault(name: str, numbers: Array) -> str:
    """Return which entry is NaN or farther than any place; "" for none."""
    for index in np.argwhere(~(np.abs(numbers) <= FARTHEST)):
        entry = f"{name}{index.tolist() or ''}"
        return f"{entry} is {numbers[tuple(index)]:g}, expected a number within ±{FARTHEST:g}"
    return ""


def _covariance_fault(name: str, matrix: Array) -> str:
    expected = "expected a symmetric one, none below 0"
    is_valid = _core.is_covariance(matrix)
    return "" if is_valid else f"{name}: got {shown(matrix.tolist())}, {expected}"


def _elapsed_fault(name: str, elapsed: Array) -> str:
    if 0.0 < elapsed <= LONGEST:
        return ""
    return f"{name}: got {elapsed:g} s, expected above 0 s and at most {LONGEST:g} s"


def _jet_fault(barrier: Barrier, x: Array, t: float) -> str:
    """Return which value or derivative of a barrier is not finite; "" if all are."""
    try:
        given = barrier.jet(x, t)
    except Exception as error:  # a user's own barrier may raise anything
        return f"it raised {in_words(error)}"
    try:
        jet = checked(barrier, given, len(x), finite=False)
    except InvalidInputError as error:
        return in_words(error)
    if not np.isfinite(jet.h):
        return f"h is {jet.h}"
    for name, derivative in zip(JET_FIELDS, jet, strict=True):
        if not np.isfinite(derivative).all():
            return f"h is {jet.h:.4g} and its {name} is not finite ({SMOOTH})"
    return ""


def warn_of_reason(reason: Reason, cause: str, plant_count: int, brakes_on_alarm: bool) -> None:
    """Warn why a filter brakes or has raised an alarm, with the cause, or "" if it is not known."""
    if reason == Reason.UNVERIFIED:
        reaction = "satisfies the rows of all strict conditions"
    elif reason < FIRST_ALARM or brakes_on_alarm:
        reaction = "brakes"
    else:
        reaction = "continues without a promise"
    end = "until the next reset" if reason.lasts else "until that ends"
    plants = "" if plant_count == 1 else f" of {plant_count} plants"
    explanation = f"{reason.text} ({cause})" if cause else reason.text
    message = f"safety filter{plants}: {explanation}; the filter {reaction} {end}"
    warn_caller(message, SafetyWarning)
