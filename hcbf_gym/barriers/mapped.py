"""Classes of a map as barriers, and the atlas that holds their pieces.

A class is all cells of one kind, which convex pieces cover. It is one barrier, and its h is the
least h of all pieces. A filter makes a row for each piece within the braking horizon.
`docs/rows.md` proves that pieces beyond it need no row: with every input of U that is held for a
period, h ≥ m and ψ ≥ 0 at its end.
"""

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import layout, speed_limit
from hcbf_gym.barriers.barrier import Barrier, Jet
from hcbf_gym.barriers.pieces import Pieces
from hcbf_gym.barriers.shape import set_positive
from hcbf_gym.errors import finite_float
from hcbf_gym.models.constants import FARTHEST
from hcbf_gym.models.grid import Grid


@dataclass(frozen=True, eq=False)
class Mapped(Barrier):
    """The base of classes of a map and of scans, for filters of the planar double integrator.

    Objects are equal only if they are the same one, because comparing all cells takes too long.

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        pieces: the pieces that cover the cells.
        margin: what rows reserve around the pieces besides the robot's own margins [m].
    """

    pieces: Pieces = field(kw_only=True)
    margin: float = 0.0
    code: ClassVar[int] = layout.MAPPED
    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        """Return whether `other` is the same object."""
        return self is other

    def __post_init__(self) -> None:
        super().__post_init__()
        margin = finite_float(f"{self.name}: margin", self.margin, minimum=0.0, maximum=FARTHEST)
        object.__setattr__(self, "margin", margin)

    def write(self, c: Array, at: int) -> int:
        """Write the block c (WIDTH,) of a class, and return its kind; see `layout`.

        `at` is the index in the atlas at which the pieces of the class begin.
        """
        c[:] = 0.0
        c[layout.PIECES] = at
        return self.code

    def moved(self, step: Array) -> Self:
        """Return the same pieces a step (2,) [m] away."""
        return replace(self, pieces=self.pieces.moved(step))

    def near(self, x: Array, beyond: float) -> tuple[Array, Array]:
        """Return the signed distances (k,) [m] of the nearest pieces, and their gradients (k, 2).

        Args:
            x: (n,) a state, the position first [m].
            beyond: how much farther than the nearest piece the others may be [m].
        """
        packed, position = self.pieces.packed, (float(x[0]), float(x[1]))
        nearest_distance = max(0.0, _core.pieces_nearest(packed, 0, *position)[0])
        reach = min(nearest_distance + beyond, FARTHEST)
        indices = np.empty(len(self.pieces), dtype=np.int64)
        count = _core.pieces_near(packed, 0, *position, reach, indices)
        jets = np.empty((count, 3))  # h, ∂h/∂x and ∂h/∂y
        _core.pieces_jets(packed, indices[:count], *position, jets)
        jets = jets[np.lexsort(jets.T[::-1])]  # by h, then by the gradient
        return jets[:, 0], jets[:, 1:]

    def nearest(self, x: Array) -> tuple[float, Array]:
        """Return the signed distance from the nearest piece [m] and its gradient (2,)."""
        h, *gradient = _core.pieces_jet(self.pieces.packed, 0, float(x[0]), float(x[1]))
        return h, np.array(gradient)

    def jet(self, x: Array, t: float = 0.0) -> Jet:
        """Return h and its derivatives; the curvature around corners is left out."""
        n = len(x)
        h, normal = self.nearest(x)
        gradient = np.zeros(n)
        gradient[:2] = normal
        return Jet(h, gradient, np.zeros((n, n)), 0.0, np.zeros(n), 0.0)


@dataclass(frozen=True, eq=False)
class OnGrid(Mapped):
    """The base of classes that are cells of a grid.

    Args:
        grid: the grid of the map, which guidance reads.
        cells: (rows, columns) whether a cell of that grid belongs to the class, row 0 the lowest.
    """

    grid: Grid = field(kw_only=True)
    cells: Mask = field(kw_only=True, repr=False)

    def moved(self, step: Array) -> Self:
        """Return the same cells a step (2,) [m] away."""
        return replace(super().moved(step), grid=self.grid.moved(step))


@dataclass(frozen=True, eq=False)
class MappedRegion(OnGrid):
    """The outside of the cells of a class: h is the signed distance to the nearest piece.

    Args:
        beyond: whether everything outside the grid belongs to the class, and has pieces too.
    """

    beyond: bool = field(default=False, kw_only=True)


@dataclass(frozen=True, eq=False)
class SeenRegion(Mapped):
    """The outside of the obstacles in a scan. Guidance plans no path around them.

    Args:
        stamp: the time at which the scan was taken [s]; None is that of the first step with it.
        period: the age of the scan up to which its margin is enough [s].
        speed: the speed of the fastest obstacle [m/s].
    """

    stamp: float | None = None
    period: float = 0.0
    speed: float = 0.0

    def margin_at(self, age: float) -> float:
        """Return the margin of a scan of an age [s], which reserves motion since its stamp [m]."""
        return min(self.margin + self.speed * max(0.0, age - self.period), FARTHEST)


@dataclass(frozen=True, eq=False)
class MappedZone(OnGrid):
    """A speed limit inside the cells of a class, before which the robot brakes; see `speed_limit`.

    Args:
        limit: the greatest speed inside the cells [m/s], positive.
    """

    limit: float = field(kw_only=True)
    reads_position: ClassVar[bool] = False
    code: ClassVar[int] = layout.ZONES

    def __post_init__(self) -> None:
        super().__post_init__()
        set_positive(self, "limit")

    def write(self, c: Array, at: int) -> int:
        """Write the block of a class, and return its kind; see `Mapped.write`."""
        super().write(c, at)
        c[layout.V_MAX], c[layout.KEPT] = self.limit, self.margin
        return self.code

    def jet(self, x: Array, t: float = 0.0) -> Jet:
        """Return h and its derivatives; the curvature of the distance is left out."""
        n = len(x)
        distance, normal = self.nearest(x)
        away = max(0.0, distance - self.margin)
        gradient, hessian = np.zeros(n), np.zeros((n, n))
        if away > 0.0:  # inside a zone h does not depend on the position
            gradient[:2] = speed_limit.BRAKING / self.limit * normal
        gradient[2:4] = -x[2:4] / self.limit
        hessian[2:4, 2:4] = -np.eye(2) / self.limit
        h = _core.zone_value(self.limit, away, float(x[2]), float(x[3]))
        return Jet(h, gradient, hessian, 0.0, np.zeros(n), 0.0)


class Atlas:
    """The pieces of all maps in a set of scenes, one behind another in one array.

    The array has pieces once that several scenes share. Pieces that no scene holds any more are
    removed when the array is full.

    Args:
        before: an atlas that is not used any more. Its array is continued, so that a new scan
            beside a large map does not copy the map.

    Attributes:
        numbers: (L,) `Pieces.packed` of all pieces; None as long as there was no map.
        held: (scene, place) → the class of a map at that place.
    """

    def __init__(self, before: "Atlas | None" = None) -> None:
        self.numbers: Array | None = None
        # an empty predecessor is not kept, because it would keep its own predecessors alive
        self._before = before if before else None
        self.held: dict[tuple[int, int], Mapped] = {}
        self._begins: dict[Pieces, int] = {}  # by identity: a copied atlas has copied pieces
        self._end = 0  # of the numbers that are used

    def __bool__(self) -> bool:
        """Return whether a scene holds a class of a map."""
        return bool(self.held)

    def hold(self, place: tuple[int, int], barrier: Mapped, parameters: Array) -> None:
        """Put a class at (scene, place), and write its block into the parameters (N, m, WIDTH).

        If the array is replaced by a larger one, the blocks of all other classes are written, too.
        """
        if self._before is not None:
            before, self._before = self._before, None
            self.numbers, self._end = before.numbers, before._end
            self._begins = before._begins.copy()
        self.held[place] = barrier
        pieces = barrier.pieces
        if pieces not in self._begins:
            if self.numbers is None or self._end + pieces.packed.size > self.numbers.size:
                self._reallocate()
                for held_at, held in self.held.items():
                    held.write(parameters[held_at], self._begins[held.pieces])
                return
            self._append(self.numbers, pieces)
        barrier.write(parameters[place], self._begins[pieces])

    def of_scenes(self, new_index: dict[int, int]) -> "Atlas":
        """Return the atlas of some scenes, which shares the array and does not write to it.

        Args:
            new_index: the index of each of these scenes → its index in the new set.
        """
        chosen = Atlas()
        chosen.numbers = self.numbers
        if self.numbers is not None:
            chosen._end = self.numbers.size  # the array counts as full, as it is shared
        chosen.held = {
            (new_index[i], k): held for (i, k), held in self.held.items() if i in new_index
        }
        return chosen

    def _append(self, numbers: Array, pieces: Pieces) -> None:
        begin, self._end = self._end, self._end + pieces.packed.size
        numbers[begin : self._end] = pieces.packed
        self._begins[pieces] = begin

    def _reallocate(self) -> None:
        """Copy the pieces that scenes hold into a new array of twice their size."""
        distinct = dict.fromkeys(barrier.pieces for barrier in self.held.values())
        self.numbers = np.zeros(2 * sum(pieces.packed.size for pieces in distinct))
        self._begins, self._end = {}, 0
        for pieces in distinct:
            self._append(self.numbers, pieces)
