"""Positions count from near a robot's start where that is far away, as survey coordinates are."""

from collections.abc import Sequence

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, PlanarBarrier, Shape, Shapes
from hcbf_gym.barriers.set import Entry, each
from hcbf_gym.barriers.shapes import SHAPES

FAR = 1e3
"""A robot that starts farther away counts from there: as far as 10⁴ m rounding counts as little."""


class Origin:
    """From where positions count: from a far start, or from where they were 0."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Let the next place decide."""
        self._at: Array | None = None  # [m]
        self._near: dict[int, tuple[Barrier | Shapes, Barrier | Shapes]] = {}

    def place(self, place: Array) -> Array:
        """Return (3,) a pose as it counts from here [m, rad]; the first finite one decides."""
        if self._at is None and np.isfinite(place.sum()):
            far = float(np.abs(place[:2]).max()) > FAR
            self._at = np.rint(place[:2]) if far else np.zeros(2)
        return place if self._at is None else place - np.array([*self._at, 0.0])

    def goal(self, goal: Array | None) -> Array | None:
        """Return (2,) a goal as it counts from here [m]."""
        return goal if goal is None or self._at is None else goal - self._at

    def barriers(self, listed: Sequence[Entry]) -> Sequence[Entry]:
        """Return barriers as they count from here; the same objects for those that were given.

        Raises:
            InvalidInputError: if they are none.
        """
        at = self._at
        if at is None or not at.any():
            return listed
        entries = tuple(each(listed))
        near = self._near
        self._near = {id(one): near.get(id(one)) or (one, _moved(one, -at)) for one in entries}
        return tuple(self._near[id(one)][1] for one in entries)


def _moved(one: Barrier | Shapes, step: Array) -> Barrier | Shapes:
    """Return a barrier a step (2,) [m] away; a user's own kind of shape is looked at as it is."""
    if isinstance(one, Shape) and type(one) not in SHAPES:
        return PlanarBarrier.moved(one, step)
    return one.moved(step)
