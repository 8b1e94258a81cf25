"""Reads the barriers of N plants at every step: one sequence for all plants, or N sequences.

The `BarrierSet` of a step is used again while the sequences hold the same objects, and elements of
several barriers the same conditions. Objects are compared by identity, never by their values.
"""

import operator
from typing import Any

from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.many import Flat, Read, are_same, flattened, is_list
from hcbf_gym.barriers.mapped import Mapped
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, shown
from hcbf_gym.models.reduced_order import ReducedOrderModel

SceneTuples = tuple[tuple[Any, ...], ...]
"""One scene for all plants, or N scenes, each a tuple of elements."""


class SceneReader:
    """Returns the set of the scenes of `count` plants."""

    def __init__(self, count: int):
        self._count = count
        self._scenes: SceneTuples = ()
        self._immutable: object = None  # the latest argument, if it cannot change
        self._several: Read = []  # the elements of several barriers, and their conditions then
        self._set = BarrierSet([()] * count)

    def __call__(self, barriers: Any) -> BarrierSet:
        """Return the scenes as a set, the same set while they hold the same objects.

        Args:
            barriers: a sequence of elements for all plants; N sequences, of any lengths; or the set
                of an environment, see `BarrierSet`.
        """
        if isinstance(barriers, BarrierSet):
            self._check_set(barriers)
            return barriers
        if barriers is None or not (barriers is self._immutable or self._is_last(barriers)):
            scenes = self._sequences(barriers)
            if len(scenes) != len(self._scenes) or not all(map(are_same, scenes, self._scenes)):
                self._read(scenes, barriers)
        if not all(are_same(element.conditions, then) for element, then in self._several):
            self._read(self._scenes, barriers)
        return self._set

    def _is_last(self, barriers: Any) -> bool:
        """Return whether `barriers` is a list for all plants with the objects read last."""
        scenes = self._scenes
        return type(barriers) is list and len(scenes) == 1 and are_same(barriers, scenes[0])

    def _sequences(self, barriers: Any) -> SceneTuples:
        """Return barriers as scenes; refuse all that is no sequence of elements, or N of them."""
        if not is_list(barriers):
            raise InvalidInputError(
                f"barriers: got {shown(barriers)}, expected a sequence of Barriers"
            )
        if not is_list(next(iter(barriers), None)):
            return (tuple(barriers),)
        if len(barriers) != self._count or not all(map(is_list, barriers)):
            raise InvalidInputError(
                f"barriers: got {len(barriers)} entries that are no barriers, expected one list of "
                f"barriers for all plants, or {self._count} lists, one for each"
            )
        return tuple(map(tuple, barriers))

    def _check_set(self, scenes: BarrierSet) -> None:
        """Refuse a set that is not an environment's, or is of another number of plants."""
        if not scenes.is_placed:
            raise InvalidInputError(
                "barriers: got a BarrierSet, expected the sequence of barriers of which it was made"
            )
        if len(scenes.kind) != self._count:
            raise InvalidInputError(
                f"barriers: got a set of {len(scenes.kind)} scenes, expected {self._count}"
            )

    def _read(self, scenes: SceneTuples, barriers: Any) -> None:
        """Make the set of scenes, and store the objects with which the next are compared."""
        read = [flattened(scene) for scene in scenes]
        listed: list[Flat] = [barriers_of_scene for barriers_of_scene, _ in read]
        if len(listed) == 1:
            listed *= self._count
        self._set = BarrierSet(listed, self._set if self._count == 1 else None)
        self._several = [pair for _, several in read for pair in several]
        # `tuple(scene)` is the scene itself if that is a tuple
        is_immutable = type(barriers) is tuple and (
            scenes[0] is barriers or all(map(operator.is_, scenes, barriers))
        )
        self._scenes, self._immutable = scenes, barriers if is_immutable else None


def check_general(barriers: object, given: BarrierSet, model: ReducedOrderModel) -> None:
    """Refuse barriers, and the set read from them, that only planar double integrators have."""
    if isinstance(barriers, BarrierSet):
        raise InvalidInputError(
            f"plant: got the scenes of an environment with {model}, expected a sequence of "
            "barriers: they have rows of the planar double integrator alone"
        )
    for scene in given.listed:
        if not all(isinstance(barrier, Barrier) for barrier in scene):
            raise InvalidInputError(
                f"barriers: got {scene!r}, expected a sequence of objects of classes derived "
                "from hcbf_gym.barriers.Barrier"
            )
        mapped = [barrier.name for barrier in scene if isinstance(barrier, Mapped)]
        if mapped:
            raise InvalidInputError(
                f"barriers: got the classes {mapped} of a map, expected them for a plant of "
                "the planar double integrator: only its rows look beyond the nearest piece"
            )
