"""Translates positions to an origin near a plant that begins far from 0, as in a survey."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, PlanarBarrier, Shape, Shapes
from hcbf_gym.barriers.many import Flat, each, is_list
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.shapes import SHAPES
from hcbf_gym.errors import InvalidInputError, reals
from hcbf_gym.models.constants import ON_EARTH
from hcbf_gym.models.reduced_order import DoubleIntegrator, ReducedOrderModel, SingleIntegrator
from hcbf_gym.models.vehicles import KinematicBicycle, Unicycle

MAX_START_DISTANCE = 1e3
"""A plant that starts farther away gets an origin nearby, against errors of rounding [m]."""
TRANSLATABLE_MODELS = DoubleIntegrator, SingleIntegrator, Unicycle, KinematicBicycle
"""Models with a position as the first entries of x, on which ẋ does not depend."""

_Translated = dict[int, tuple[Barrier | Shapes, Barrier | Shapes]]
"""The id of a barrier → the barrier, so that no other gets its id, and its translation.

Filters compare barriers by identity, so that the same barrier must have the same translation.
"""


class World(NamedTuple):
    """The goal and the extent of guidance, as a plant's readers return them; not validated yet."""

    goal: Any  # (2,) or (N, 2) the position to which guidance leads [m]
    extent: Any  # ((x_min, y_min), (x_max, y_max)) in which it leads [m]; None for unknown


class Origin:
    """The origin of the positions of N plants: 0, or near the first plant if that is far away.

    Args:
        model: the plants' model; the origin of models that are not `TRANSLATABLE_MODELS` is 0.

    Attributes:
        is_decided: whether a position has decided the origin.
        is_far: whether the origin is not 0.
        at: (2,) the origin [m].
    """

    def __init__(self, model: ReducedOrderModel) -> None:
        self._is_translatable = isinstance(model, TRANSLATABLE_MODELS)
        self.forget()

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the attributes in a copy, where barriers have other ids."""
        vars(self).update(state)
        self._translated = {id(pair[0]): pair for pair in self._translated.values()}

    def forget(self) -> None:
        """Return to 0, until the next position decides."""
        self.is_decided, self.is_far = not self._is_translatable, False
        self.at = np.zeros(2)
        self._translated: _Translated = {}

    def decide(self, x: Array) -> None:
        """Decide the origin by the first finite position of states (N, n)."""
        for position in x[:, :2]:
            distance = np.abs(position).max()
            if distance <= ON_EARTH:
                self.is_decided, self.is_far = True, bool(distance > MAX_START_DISTANCE)
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
            return None if points is None else reals("points", points) - self.at
        except Exception:  # a foreign object may raise anything; guidance refuses it
            return points

    def barriers(self, scenes: Any) -> Any:
        """Return a list of barriers, or N such lists, translated to the origin.

        The same barriers have the same translations. Anything else is returned as it is, because
        the filter refuses it.
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
        previous, self._translated = self._translated, {}  # drop barriers of no present scene
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
    """Return a barrier that is moved by a step (2,) [m]."""
    if isinstance(barrier, Shape) and type(barrier) not in SHAPES:  # its `places` may lack fields
        return PlanarBarrier.moved(barrier, step)
    return barrier.moved(step)
