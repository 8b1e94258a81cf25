r"""Whether a region comes nearer than its declared velocity explains, by more than its margin.

When barriers change, each region is evaluated twice at the present state: ĥ is the region as it was
before, propagated with its velocity, and h the region as it is now. Neither contains the robot's
motion, so that the undeclared approach is d = ĥ − h. It is counted as

.. math::
    g ← \min(\max(g + d − r T, 0), 2\, l), \qquad r = 0.02 + 0.1 ‖w‖, \qquad l = 2 n,

with d averaged over `SMOOTHS`, the period T, the declared velocity w, and the declared error n of a
position. The reason is MOVES while g > l. Errors of at most n change the sum of all d by 2 n at
most, so that g of a region at rest stays below l; so do normal errors of n/3. r forgives errors of
a velocity. g ends at 2 l, so that the reason ends within seconds after the region came to rest.
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
"""r at no declared speed [m/s], and its share of the declared speed."""
LEAST = 1e-3
"""l where no error of a position is declared [m]."""
_VELOCITY = [layout.VELOCITY_X, layout.VELOCITY_Y]


class Nearness:
    """The undeclared approach of m regions to each of N plants.

    Attributes:
        is_some: whether there is any.
    """

    def __init__(self, count: int):
        self._uncounted: Array = np.zeros((count, 0))  # d that averaging has not counted yet [m]
        self._counted: Array = np.zeros((count, 0))  # g [m]
        self._forgiven: Array = np.zeros((count, 0))  # r [m/s]
        self.is_some = False

    def forget(self, mask: Mask) -> None:
        """Clear what was counted for the masked plants (N,)."""
        self._uncounted[mask] = self._counted[mask] = 0.0

    def compare(
        self, before: BarrierSet, now: BarrierSet, x: Array, t: Array, changed: Mask, valid: Mask
    ) -> None:
        """Add by how much regions are nearer now that barriers have changed.

        Args:
            before: the scenes until now, as of time 0.
            now: the scenes from now on, as of time 0.
            x: (N, n) states, the position first.
            t: (N,) times [s].
            changed: (N,) the plants whose barriers are others.
            valid: (N,) the plants whose states are valid.
        """
        speed = np.linalg.norm(now.parameters[..., _VELOCITY], axis=2) * now.is_region
        self._forgiven = FORGIVEN + OF_SPEED * speed
        if not before.kind.size or not now.kind.size:
            self._uncounted, self._counted = np.zeros((2, *now.kind.shape))
            return
        h_before, h_now = _heights(before, x, t), _heights(now, x, t)
        source = _sources(before, now, h_before, t, changed)
        for (i, k), barrier in now.own.items():
            previous = before.own.get((i, int(source[i, k])))
            if previous is not None and previous is not barrier and barrier.reads_position:
                h_before[i, source[i, k]] = _height(previous, x[i], float(t[i]))
                h_now[i, k] = _height(barrier, x[i], float(t[i]))
        with np.errstate(invalid="ignore"):
            nearer = _at_source(h_before, source) - h_now
        is_known = (valid & changed)[:, None] & (source >= 0) & np.isfinite(nearer)
        self._uncounted = _at_source(self._uncounted, source)
        self._counted = _at_source(self._counted, source)
        self._uncounted[is_known] += nearer[is_known]
        self.is_some = bool(self._uncounted.any() or self._counted.any())

    def moves(self, elapsed: Array, error: Array) -> Mask:
        """Count the approach of a step, and return which regions move undeclared (N, m).

        Args:
            elapsed: (N,) T, the time since the sample before [s]; 0 where it is not known.
            error: (N,) n, the declared error of a position [m].
        """
        limit = np.maximum(2.0 * error, LEAST)[:, None]
        with np.errstate(divide="ignore"):
            share = np.where(elapsed > 0.0, -np.expm1(-elapsed / SMOOTHS), 1.0)[:, None]
        approach = share * self._uncounted
        self._uncounted -= approach
        grown = self._counted + approach - self._forgiven * elapsed[:, None]
        self._counted = np.clip(grown, 0.0, 2.0 * limit)
        self.is_some = bool(self._counted.any() or (np.abs(self._uncounted) > LEAST**2).any())
        return self._counted > limit


def _at_source(values: Array, source: Integers) -> Array:
    """Return values (N, k) at the places `source` (N, m) before; 0 where there was none (−1)."""
    return np.take_along_axis(np.hstack([values, np.zeros((len(values), 1))]), source, axis=1)


def _heights(scenes: BarrierSet, x: Array, t: Array) -> Array:
    """Return h (N, m) of built-in regions [m]; infinity for all other barriers."""
    kind = np.where(scenes.is_region, scenes.kind, layout.CUSTOM)
    at_rest, h = np.zeros((len(x), 4)), np.empty(kind.shape)
    at_rest[:, :2] = x[:, :2]
    _core.barrier_values(kind, scenes.parameters, None, at_rest, t, h)
    return h


def _height(barrier: Barrier, x: Array, t: float) -> float:
    """Return h of a user's own barrier; NaN if it does not read the position or is unreadable.

    Where a user lowers h of a condition on the speed, nothing has moved.
    """
    try:
        jet = barrier.jet(x, t)
        return float(jet.h) if np.any(jet.gradient[:2]) else math.nan
    except UNREADABLE:
        return math.nan


def _sources(
    before: BarrierSet, now: BarrierSet, h_before: Array, t: Array, changed: Mask
) -> Integers:
    """Return (N, m) the place before of each barrier now, −1 for none.

    Barriers are the same if they have the same name, and both scenes have that name once. If not,
    the source is, of all regions of its kind that were beside it (`nearness.hpp`), the nearest to
    the robot.
    """
    (count, m), k = now.kind.shape, before.kind.shape[1]
    source = np.full((count, m), -1)
    source[:, : min(m, k)] = np.arange(min(m, k))  # of scenes that have not changed
    for i in np.flatnonzero(changed).tolist():
        lists = before.listed, now.listed
        is_shared = i and changed[i - 1] and all(listed[i] is listed[i - 1] for listed in lists)
        source[i] = source[i - 1] if is_shared else _named(before.listed[i], now.listed[i], m)
    if (source < 0).any():
        if m == k:  # unchanged parameters identify a barrier, too
            same = (before.parameters == now.parameters).all(axis=2) & (before.kind == now.kind)
            source = np.where((source < 0) & same, np.arange(m), source)
        barriers = (before.kind, before.parameters), (now.kind, now.parameters)
        _core.nearness_find_beside(*barriers, h_before, t, source)
    return source


def _named(before: Flat, now: Flat, m: int) -> Integers:
    """Return (m,) the place before of each barrier of one scene, by its name; −1 for none."""
    names_before, names, source = _names(before), _names(now), np.full(m, -1)
    if names_before == names and len(set(names)) == len(names):
        source[: len(names)] = np.arange(len(names))
        return source
    count_before, count = Counter(names_before), Counter(names)
    places = {name: k for k, name in enumerate(names_before) if count_before[name] == 1}
    for k, name in enumerate(names):
        source[k] = places.get(name, -1) if count[name] == 1 else -1
    return source


def _names(listed: Flat) -> list[str]:
    """Return the names of the barriers of a scene."""
    return [one.name for one, k, end in places_of(listed) for _ in range(k, end)]
