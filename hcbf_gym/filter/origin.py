"""Translates positions to an origin near a plant that begins far from 0, as in a survey."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, PlanarBarrier, Shape, Shapes
from hcbf_gym.barriers.many import Flat, each, is_list
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

_Translated = dict[int, tuple[Barrier | Shapes, Barrier | Shapes]]
"""id → a barrier, so that no other gets its id, and its translation.

Filters compare barriers by identity: one barrier must remain one object.
"""


class World(NamedTuple):
    """The goal and the extent of guidance, as a plant's readers return them; not validated yet."""

    goal: Any  # (2,) or (N, 2) the position to which guidance leads [m]
    extent: Any  # ((x_min, y_min), (x_max, y_max)) in which it leads [m]; None for unknown


class Origin:
    """The origin of the positions of N plants: 0, or near a far start.

    It is near the first plant whose position is finite.

    Args:
        model: of the plants; positions of models that are not `SAME_EVERYWHERE` stay as they are.

    Attributes:
        is_decided: whether a position has decided the origin.
        is_far: whether the origin is not 0.
        at: (2,) the origin [m].
    """

    def __init__(self, model: ReducedOrderModel) -> None:
        self._is_movable = isinstance(model, SAME_EVERYWHERE)
        self.is_decided, self.is_far = not self._is_movable, False
        self.at = np.zeros(2)
        self._translated: _Translated = {}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Find barriers again in a copy, where they are other objects."""
        vars(self).update(state)
        self._translated = {id(pair[0]): pair for pair in self._translated.values()}

    def forget(self) -> None:
        """Return to 0, until the next position decides."""
        self.is_decided, self.is_far = not self._is_movable, False
        self.at = np.zeros(2)
        self._translated = {}

    def decide(self, x: Array) -> None:
        """Decide the origin by the first finite position of states (N, n)."""
        for position in x[:, :2]:
            if np.abs(position).max() <= ON_EARTH:
                self.is_decided, self.is_far = True, bool(np.abs(position).max() > FAR)
                self.at = np.rint(position) if self.is_far else np.zeros(2)
                return

    def shift(self, x: Array) -> None:
        """Translate the positions of states (N, n) to the origin, in place."""
        x[:, :2] -= self.at

    def world(self, world: World | None) -> World | None:
        """Return a world translated to the origin."""
        if world is None or not self.is_far:
            return world
        return World(*(self._translate_points(points) for points in world))

    def _translate_points(self, points: Any) -> Any:
        try:
            return None if points is None else np.asarray(points, dtype=np.float64) - self.at
        except Exception:  # any error of a user's own object: guidance refuses it with a message
            return points

    def barriers(self, scenes: Any) -> Any:
        """Return barriers translated to the origin, the same objects for the same barriers.

        Args:
            scenes: a list of barriers, or N such lists; anything else, which the filter refuses,
                is returned as it is.
        """
        if not self.is_far:
            return scenes
        if isinstance(scenes, BarrierSet):
            raise InvalidInputError(
                "got the scenes of an environment, which stay where they are; expected lists of "
                "barriers, or positions that count from nearby"
            )
        if not is_list(scenes):
            return scenes
        previous, self._translated = self._translated, {}  # drop what is in no scene any more
        if any(map(is_list, scenes)):
            return tuple(self._translate_scene(scene, previous) for scene in scenes)
        return self._translate_scene(scenes, previous)

    def _translate_scene(self, scene: Sequence[Any], previous: _Translated) -> Flat:
        translated, barriers = self._translated, each(scene)
        for barrier in barriers:
            key = id(barrier)
            if key not in translated:
                translated[key] = previous.get(key) or (barrier, _moved(barrier, -self.at))
        return tuple(translated[id(barrier)][1] for barrier in barriers)


def _moved(barrier: Barrier | Shapes, step: Array) -> Barrier | Shapes:
    """Return a barrier a step (2,) [m] away."""
    if isinstance(barrier, Shape) and type(barrier) not in SHAPES:  # its `places` may lack fields
        return PlanarBarrier.moved(barrier, step)
    return barrier.moved(step)
