"""The pieces of all maps in a set of scenes, one behind another in one array."""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.mapped import Mapped
from hcbf_gym.barriers.pieces import Pieces

Place = tuple[int, int]


class Atlas:
    """Pieces that compiled code finds by where they begin.

    What several scenes share stands there once. What no scene holds any more is cleared away when
    room is short.

    Args:
        before: what stands there is not copied, and no more is put there: a scan beside a large map
            costs what the scan does.

    Attributes:
        numbers: (L,) `Pieces.packed` of all of them; None as long as there was none.
        held: (scene, place) → the class of a map that stands there.
    """

    def __init__(self, before: "Atlas | None" = None) -> None:
        self.numbers: Array | None = None
        self._before = before if before else None  # one without a map would lead to its own
        self.held: dict[Place, Mapped] = {}
        self._begins: dict[Pieces, int] = {}  # by the objects: a copy of an atlas has its own
        self._end = 0

    def __bool__(self) -> bool:
        """Return whether there is any map."""
        return bool(self.held)

    def hold(self, place: Place, barrier: Mapped, parameters: Array) -> None:
        """Put a class of a map at (scene, place).

        Args:
            place: in the set.
            barrier: the class.
            parameters: (N, m, WIDTH) of the set, written to; of every class where others move.
        """
        if self._before is not None:
            before, self._before = self._before, None
            self.numbers, self._end = before.numbers, before._end
            self._begins = before._begins.copy()
        self.held[place] = barrier
        pieces = barrier.pieces
        if pieces not in self._begins:
            if self.numbers is None or self._end + pieces.packed.size > self.numbers.size:
                self._clear_away()
                for other, one in self.held.items():
                    one.write(parameters[other], self._begins[one.pieces])
                return
            self._append(self.numbers, barrier)
        barrier.write(parameters[place], self._begins[pieces])

    def of(self, places: dict[int, int]) -> "Atlas":
        """Return what some scenes hold, and the same numbers, to which no more is written.

        Args:
            places: number of each scene → its number in the new set.
        """
        chosen = Atlas()
        chosen.numbers = self.numbers
        chosen._end = 0 if self.numbers is None else self.numbers.size  # more asks for new room
        chosen.held = {(places[i], k): one for (i, k), one in self.held.items() if i in places}
        return chosen

    def _append(self, numbers: Array, barrier: Mapped) -> None:
        pieces = barrier.pieces
        begin, self._end = self._end, self._end + pieces.packed.size
        numbers[begin : self._end] = pieces.packed
        self._begins[pieces] = begin

    def _clear_away(self) -> None:
        """Keep what is held alone, with as much room again."""
        alive = {one.pieces: one for one in self.held.values()}
        size = sum(one.pieces.packed.size for one in alive.values())
        self.numbers = np.zeros(2 * size)
        self._begins, self._end = {}, 0
        for one in alive.values():
            self._append(self.numbers, one)
