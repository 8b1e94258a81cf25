r"""Whether a region is nearer than its declared velocity explains, by more than its margin.

Where barriers change, both are evaluated at the present state: with ĥ of a region as it was before,
propagated with its velocity, and h as it is now, the undeclared approach is d = ĥ − h. The robot's
motion is in neither. The approach is counted as

.. math::
    g ← \min(\max(g + d − r T, 0), 2\, l), \qquad r = 0.02 + 0.1 ‖w‖, \qquad l = 2 n,

d averaged over `SMOOTHS`, n the declared error of a position. Errors of at most n change the sum of
all d by 2 n at most, so that a region at rest stays below l; so do normal errors of n/3. The reason
is MOVES where g > l. r forgives errors of a velocity. g ends at 2 l, so that the reason ends within
seconds after the region has come to rest.
"""

import math
from collections import Counter

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.many import Flat
from hcbf_gym.barriers.set import BarrierSet, places_of
from hcbf_gym.errors import UNREADABLE

SMOOTHS = 0.1
"""Time constant over which undeclared approach is averaged [s]."""
FORGIVEN, OF_SPEED = 0.02, 0.1
"""Undeclared approach that is no motion [m/s], and as a share of the declared speed."""
LEAST = 1e-3
"""l where no error of a position is declared [m]."""
_VELOCITY = [layout.VELOCITY_X, layout.VELOCITY_Y]


class Nearness:
    """What of the approach of regions to N plants their velocities do not explain.

    Attributes:
        is_some: whether there is any.
    """

    def __init__(self, count: int):
        self._due: Array = np.zeros((count, 0))  # d that is not counted yet [m]
        self._counted: Array = np.zeros((count, 0))  # g [m]
        self._forgiven: Array = np.zeros((count, 0))  # r [m/s]
        self.is_some = False

    def forget(self, mask: Mask) -> None:
        """Know nothing of the masked plants (N,)."""
        self._due[mask] = self._counted[mask] = 0.0

    def compare(
        self,
        before: BarrierSet,
        now: BarrierSet,
        at: tuple[Array, Array],
        changed: Mask,
        known: Mask,
    ) -> None:
        """Note which regions came nearer when barriers became others.

        Args:
            before: the scenes until now, as of time 0.
            now: the scenes from now on, as of time 0.
            at: (N, n) states, the position first, and (N,) times [s].
            changed: (N,) of which plants the barriers are others.
            known: (N,) of which plants the state is known.
        """
        x, t = at
        speed = np.linalg.norm(now.parameters[..., _VELOCITY], axis=2) * now.is_region
        self._forgiven = FORGIVEN + OF_SPEED * speed
        if not before.kind.size or not now.kind.size:
            self._due, self._counted = np.zeros((2, *now.kind.shape))
            return
        earlier, present = _heights(before, x, t), _heights(now, x, t)
        source = _sources(before, now, earlier, t, changed)
        _write_own(before, now, source, (x, t), (earlier, present))
        none = np.zeros((len(x), 1))
        with np.errstate(invalid="ignore"):
            nearer = np.take_along_axis(np.hstack([earlier, none]), source, axis=1) - present
        is_known = (known & changed)[:, None] & (source >= 0) & np.isfinite(nearer)
        self._due = np.take_along_axis(np.hstack([self._due, none]), source, axis=1)
        self._counted = np.take_along_axis(np.hstack([self._counted, none]), source, axis=1)
        self._due[is_known] += nearer[is_known]
        self.is_some = bool(self._due.any() or self._counted.any())

    def moves(self, elapsed: Array, error: Array) -> Mask:
        """Let time pass, and return (N, m) which regions move undeclared.

        Args:
            elapsed: (N,) since the sample before [s]; 0 where that is not known.
            error: (N,) n [m].
        """
        limit = np.maximum(2.0 * error, LEAST)[:, None]
        with np.errstate(divide="ignore"):
            share = np.where(elapsed > 0.0, -np.expm1(-elapsed / SMOOTHS), 1.0)[:, None]
        counts = share * self._due
        self._due -= counts
        grown = self._counted + counts - self._forgiven * elapsed[:, None]
        self._counted = np.clip(grown, 0.0, 2.0 * limit)
        self.is_some = bool(self._counted.any() or (np.abs(self._due) > LEAST**2).any())
        return self._counted > limit


def _heights(scenes: BarrierSet, x: Array, t: Array) -> Array:
    """Return h (N, m) of built-in regions; infinity for all others."""
    kind = np.where(scenes.is_region, scenes.kind, layout.CUSTOM)
    placed, h = np.zeros((len(x), 4)), np.empty(kind.shape)
    placed[:, :2] = x[:, :2]
    _core.barrier_values(kind, scenes.parameters, None, placed, t, h)
    return h


def _sources(
    before: BarrierSet, now: BarrierSet, earlier: Array, t: Array, changed: Mask
) -> Integers:
    """Return (N, m) which condition before was which now, −1 for none.

    It is the one of the same name, where both lists have that name once; else, of all regions of
    its kind that were beside it (`nearness.hpp`), the nearest to the robot.
    """
    (count, m), k = now.kind.shape, before.kind.shape[1]
    found = np.full((count, m), -1)
    found[:, : min(m, k)] = np.arange(min(m, k))  # of those that stay
    for i in np.flatnonzero(changed).tolist():
        lists = before.listed, now.listed
        shared = i and changed[i - 1] and all(listed[i] is listed[i - 1] for listed in lists)
        found[i] = found[i - 1] if shared else _named(before.listed[i], now.listed[i], m)
    if (found < 0).any():
        if m == k:  # what stayed as it was
            same = (before.parameters == now.parameters).all(axis=2) & (before.kind == now.kind)
            found = np.where((found < 0) & same, np.arange(m), found)
        numbers = (before.kind, before.parameters), (now.kind, now.parameters)
        _core.nearness_find_beside(*numbers, earlier, t, found)
    return found


def _named(before: Flat, now: Flat, m: int) -> Integers:
    """Return (m,) the places before of the conditions of a scene, by their names; −1 for none."""
    names, others, found = _names(before), _names(now), np.full(m, -1)
    if names == others and len(set(names)) == len(names):
        found[: len(names)] = np.arange(len(names))
        return found
    how_often, of_others = Counter(names), Counter(others)
    places = {name: k for k, name in enumerate(names) if how_often[name] == 1}
    for k, name in enumerate(others):
        found[k] = places.get(name, -1) if of_others[name] == 1 else -1
    return found


def _names(listed: Flat) -> list[str]:
    """Return the names of the conditions of a scene."""
    return [one.name for one, k, end in places_of(listed) for _ in range(k, end)]


def _write_own(
    before: BarrierSet,
    now: BarrierSet,
    source: Integers,
    at: tuple[Array, Array],
    heights: tuple[Array, Array],
) -> None:
    """Write h of users' own barriers on the position that are others than before."""
    (x, t), (earlier, present) = at, heights
    for (i, k), one in now.own.items():
        j = int(source[i, k])
        was = before.own.get((i, j))
        if was is None or was is one or not one.reads_position:
            continue
        earlier[i, j] = _height(was, x[i], float(t[i]))
        present[i, k] = _height(one, x[i], float(t[i]))


def _height(barrier: Barrier, x: Array, t: float) -> float:
    """Return h of a user's own barrier; NaN where it does not read the position, or its code fails.

    What a user lowers of a condition on the speed is no motion.
    """
    try:
        jet = barrier.jet(x, t)
        return float(jet.h) if np.any(jet.gradient[:2]) else math.nan
    except UNREADABLE:
        return math.nan
