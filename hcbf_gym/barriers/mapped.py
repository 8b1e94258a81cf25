"""Classes of a map as barriers, and the atlas that holds their pieces.

A class is all cells of one kind, covered by pieces. It is one barrier, and its h is the least of
all pieces. A filter makes a row for each piece within the braking horizon. `docs/rows.md` proves
that pieces beyond it need no row: with every input of U that is held for a period, h ≥ m and ψ ≥ 0
at its end.
"""

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import layout, speed_limit
from hcbf_gym.barriers.barrier import Barrier, Jet
from hcbf_gym.barriers.pieces import Pieces
from hcbf_gym.errors import finite_float
from hcbf_gym.models.constants import FARTHEST
from hcbf_gym.models.grid import Grid


@dataclass(frozen=True, eq=False)
class Mapped(Barrier):
    """The base of classes of a map and of scans, for filters of the planar double integrator.

    Two of them are equal only if they are the same object, as comparing all cells takes too long.

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
        """Write the block c (WIDTH,) of a class, and return its kind (see `layout`).

        `at` is the index in the atlas at which its pieces begin.
        """
        c[:] = 0.0
        c[layout.PIECES] = at
        return self.code

    def moved(self, step: Array) -> Self:
        """Return the same pieces a step (2,) [m] away."""
        return replace(self, pieces=self.pieces.moved(step))

    def near(self, x: Array, beyond: float) -> tuple[Array, Array]:
        """Return the pieces that are about as near as the nearest piece, nearest first.

        Args:
            x: (n,) a state, the position first [m].
            beyond: how much farther than the nearest the others may be [m].

        Returns:
            The signed distances (k,) [m], and their gradients (k, 2).
        """
        packed, position = self.pieces.packed, (float(x[0]), float(x[1]))
        reach = max(0.0, _core.pieces_nearest(packed, 0, *position)[0]) + beyond
        near = np.empty(len(self.pieces), dtype=np.int64)
        near = near[: _core.pieces_near(packed, 0, *position, min(reach, FARTHEST), near)]
        jets = np.empty((len(near), 3))  # h, ∂h/∂x and ∂h/∂y
        _core.pieces_jets(packed, near, *position, jets)
        jets = jets[np.lexsort(jets.T[::-1])]
        return jets[:, 0], jets[:, 1:]

    def nearest(self, x: Array) -> tuple[float, Array]:
        """Return the signed distance from the nearest piece [m] and its gradient (2,)."""
        h, gx, gy = _core.pieces_jet(self.pieces.packed, 0, float(x[0]), float(x[1]))
        return h, np.array([gx, gy])

    def jet(self, x: Array, t: float = 0.0) -> Jet:
        """Return h and its gradient; the Hessian is 0, also at corners."""
        n = len(x)
        h, normal = self.nearest(x)
        gradient = np.zeros(n)
        gradient[:2] = normal
        return Jet(h, gradient, np.zeros((n, n)), 0.0, np.zeros(n), 0.0)


@dataclass(frozen=True, eq=False)
class OnGrid(Mapped):
    """The base of classes that are cells of a grid.

    Args:
        grid: of the map, for guidance.
        cells: (rows, columns) which cells of that grid belong to the class, row 0 the lowest.
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
        beyond: whether all that is outside the grid belongs to the class, and has pieces too.
    """

    beyond: bool = field(default=False, kw_only=True)


@dataclass(frozen=True, eq=False)
class SeenRegion(Mapped):
    """The outside of what a scan shows at its stamp. Guidance plans no path around it.

    Args:
        stamp: when the scan was taken [s]; None counts from the first step that has it.
        period: the age up to which its margin is enough [s].
        speed: of the fastest thing around [m/s].
    """

    stamp: float | None = None
    period: float = 0.0
    speed: float = 0.0

    def margin_at(self, age: float) -> float:
        """Return the margin at an age [s] [m], which reserves what may have come since."""
        return min(self.margin + self.speed * max(0.0, age - self.period), FARTHEST)


@dataclass(frozen=True, eq=False)
class MappedZone(OnGrid):
    """A speed limit inside the cells of a class, before which the robot brakes; see `speed_limit`.

    Args:
        limit: of the speed inside [m/s], positive.
    """

    limit: float = field(kw_only=True)
    reads_position: ClassVar[bool] = False
    code: ClassVar[int] = layout.ZONES

    def __post_init__(self) -> None:
        super().__post_init__()
        limit = finite_float(
            f"{self.name}: limit", self.limit, minimum=0.0, maximum=FARTHEST, exclusive=True
        )
        object.__setattr__(self, "limit", limit)

    def write(self, c: Array, at: int) -> int:
        """Write the block c (WIDTH,) of pieces that begin at `at` in the atlas; return the kind."""
        super().write(c, at)
        c[layout.V_MAX], c[layout.KEPT] = self.limit, self.margin
        return self.code

    def jet(self, x: Array, t: float = 0.0) -> Jet:
        """Return h and its derivatives; the curvature of the distance is left out."""
        n = len(x)
        distance, normal = self.nearest(x)
        away = max(0.0, distance - self.margin)
        gradient, hessian = np.zeros(n), np.zeros((n, n))
        gradient[:2] = speed_limit.BRAKING / self.limit * normal * (away > 0.0)
        gradient[2:4] = -x[2:4] / self.limit
        hessian[2:4, 2:4] = -np.eye(2) / self.limit
        h = _core.zone_value(self.limit, away, float(x[2]), float(x[3]))
        return Jet(h, gradient, hessian, 0.0, np.zeros(n), 0.0)


class Atlas:
    """The pieces of all maps in a set of scenes, one behind another in one array.

    Pieces that several scenes share are there once. Pieces that no scene holds any more are removed
    when the array is full.

    Args:
        before: an atlas that is not used any more, whose array is continued, so that a new scan
            beside a large map does not copy the map.

    Attributes:
        numbers: (L,) `Pieces.packed` of all pieces; None as long as there was no map.
        held: (scene, place) → the class of a map that is there.
    """

    def __init__(self, before: "Atlas | None" = None) -> None:
        self.numbers: Array | None = None
        self._before = (
            before if before else None
        )  # an empty one would keep its own predecessors alive
        self.held: dict[tuple[int, int], Mapped] = {}
        self._begins: dict[Pieces, int] = {}  # by identity: a copied atlas has copied pieces
        self._end = 0

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
                for other, one in self.held.items():
                    one.write(parameters[other], self._begins[one.pieces])
                return
            self._append(self.numbers, pieces)
        barrier.write(parameters[place], self._begins[pieces])

    def of(self, places: dict[int, int]) -> "Atlas":
        """Return the atlas of some scenes, which shares the array and does not write to it.

        Args:
            places: index of each scene → its index in the new set.
        """
        chosen = Atlas()
        chosen.numbers = self.numbers
        chosen._end = (
            0 if self.numbers is None else self.numbers.size
        )  # full, so that more pieces need a new array
        chosen.held = {(places[i], k): one for (i, k), one in self.held.items() if i in places}
        return chosen

    def _append(self, numbers: Array, pieces: Pieces) -> None:
        begin, self._end = self._end, self._end + pieces.packed.size
        numbers[begin : self._end] = pieces.packed
        self._begins[pieces] = begin

    def _reallocate(self) -> None:
        """Copy the pieces that scenes hold into a new array of twice their size."""
        alive = dict.fromkeys(one.pieces for one in self.held.values())
        self.numbers = np.zeros(2 * sum(pieces.packed.size for pieces in alive))
        self._begins, self._end = {}, 0
        for pieces in alive:
            self._append(self.numbers, pieces)
