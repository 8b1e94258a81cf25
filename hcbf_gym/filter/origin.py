"""The origin of positions: near the start of a plant that begins far away, as in a survey."""

from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, PlanarBarrier, Shape, Shapes
from hcbf_gym.barriers.many import each, is_list
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.shapes import SHAPES
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.constants import ON_EARTH
from hcbf_gym.models.reduced_order import DoubleIntegrator, ReducedOrderModel, SingleIntegrator
from hcbf_gym.models.vehicles import KinematicBicycle, Unicycle

FAR = 1e3
"""A plant that starts farther away has its own origin, against errors of rounding [m]."""
SAME_EVERYWHERE = DoubleIntegrator, SingleIntegrator, Unicycle, KinematicBicycle
"""Models that begin with a position, on which ẋ does not depend."""


class World(NamedTuple):
    """What guidance must know of a plant's world, or of N, as their readers return it."""

    goal: Any  # (2,) or (N, 2) where guidance leads [m]
    extent: Any  # ((x_min, y_min), (x_max, y_max)) in which it leads [m]; None for unknown


class Origin:
    """The origin of the positions of N plants: 0, or near a far start.

    It is near the first plant whose position is finite.

    Args:
        model: of the plants; positions of models that are not `SAME_EVERYWHERE` stay as they are.

    Attributes:
        is_decided: whether a position has decided where it is.
        is_far: whether it is not 0.
        at: (2,) where it is [m].
    """

    def __init__(self, model: ReducedOrderModel) -> None:
        self._moves = isinstance(model, SAME_EVERYWHERE)
        self.forget()

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Find barriers again in a copy, where they are other objects."""
        vars(self).update(state)
        self._near = {id(pair[0]): pair for pair in self._near.values()}

    def forget(self) -> None:
        """Let the next position decide."""
        self.is_decided, self.is_far = not self._moves, False
        self.at = np.zeros(2)
        self._near: dict[int, tuple[Barrier | Shapes, Barrier | Shapes]] = {}

    def decide(self, x: Array) -> None:
        """Let the first finite position of states (N, n) decide."""
        for place in x[:, :2]:
            if np.abs(place).max() <= ON_EARTH:
                self.is_decided, self.is_far = True, bool(np.abs(place).max() > FAR)
                self.at = np.rint(place) if self.is_far else np.zeros(2)
                return

    def shift(self, x: Array) -> None:
        """Let states (N, n) count from here, in place."""
        x[:, :2] -= self.at

    def world(self, world: World | None) -> World | None:
        """Return a world whose positions count from here; malformed ones stay as they are."""
        if world is None or not self.is_far:
            return world
        return World(*(self._point(one) for one in world))

    def _point(self, given: Any) -> Any:
        try:
            return None if given is None else np.asarray(given, dtype=np.float64) - self.at
        except Exception:  # guidance refuses it
            return given

    def barriers(self, listed: Any) -> Any:
        """Return barriers whose positions count from here.

        A barrier that was in the call before is the same object again.

        Args:
            listed: a list of barriers, or N such lists; anything else stays as it is.
        """
        if not self.is_far:
            return listed
        if isinstance(listed, BarrierSet):
            raise InvalidInputError(
                "got the scenes of an environment, which stay where they are; expected lists of "
                "barriers, or positions that count from nearby"
            )
        if not is_list(listed):
            return listed
        before, self._near = self._near, {}
        if any(map(is_list, listed)):
            return tuple(self._moved(one, before) for one in listed)
        return self._moved(listed, before)

    def _moved(self, listed: Any, before: dict[int, Any]) -> tuple[Any, ...]:
        entries = each(listed)
        for one in entries:
            if id(one) not in self._near:
                self._near[id(one)] = before.get(id(one)) or (one, _moved(one, -self.at))
        return tuple(self._near[id(one)][1] for one in entries)


def _moved(one: Barrier | Shapes, step: Array) -> Barrier | Shapes:
    """Return a barrier a step (2,) [m] away; a user's own kind of shape is looked at as it is."""
    if isinstance(one, Shape) and type(one) not in SHAPES:
        return PlanarBarrier.moved(one, step)
    return one.moved(step)
