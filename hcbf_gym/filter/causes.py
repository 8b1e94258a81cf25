"""Why a filter brakes, in words: which part of what it was given is wrong, and where."""

import re

import numpy as np

from hcbf_gym import _core
from hcbf_gym._core import FIRST_ALARM, Reason
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.kinks import SMOOTH
from hcbf_gym.barriers.many import Shapes
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import UNREADABLE, SafetyWarning, shown, warn_caller
from hcbf_gym.filter.guide import Guide
from hcbf_gym.filter.samples import Samples, real_array
from hcbf_gym.filter.scenes import Scenes
from hcbf_gym.models.constants import FARTHEST, LONGEST
from hcbf_gym.models.plant import Estimate, Plant
from hcbf_gym.models.reduced_order import ReducedOrderModel

_NUMBER = re.compile(r"[\d.]+")


def kind_of(reason: int, cause: str) -> object:
    """Return what a reason is warned of once as: itself, or of a wrong age old or ahead."""
    return (reason, _NUMBER.sub("", cause)) if reason == Reason.AGE else reason


def warn_of(reason: int, count: int, cause: str, brakes: bool) -> None:
    """Warn of a reason.

    Args:
        reason: a `Reason`.
        count: how many plants of a batch have it.
        cause: what exactly is wrong; "" where nothing more is known.
        brakes: whether an alarm makes the filter brake.
    """
    until = "until the next reset" if Reason(reason).lasts else "until that ends"
    does = "brakes" if reason < FIRST_ALARM or brakes else "continues without a promise"
    if reason == Reason.UNVERIFIED:
        does = "satisfies the rows of all strict conditions"
    many = "" if count == 1 else f" of {count} plants"
    text = f"{Reason(reason).text}{f' ({cause})' if cause else ''}"
    warn_caller(f"safety filter{many}: {text}; the filter {does} {until}", SafetyWarning)


def cause_of(
    reason: int,
    reasons: Integers,
    estimate: Estimate,
    samples: Samples,
    scenes: Scenes,
    guide: Guide,
) -> str:
    """Return what exactly is wrong of the first plant with a reason; "" for no more.

    Args:
        reason: a `Reason`.
        reasons: (N,) of the plants.
        estimate: of them.
        samples: of them.
        scenes: of them.
        guide: of them.
    """
    has, plant = reasons == reason, scenes.plant
    count, i = len(has), int(np.flatnonzero(has)[0])
    if reason == Reason.STATE:
        return _of_state(estimate, plant, i, count)
    if reason == Reason.AGE:
        return samples.wrong_age
    if reason == Reason.CLOCK:
        return _of_clock(estimate, float(samples.plants["accepted_at"][i]), i, count)
    if reason == Reason.BARRIERS:
        if scenes.is_refused:
            return str(scenes.error)
        x, time = samples.x[i].copy(), float(samples.time[i])
        return _of_barriers(scenes.current, plant.model, x, time, i)
    if reason == Reason.GOAL:
        return guide.why(has)
    if reason == Reason.MOVES and scenes.moving_region:
        return repr(scenes.moving_region)
    return ""


def _of_state(estimate: Estimate, plant: Plant, i: int, count: int) -> str:
    """Return which entry of plant i's estimate is none; "" where all seem sound."""
    n = plant.model.n
    parts = {"x": (n,), "model": (n,), "lag": (n,), "covariance": (n, n), "heading": (),
             "elapsed": ()}  # fmt: skip
    for name, shape in parts.items():
        value = getattr(estimate, name)
        needed = name == "x" or (name == "heading" and plant.axle is not None)
        if value is None and not needed:
            continue
        one = _one_of(value, shape, i, count)
        if one is None:
            return f"{name}: got {shown(value)}, expected real numbers of shape {shape}"
        if name == "covariance":
            if not _core.is_covariance(one):
                return (
                    f"covariance: got {shown(one.tolist())}, expected a symmetric one, none below 0"
                )
        elif name == "elapsed":
            if not 0.0 < one <= LONGEST:
                return f"elapsed: got {one:g} s, expected above 0 s and at most {LONGEST:g} s"
        else:
            for index in np.argwhere(~(np.abs(one) <= FARTHEST)):
                where = f"{name}{index.tolist() or ''}"
                return f"{where} is {one[tuple(index)]:g}, expected a number within ±{FARTHEST:g}"
    return ""


def _of_clock(estimate: Estimate, last: float, i: int, count: int) -> str:
    """Return what is wrong with the time of plant i's state, after the `last` valid one [s]."""
    if estimate.time is None:
        return "barriers move without a time: expected Plant(period=…) or Estimate(time=…)"
    time = _one_of(estimate.time, (), i, count)
    if time is None or not np.isfinite(time):
        return f"got {shown(estimate.time)}, expected a finite time [s]"
    return f"got {float(time):.9g} s after {last:.9g} s"


def _of_barriers(scene: BarrierSet, model: ReducedOrderModel, x: Array, t: float, i: int) -> str:
    """Return which barrier of scene i is not finite at x (n,), its value or a derivative."""
    at = f"at x = {shown(x.tolist())}, t = {t:.6g} s"
    try:
        f, g = model.terms(x)
    except UNREADABLE as error:
        return f"{model} has no f and g {at}: {error}"
    if not (np.isfinite(f).all() and np.isfinite(g).all()):
        return f"f or g of {model} is not finite {at}"
    k = 0
    for barrier in scene.listed[i]:
        if isinstance(barrier, Barrier):
            with np.errstate(all="ignore"):
                wrong = _wrong(barrier, x, t)
            if wrong:
                return f"condition {k}, {barrier.name!r} of rank {barrier.priority}: {wrong} {at}"
        k += len(barrier) if isinstance(barrier, Shapes) else 1
    return f"the margin that rows reserve, {at}"


def _wrong(barrier: Barrier, x: Array, t: float) -> str:
    """Return what of a barrier is not finite; "" for nothing."""
    try:
        jet = barrier.jet(x, t)
        finite = [bool(np.isfinite(field).all()) for field in jet]
    except Exception as error:  # whatever a user's own barrier raises
        return f"it raised {type(error).__name__}: {error}"
    if not finite[0]:
        return f"h is {jet.h}"
    names = ("h", "gradient", "second derivative", "∂h/∂t", "∂∇h/∂t", "∂²h/∂t²")
    for name, is_finite in zip(names, finite, strict=False):
        if not is_finite:
            return f"h is {jet.h:.4g} and its {name} is not finite ({SMOOTH})"
    return ""


def _one_of(value: object, shape: tuple[int, ...], i: int, count: int) -> Array | None:
    """Return plant i's part of a value of N plants; None where it is none of real numbers."""
    many = real_array(value, (count, *shape))
    if many is not None:
        return many[i]
    return real_array(value, shape) if count == 1 else None
