"""Places moving shapes as of time 0 of the plant's clock.

A new object describes the world at the time t₀ at which it is first returned or set. If the same
object is returned later, it has moved on with its velocity w. So a shape that is at p₀ at t₀ is
written at p₀ − w t₀, its place at time 0, and code that reads its block needs the plant's time
alone. A `Function`, and a class with a `jet`, read that time themselves.
"""

from collections.abc import Sequence
from copy import copy
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier, PlanarBarrier, velocity_of
from hcbf_gym.barriers.many import Flat
from hcbf_gym.barriers.set import BarrierSet, places_of
from hcbf_gym.barriers.shapes import SHAPES

_VELOCITY = [layout.VELOCITY_X, layout.VELOCITY_Y]
_NEW = -1  # no former place; in `_starts` the index of the last column, which is the time now


class OwnShape(NamedTuple):
    """A moving shape of a user's own class, and where it is at time 0 of the plant's clock."""

    given: PlanarBarrier  # the object that was returned or set
    since: float  # the time t₀ at which that was [s]
    at_zero: Barrier  # the same shape, moved to its place at time 0


class Placing:
    """Holds the time t₀ of each shape of `count` plants, on the clock of its plant.

    Attributes:
        is_due: whether a plant has begun, or its clock went back, since scenes were placed last.
    """

    def __init__(self, count: int):
        self._listed: list[Flat] | None = None
        self._since: Array = np.zeros((count, 0))
        self._own_shapes: dict[tuple[int, int], OwnShape] = {}
        self._begins: Mask = np.ones(count, dtype=np.bool_)
        self._went_back: Mask = np.zeros(count, dtype=np.bool_)
        self.is_due = True

    def forget(self, mask: Mask) -> None:
        """Take all shapes of the masked plants (N,) as new at the plant's next time."""
        self._begins |= mask
        self.is_due = True

    def go_back(self, mask: Mask) -> None:
        """Let no t₀ of the masked plants (N,) be later than the plant's next time."""
        self._went_back |= mask
        self.is_due = True

    def place(self, given: BarrierSet, now: Array, since: float | None = None) -> BarrierSet:
        """Return the scenes as of time 0 of the plants' clocks.

        Args:
            given: the scenes as they were returned or set.
            now: (N,) the plants' times [s].
            since: t₀ of all shapes [s]; None for the rule of this module.
        """
        if given.is_placed:
            since = 0.0
        shape = given.kind.shape
        self._since = self._starts(given, now) if since is None else np.full(shape, since)
        self._listed = given.listed
        self._begins[:] = self._went_back[:] = self.is_due = False
        return given if given.is_placed else self._moved(given)

    def moved_to_time_zero(self, barriers: Sequence[Barrier]) -> list[Barrier]:
        """Return the barriers of plant 0, which were placed last, as of time 0 of its clock."""
        pairs = zip(barriers, self._since[0].tolist(), strict=True)
        return [_at_zero(barrier, since) for barrier, since in pairs]

    def _starts(self, given: BarrierSet, now: Array) -> Array:
        """Return (N, m) the time t₀ of each shape [s]."""
        if self._listed is None or self._begins.all():
            return np.repeat(now[:, None], given.kind.shape[1], axis=1)
        before = self._since
        if self._went_back.any():
            is_later = self._went_back[:, None] & (before > now[:, None])
            before = np.where(is_later, now[:, None], before)
        source = self._sources(given, self._listed)
        source[self._begins] = _NEW
        return np.take_along_axis(np.hstack([before, now[:, None]]), source, axis=1)

    def _sources(self, given: BarrierSet, previous: list[Flat]) -> Integers:
        """Return (N, m) the place that the same object had before; `_NEW` for a new object."""
        if given.listed is previous:
            return np.tile(np.arange(given.kind.shape[1]), (len(previous), 1))
        source = np.full(given.kind.shape, _NEW)
        for i, (listed, before) in enumerate(zip(given.listed, previous, strict=True)):
            if i and listed is given.listed[i - 1] and before is previous[i - 1]:
                source[i] = source[i - 1]
                continue
            if set(map(id, before)).isdisjoint(map(id, listed)):
                continue
            former_places = {id(barrier): place for barrier, place, _ in places_of(before)}
            for barrier, place, end in places_of(listed):
                former = former_places.get(id(barrier))
                if former is not None:
                    source[i, place:end] = np.arange(former, former + end - place)
        return source

    def _moved(self, given: BarrierSet) -> BarrierSet:
        """Return the set with its shapes as of time 0."""
        steps = -self._since[..., None] * given.parameters[..., _VELOCITY]
        is_moved = given.is_region & (steps != 0.0).any(axis=2)
        own = self._moved_own(given)
        if not own and not is_moved.any():
            return given
        placed = copy(given)
        placed.parameters, placed.ends = given.parameters.copy(), given.ends + self._since
        for cls in SHAPES:
            is_moved_shape = is_moved & (given.kind == cls.code)
            if is_moved_shape.any():
                blocks = placed.parameters[is_moved_shape]
                cls.shift(blocks, steps[is_moved_shape])
                placed.parameters[is_moved_shape] = blocks
        placed.own, placed.listed = given.own | own, list(given.listed)
        for i in {scene for scene, _ in own}:
            placed.listed[i] = tuple(
                own.get((i, k), barrier) for barrier, k, _ in places_of(given.listed[i])
            )
        return placed

    def _moved_own(self, given: BarrierSet) -> dict[tuple[int, int], Barrier]:
        """Return (scene, place) → a moving shape of a user's own class, as of time 0.

        It is the same object as in the last call, if the given object and its t₀ are the same.
        """
        previous, self._own_shapes = self._own_shapes, {}
        for place, barrier in given.own.items():
            if not isinstance(barrier, PlanarBarrier) or not velocity_of(barrier).any():
                continue
            since = float(self._since[place])
            shape = previous.get(place)
            if shape is None or shape.given is not barrier or shape.since != since:
                shape = OwnShape(barrier, since, _at_zero(barrier, since))
            self._own_shapes[place] = shape
        shapes = self._own_shapes.items()
        return {place: shape.at_zero for place, shape in shapes if shape.at_zero is not shape.given}


def _at_zero(barrier: Barrier, since: float) -> Barrier:
    """Return a barrier whose time t₀ is `since` [s] as of time 0; itself if it does not move."""
    if not (isinstance(barrier, PlanarBarrier) and since and velocity_of(barrier).any()):
        return barrier
    step = -since * velocity_of(barrier)
    if type(barrier) in SHAPES:
        return barrier.moved(step)
    return PlanarBarrier.moved(barrier, step)  # a user's own class need not define `moved`
