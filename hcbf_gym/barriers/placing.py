"""Places moving shapes: each counts from the time at which its object was first returned or set.

A new object describes the world now, and the same object moves on with its velocity w. A shape that
is at p₀ at its time t₀ is written as of time 0 of the plant's clock, at p₀ − w t₀. So code that
reads its block needs the plant's time alone. A `Function`, and a class with a `jet`, read that time
themselves.
"""

from collections.abc import Sequence
from copy import copy
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier, PlanarBarrier
from hcbf_gym.barriers.many import Flat
from hcbf_gym.barriers.set import BarrierSet, places_of
from hcbf_gym.barriers.shapes import SHAPES

_VELOCITY = [layout.VELOCITY_X, layout.VELOCITY_Y]
_NEW = -1


class OwnShape(NamedTuple):
    """A moving shape of a user's own class, and where it is at time 0 of the plant's clock."""

    given: PlanarBarrier  # as it was returned or set
    since: float  # the time from which it counts [s]
    at_zero: Barrier  # the same shape, moved to its place at time 0


class Placing:
    """The times from which the shapes of `count` plants count, on the clock of each plant.

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
        """Let all shapes of the masked plants (N,) count from the plant's next time."""
        self._begins |= mask
        self.is_due = True

    def go_back(self, mask: Mask) -> None:
        """Let no shape of the masked plants (N,) count from later than the plant's next time."""
        self._went_back |= mask
        self.is_due = True

    def place(self, given: BarrierSet, now: Array, since: float | None = None) -> BarrierSet:
        """Return the scenes as of time 0 of the plants' clocks.

        Args:
            given: the scenes as they were returned or set.
            now: (N,) the plants' times [s].
            since: the time from which all shapes count [s]; None for the rule of this module.
        """
        if given.is_placed:
            since = 0.0
        shape = given.kind.shape
        self._since = self._starts(given, now) if since is None else np.full(shape, since)
        self._listed = given.listed
        self._begins[:] = self._went_back[:] = self.is_due = False
        return given if given.is_placed else self._moved(given)

    def as_of_zero(self, barriers: Sequence[Barrier]) -> list[Barrier]:
        """Return barriers of plant 0 as of time 0 of its clock; `place` had them last."""
        return [
            _moved_by(one, -since * one.frame_velocity)
            if isinstance(one, PlanarBarrier) and since and one.frame_velocity.any()
            else one
            for one, since in zip(barriers, self._since[0].tolist(), strict=True)
        ]

    def _starts(self, given: BarrierSet, now: Array) -> Array:
        """Return (N, m) the times from which the shapes count [s]."""
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
            places = {id(one): place for one, place, _ in places_of(before)}
            for one, place, end in places_of(listed):
                was = places.get(id(one))
                if was is not None:
                    source[i, place:end] = np.arange(was, was + end - place)
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
            these = is_moved & (given.kind == cls.code)
            if not these.any():
                continue
            blocks = placed.parameters[these]
            cls.shift(blocks, steps[these])
            placed.parameters[these] = blocks
        placed.own, placed.listed = given.own | own, list(given.listed)
        for i in {i for i, _ in own}:
            placed.listed[i] = tuple(
                own.get((i, k), one) for one, k, _ in places_of(given.listed[i])
            )
        return placed

    def _moved_own(self, given: BarrierSet) -> dict[tuple[int, int], Barrier]:
        """Return (scene, place) → a moving shape of a user's own class, as of time 0.

        A shape that counts from the same time as before is the same object as before.
        """
        before, self._own_shapes = self._own_shapes, {}
        for place, one in given.own.items():
            if not isinstance(one, PlanarBarrier) or not one.frame_velocity.any():
                continue
            since = float(self._since[place])
            shape = before.get(place)
            if shape is None or shape.given is not one or shape.since != since:
                at_zero = _moved_by(one, -since * one.frame_velocity) if since else one
                shape = OwnShape(one, since, at_zero)
            self._own_shapes[place] = shape
        shapes = self._own_shapes.items()
        return {place: one.at_zero for place, one in shapes if one.at_zero is not one.given}


def _moved_by(one: PlanarBarrier, step: Array) -> Barrier:
    """Return a shape that is a step (2,) [m] away; a user's own class need not define that."""
    return one.moved(step) if type(one) in SHAPES else PlanarBarrier.moved(one, step)
