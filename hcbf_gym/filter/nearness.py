r"""Finds regions that come nearer than their declared velocity explains, by more than the margin.

When barriers change, each region is evaluated twice at the present state: ĥ is the region as it was
before, propagated with its velocity, and h the region as it is now. Neither contains the robot's
motion, so that the undeclared approach is d = ĥ − h. It is counted as

.. math::
    g ← \min(\max(g + d − r T, 0), 2\, l), \qquad r = 0.02 + 0.1 ‖w‖, \qquad l = 2 n,

with d averaged over `AVERAGING_TIME`, the period T, the declared velocity w, and the declared error
n of a position. The reason is MOVES while g > l. Errors of at most n change the sum of all d by at
most 2 n, so that g of a region at rest stays below l. The same holds for normal errors of n/3. The
rate r forgives errors of a velocity. Because g is at most 2 l, the reason ends within seconds after
the region came to rest.
"""

import math
from collections import Counter

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier, checked
from hcbf_gym.barriers.many import Flat
from hcbf_gym.barriers.set import BarrierSet, places_of

AVERAGING_TIME = 0.1
"""Time constant over which undeclared approach is averaged [s]."""
FORGIVEN_SPEED, FORGIVEN_SHARE = 0.02, 0.1
"""r without a declared velocity [m/s], and the share of the declared speed that is added [-]."""
LEAST_LIMIT = 1e-3
"""l if no error of a position is declared [m]."""
NEGLIGIBLE = LEAST_LIMIT**2
"""An approach of no effect, by which its counting ends [m]."""
_NO_SOURCE = -1
_VELOCITY = [layout.VELOCITY_X, layout.VELOCITY_Y]


class Nearness:
    """The undeclared approach of m regions to each of N plants.

    Attributes:
        is_some: whether any approach is counted, or to be counted.
    """

    def __init__(self, count: int):
        self._pending: Array = np.zeros((count, 0))  # d that averaging has not counted yet [m]
        self._counted: Array = np.zeros((count, 0))  # g [m]
        self._forgiven_rate: Array = np.zeros((count, 0))  # r [m/s]
        self.is_some = False

    def forget(self, mask: Mask) -> None:
        """Clear what was counted for the masked plants (N,)."""
        self._pending[mask] = self._counted[mask] = 0.0

    def compare(
        self, before: BarrierSet, now: BarrierSet, x: Array, t: Array, changed: Mask, valid: Mask
    ) -> None:
        """Add the approach of regions by a change of barriers, to be counted by `moves`.

        Args:
            before: the scenes until now, as of time 0.
            now: the scenes from now on, as of time 0.
            x: (N, n) states, the position first.
            t: (N,) times [s].
            changed: (N,) the plants with other barriers than before.
            valid: (N,) the plants whose states can be compared.
        """
        speed = np.linalg.norm(now.parameters[..., _VELOCITY], axis=2) * now.is_region
        forgiven_rate = FORGIVEN_SPEED + FORGIVEN_SHARE * speed
        if not before.kind.size or not now.kind.size:
            self._forgiven_rate = forgiven_rate
            self._pending, self._counted = np.zeros((2, *now.kind.shape))
            return
        h_before, h_now = _heights(before, x, t), _heights(now, x, t)
        source = _sources(before, now, h_before, t, changed)
        for (i, k), barrier in now.own.items():
            k_before = int(source[i, k])
            previous = before.own.get((i, k_before))
            if previous is not None and previous is not barrier:
                h_before[i, k_before] = _height(previous, x[i], float(t[i]))
                h_now[i, k] = _height(barrier, x[i], float(t[i]))
        with np.errstate(invalid="ignore"):
            approach = _at_source(h_before, source) - h_now
        has_source = source != _NO_SOURCE
        is_known = (valid & changed)[:, None] & has_source & np.isfinite(approach)
        self._forgiven_rate = forgiven_rate
        self._pending = _at_source(self._pending, source)
        self._counted = _at_source(self._counted, source)
        self._pending[is_known] += approach[is_known]
        self.is_some = bool(self._pending.any() or self._counted.any())

    def moves(self, elapsed: Array, error: Array) -> Mask:
        """Count the approach of a step, and return which regions move undeclared (N, m).

        Args:
            elapsed: (N,) T, the time since the sample before [s]; 0 where it is not known.
            error: (N,) n, the declared error of a position [m].
        """
        limit = np.maximum(2.0 * error, LEAST_LIMIT)[:, None]
        with np.errstate(divide="ignore"):
            average_share = -np.expm1(-elapsed / AVERAGING_TIME)
        average_share = np.where(elapsed > 0.0, average_share, 1.0)[:, None]
        approach = average_share * self._pending
        self._pending -= approach
        grown = self._counted + approach - self._forgiven_rate * elapsed[:, None]
        self._counted = np.clip(grown, 0.0, 2.0 * limit)
        self.is_some = bool(self._counted.any() or (np.abs(self._pending) > NEGLIGIBLE).any())
        return self._counted > limit


def _at_source(values: Array, source: Integers) -> Array:
    """Return values (N, k) at the indices `source` (N, m); 0 for `_NO_SOURCE`, the last column."""
    return np.take_along_axis(np.hstack([values, np.zeros((len(values), 1))]), source, axis=1)


def _heights(scenes: BarrierSet, x: Array, t: Array) -> Array:
    """Return h (N, m) of built-in regions [m]; infinity for all other barriers."""
    kind = np.where(scenes.is_region, scenes.kind, layout.CUSTOM)
    at_rest, h = np.zeros((len(x), 4)), np.empty(kind.shape)
    at_rest[:, :2] = x[:, :2]
    _core.barrier_values(kind, scenes.parameters, None, at_rest, t, h)
    return h


def _height(barrier: Barrier, x: Array, t: float) -> float:
    """Return h of a user's own barrier; NaN if it is unreadable or does not read the position.

    A lower h of a condition on the speed does not mean that something has moved.
    """
    try:
        jet = checked(barrier, barrier.jet(x, t), len(x), finite=False)
        is_placed = barrier.reads_position and np.any(jet.gradient[:2])
        return jet.h if is_placed else math.nan
    except Exception:  # it may raise anything
        return math.nan


def _sources(
    before: BarrierSet, now: BarrierSet, h_before: Array, t: Array, changed: Mask
) -> Integers:
    """Return (N, m) the index that each barrier had in the scene before, or `_NO_SOURCE`.

    Barriers are the same if they have the same name, and both scenes have that name once. If not,
    the source is the region nearest to the robot, among those of the same kind that were beside the
    barrier (`nearness.hpp`).
    """
    (count, m), m_before = now.kind.shape, before.kind.shape[1]
    source = np.full((count, m), _NO_SOURCE)
    shared = min(m, m_before)
    source[:, :shared] = np.arange(shared)  # holds for scenes that have not changed
    for i in np.flatnonzero(changed).tolist():
        scene_before, scene = before.listed[i], now.listed[i]
        is_as_last = i > 0 and changed[i - 1]
        is_as_last &= scene_before is before.listed[i - 1] and scene is now.listed[i - 1]
        source[i] = source[i - 1] if is_as_last else _sources_by_name(scene_before, scene, m)
    if (source == _NO_SOURCE).any():
        if m == m_before:  # unchanged parameters identify a barrier, too
            is_same = (before.parameters == now.parameters).all(axis=2) & (before.kind == now.kind)
            source = np.where((source == _NO_SOURCE) & is_same, np.arange(m), source)
        barriers = (before.kind, before.parameters), (now.kind, now.parameters)
        _core.nearness_find_beside(*barriers, h_before, t, source)
    return source


def _sources_by_name(before: Flat, now: Flat, m: int) -> Integers:
    """Return (m,) the index before of each barrier of one scene, by its name, or `_NO_SOURCE`."""
    names_before, names, source = _names(before), _names(now), np.full(m, _NO_SOURCE)
    if names_before == names and len(set(names)) == len(names):
        source[: len(names)] = np.arange(len(names))
        return source
    count_before, count = Counter(names_before), Counter(names)
    index_before = {name: k for k, name in enumerate(names_before)}
    for k, name in enumerate(names):
        if count_before[name] == count[name] == 1:
            source[k] = index_before[name]
    return source


def _names(scene: Flat) -> list[str]:
    """Return the names of the barriers of a scene."""
    return [element.name for element, k, end in places_of(scene) for _ in range(k, end)]
