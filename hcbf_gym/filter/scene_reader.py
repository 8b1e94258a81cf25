"""The barriers of N plants as a filter reads them at every step: a sequence, or N sequences.

As long as they hold the same objects, and elements of several barriers the same conditions, the set
that was made of them stays: objects are compared, never their values.
"""

import operator
from typing import Any

from hcbf_gym.barriers.many import Flat, Read, are_same, flattened, is_list
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, shown

Listed = tuple[tuple[Any, ...], ...]


class SceneReader:
    """Reads the scenes of `count` plants."""

    def __init__(self, count: int):
        self._count = count
        self._scenes: Listed = ()
        self._fixed: object = None  # what was read last, if it is immutable
        self._several: Read = []
        self._set = BarrierSet([()] * count)

    def __call__(self, barriers: Any) -> BarrierSet:
        """Return the scenes, the same set as before while they hold the same objects.

        Args:
            barriers: a sequence of elements for all plants; N sequences, of any lengths; or the set
                of an environment, see `BarrierSet`.
        """
        if isinstance(barriers, BarrierSet):
            self._check(barriers)
            return barriers
        if barriers is None or not (barriers is self._fixed or self._is_last(barriers)):
            scenes = self._sequences(barriers)
            if len(scenes) != len(self._scenes) or not all(map(are_same, scenes, self._scenes)):
                self._read(scenes, barriers)
        if not all(are_same(one.conditions, conditions) for one, conditions in self._several):
            self._read(self._scenes, barriers)
        return self._set

    def _is_last(self, barriers: Any) -> bool:
        """Return whether a list for all plants holds the objects that were read last."""
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
        """Refuse a set that is not an environment's, or of another number of plants."""
        if not scenes.is_placed:
            raise InvalidInputError(
                "barriers: got a BarrierSet, expected the sequence of barriers of which it was made"
            )
        if len(scenes.kind) != self._count:
            raise InvalidInputError(
                f"barriers: got a set of {len(scenes.kind)} scenes, expected {self._count}"
            )

    def _read(self, scenes: Listed, barriers: Any) -> None:
        """Make a set of scenes."""
        read = [flattened(scene) for scene in scenes]
        listed: list[Flat] = [flat for flat, _ in read]
        if len(listed) == 1:
            listed *= self._count
        self._set = BarrierSet(listed, self._set if self._count == 1 else None)
        self._several = [pair for _, several in read for pair in several]
        is_tuple = type(barriers) is tuple
        fixed = is_tuple and (scenes[0] is barriers or all(map(operator.is_, scenes, barriers)))
        self._scenes, self._fixed = scenes, barriers if fixed else None
