"""Why a filter brakes, in words: which part of what it was given is wrong, and where."""

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.kinks import SMOOTH
from hcbf_gym.barriers.many import Shapes
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import UNREADABLE, shown
from hcbf_gym.filter.state_check import numbers_of
from hcbf_gym.models.constants import FARTHEST, LONGEST
from hcbf_gym.models.plant import Estimate, Plant
from hcbf_gym.models.reduced_order import ReducedOrderModel


def of_state(estimate: Estimate, plant: Plant, i: int, count: int) -> str:
    """Return which entry of plant i's estimate is none; "" where all seem sound.

    Args:
        estimate: of N plants.
        plant: what each of them is.
        i: which.
        count: N.
    """
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
        if name == "covariance" and not _core.is_covariance(one):
            return f"covariance: got {shown(one.tolist())}, expected a symmetric one, none below 0"
        if name == "elapsed" and not 0.0 < one <= LONGEST:
            return f"elapsed: got {one:g} s, expected above 0 s and at most {LONGEST:g} s"
        far = (
            np.argwhere(~(np.abs(one) <= FARTHEST)) if name not in ("covariance", "elapsed") else ()
        )
        for index in far:
            where = f"{name}{index.tolist() or ''}"
            return f"{where} is {one[tuple(index)]:g}, expected a number within ±{FARTHEST:g}"
    return ""


def of_clock(estimate: Estimate, last: float, i: int, count: int) -> str:
    """Return what is wrong with the time of plant i's state.

    Args:
        estimate: of N plants.
        last: the time of the last state that was accepted [s].
        i: which plant.
        count: N.
    """
    if estimate.time is None:
        return "barriers move, and nothing tells when: expected Plant(period=…) or Estimate(time=…)"
    time = _one_of(estimate.time, (), i, count)
    if time is None or not np.isfinite(time):
        return f"got {shown(estimate.time)}, expected a finite time [s]"
    return f"got {float(time):.9g} s after {last:.9g} s"


def of_barriers(scene: BarrierSet, model: ReducedOrderModel, x: Array, t: float, i: int) -> str:
    """Return which barrier of scene i is not finite, its value or a derivative, and where.

    Args:
        scene: of N plants.
        model: of the plants, whose f and g may fail, too.
        x: (n,) the state.
        t: its time [s].
        i: which scene.
    """
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
    many = numbers_of(value, (count, *shape))
    if many is not None:
        return many[i]
    return numbers_of(value, shape) if count == 1 else None
