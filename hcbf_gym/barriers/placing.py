"""Since when shapes count: from the time at which their object was first returned or set.

A new object describes the world now, and the same object moves on with its velocity. A shape that
counts from t₀ is written as of time 0 of the plant's clock, p₀ − w t₀, so that all that reads its
block needs the plant's time alone. A `Function` and a class with a `jet` read that time themselves.
"""

from collections.abc import Iterator, Sequence
from copy import copy
from operator import is_
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier, PlanarBarrier
from hcbf_gym.barriers.many import Shapes
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.shapes import SHAPES

_VELOCITY = [layout.VELOCITY_X, layout.VELOCITY_Y]
_COMPARED = "kind", "parameters", "priority"
_COPIED = *_COMPARED, "keeps_margin", "own_margin"
_NEW = -1

Listed = Sequence[Barrier | Shapes]


class Placing:
    """Since when the shapes of N plants count, on the clock of each plant.

    Args:
        count: N.

    Attributes:
        is_due: whether a plant has begun, or its clock went back, since scenes were placed last.
    """

    def __init__(self, count: int):
        self._given: BarrierSet | None = None
        self._listed: list[Listed] = [()] * count
        self._version: Integers = np.zeros(count, dtype=np.int64)
        self._content: list[Any] = []  # of a set that others may write to
        self._written: tuple[Any, ...] = ()  # its arrays
        self._compared: _core.Compared | None = None  # both
        self._since: Array = np.zeros((count, 0))
        self._there: dict[tuple[int, int], tuple[PlanarBarrier, float, Barrier]] = {}
        self._begins: Mask = np.ones(count, dtype=np.bool_)
        self._went_back: Mask = np.zeros(count, dtype=np.bool_)
        self.is_due = True

    def __getstate__(self) -> dict[str, object]:
        """Return what a copy needs; it compares its own arrays."""
        return vars(self) | {"_written": (), "_compared": None}

    def forget(self, mask: Mask) -> None:
        """Let all shapes of the masked plants (N,) count from their next time."""
        self._begins |= mask
        self.is_due = True

    def go_back(self, mask: Mask) -> None:
        """Let no shape of the masked plants (N,) count from later than their next time."""
        self._went_back |= mask
        self.is_due = True

    def is_edited(self, given: BarrierSet) -> bool:
        """Return whether the set that was placed last was written to since."""
        if not self._content or given is not self._given:
            return False
        now: tuple[Any, Any, Any] = given.kind, given.parameters, given.priority
        if self._compared is None or not all(map(is_, now, self._written)):
            if not all(map(_are_alike, now, self._content)):
                return bool(self.edited(given).any())
            self._compared, self._written = _core.Compared(*now, *self._content), now
        return self._compared.differ()

    def edited(self, given: BarrierSet) -> Mask:
        """Return (N, m) which blocks of the set that was placed last were written to since."""
        changed = np.zeros(given.kind.shape, dtype=np.bool_)
        for name, before in zip(_COMPARED, self._content, strict=False):
            now = getattr(given, name)
            if now.shape != before.shape:
                return ~changed
            differs = now != before
            changed |= differs.any(axis=2) if differs.ndim == 3 else differs
        return changed

    def place(self, given: BarrierSet, now: Array, since: float | None = None) -> BarrierSet:
        """Return the scenes as of time 0 of the plants' clocks.

        Args:
            given: as it was returned or set.
            now: (N,) the plants' times [s].
            since: from when all of them count [s]; None for the law of this module.
        """
        is_fixed = given.since is not None
        starts = given.since if is_fixed else since
        if starts is None:
            self._since = self._starts(given, now)
        else:
            self._since = np.full(given.kind.shape, starts)
        self._content, self._compared = [], None
        placed = given if given.since == 0.0 else self._moved(given)
        self._given, self._listed = given, list(given.listed)
        self._version = given.version.copy()
        self._begins[:] = self._went_back[:] = self.is_due = False
        return placed

    def as_of_zero(self, barriers: Sequence[Barrier]) -> list[Barrier]:
        """Return the barriers of plant 0, which were placed last, as of time 0 of its clock."""
        return [
            _elsewhere(one, -since * one.frame_velocity)
            if isinstance(one, PlanarBarrier) and since and one.frame_velocity.any()
            else one
            for one, since in zip(barriers, self._since[0].tolist(), strict=True)
        ]

    def _starts(self, given: BarrierSet, now: Array) -> Array:
        """Return (N, m) the times from which the shapes count [s]."""
        if self._given is None or self._begins.all():
            return np.repeat(now[:, None], given.kind.shape[1], axis=1)
        before = self._since
        if self._went_back.any():
            late = self._went_back[:, None] & (before > now[:, None])
            before = np.where(late, now[:, None], before)
        source = self._sources(given)
        source[self._begins] = _NEW
        return np.take_along_axis(np.hstack([before, now[:, None]]), source, axis=1)

    def _sources(self, given: BarrierSet) -> Integers:
        """Return (N, m) at which place the same objects were before, `_NEW` for none."""
        count, m = given.kind.shape
        found = np.full((count, m), _NEW)
        same = np.zeros(count, dtype=np.bool_)
        if given is self._given:  # whose arrays may have been written to
            same = given.version == self._version
            found[same] = np.where(self.edited(given), _NEW, np.arange(m))[same]
        for i in np.flatnonzero(~same).tolist():
            listed, before = given.listed[i], self._listed[i]
            if i and listed is given.listed[i - 1] and before is self._listed[i - 1]:
                found[i] = found[i - 1]
                continue
            if set(map(id, before)).isdisjoint(map(id, listed)):
                continue
            known = {id(one): place for one, place, _ in _places(before)}
            for one, place, end in _places(listed):
                was = known.get(id(one))
                if was is not None:
                    found[i, place:end] = np.arange(was, was + end - place)
        return found

    def _moved(self, given: BarrierSet) -> BarrierSet:
        """Return a set like the given one, whose shapes are written as of time 0."""
        steps = -self._since[..., None] * given.parameters[..., _VELOCITY]
        moved = given.is_region & (steps != 0.0).any(axis=2)
        own = self._own(given)
        if given.is_kept and not own and not moved.any():
            return given
        placed = copy(given)
        for name in _COPIED:
            setattr(placed, name, getattr(given, name).copy())
        if not given.is_kept:
            self._content = [getattr(given, name).copy() for name in _COMPARED]
        for cls in SHAPES if moved.any() else ():
            these = moved & (given.kind == cls.code)
            if not these.any():
                continue
            blocks = placed.parameters[these]
            cls.shift(blocks, steps[these])
            placed.parameters[these] = blocks
        placed.own, placed.listed = given.own | own, list(given.listed)
        for i in {i for i, _ in own}:
            placed.listed[i] = tuple(own.get((i, k), one) for one, k, _ in _places(given.listed[i]))
        return placed

    def _own(self, given: BarrierSet) -> dict[tuple[int, int], Barrier]:
        """Return (scene, place) → a user's own shape that moves, as of time 0."""
        before, self._there = self._there, {}
        for place, one in given.own.items():
            if not isinstance(one, PlanarBarrier) or not one.frame_velocity.any():
                continue
            since = float(self._since[place])
            known = before.get(place)
            if known is None or known[0] is not one or known[1] != since:
                known = one, since, _elsewhere(one, -since * one.frame_velocity) if since else one
            self._there[place] = known
        return {place: there for place, (one, _, there) in self._there.items() if there is not one}


def _are_alike(now: NDArray[Any], before: NDArray[Any]) -> bool:
    """Return whether the core can compare two arrays."""
    same = now.shape == before.shape and now.dtype == before.dtype
    return same and now.flags.c_contiguous


def _elsewhere(one: PlanarBarrier, step: Array) -> Barrier:
    """Return a shape elsewhere; a user's own kind of shape is looked at as it is."""
    return one.moved(step) if type(one) in SHAPES else PlanarBarrier.moved(one, step)


def _places(listed: Listed) -> Iterator[tuple[Barrier | Shapes, int, int]]:
    """Yield the entries of a scene, each with its first place and the place behind its last."""
    k = 0
    for one in listed:
        end = k + (len(one) if isinstance(one, Shapes) else 1)
        yield one, k, end
        k = end
