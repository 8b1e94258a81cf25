"""Reads the barriers of N plants at every step: one sequence for all plants, or N sequences.

The `BarrierSet` of a step is used again while the sequences hold the same objects, and elements of
several barriers the same conditions. Objects are compared by identity, never by their values.
"""

import operator
from typing import Any

from hcbf_gym.barriers.many import Flat, Read, are_same, flattened, is_list
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, shown

Listed = tuple[tuple[Any, ...], ...]


class SceneReader:
    """Returns the set of the scenes of `count` plants."""

    def __init__(self, count: int):
        self._count = count
        self._scenes: Listed = ()
        self._immutable: object = None  # what was read last, if it cannot change
        self._several: Read = []  # the elements of several barriers, and their conditions then
        self._set = BarrierSet([()] * count)

    def __call__(self, barriers: Any) -> BarrierSet:
        """Return the scenes as a set, which is that of before if they hold the same objects.

        Args:
            barriers: a sequence of elements for all plants; N sequences, of any lengths; or the set
                of an environment, see `BarrierSet`.
        """
        if isinstance(barriers, BarrierSet):
            self._check(barriers)
            return barriers
        if barriers is None or not (barriers is self._immutable or self._is_last(barriers)):
            scenes = self._sequences(barriers)
            if len(scenes) != len(self._scenes) or not all(map(are_same, scenes, self._scenes)):
                self._read(scenes, barriers)
        if not all(are_same(one.conditions, conditions) for one, conditions in self._several):
            self._read(self._scenes, barriers)
        return self._set

    def _is_last(self, barriers: Any) -> bool:
        """Return whether `barriers` is a list for all plants with the objects read last."""
        scenes = self._scenes
        return type(barriers) is list and len(scenes) == 1 and are_same(barriers, scenes[0])

    def _sequences(self, barriers: Any) -> Listed:
        """Return one scene for all plants, or N, as tuples of elements."""
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

    def _check(self, scenes: BarrierSet) -> None:
        """Refuse a set that is not an environment's, or is of another number of plants."""
        if not scenes.is_placed:
            raise InvalidInputError(
                "barriers: got a BarrierSet, expected the sequence of barriers of which it was made"
            )
        if len(scenes.kind) != self._count:
            raise InvalidInputError(
                f"barriers: got a set of {len(scenes.kind)} scenes, expected {self._count}"
            )

    def _read(self, scenes: Listed, barriers: Any) -> None:
        """Make the set of scenes, and note what the next ones are compared with."""
        read = [flattened(scene) for scene in scenes]
        listed: list[Flat] = [flat for flat, _ in read]
        if len(listed) == 1:
            listed *= self._count
        self._set = BarrierSet(listed, self._set if self._count == 1 else None)
        self._several = [pair for _, several in read for pair in several]
        is_tuple = type(barriers) is tuple
        is_fixed = is_tuple and (scenes[0] is barriers or all(map(operator.is_, scenes, barriers)))
        self._scenes, self._immutable = scenes, barriers if is_fixed else None
