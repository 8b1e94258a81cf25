"""What a range sensor sees as strict pieces of its own: for people and boxes that are in no map."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.many import Several
from hcbf_gym.barriers.mapped import SeenRegion
from hcbf_gym.barriers.pieces import Pieces
from hcbf_gym.errors import InvalidInputError, as_array, finite_array, finite_float
from hcbf_gym.maps.cover import Cover
from hcbf_gym.models.constants import ON_EARTH
from hcbf_gym.models.grid import Grid

SIDE = 0.05
"""Of the cells into which points fall [m]: so many points as fall into one count once."""

REACH = 6.0
"""Beyond that from the sensor nothing is taken [m]: no robot here gets so far before the next."""


@dataclass(frozen=True, eq=False)
class Scan(Several):
    """The cells in which points lie, covered like a class of a map. Without a point it is free.

    Stands in a list of barriers as one strict condition. What is seen may have moved since: age
    times speed is reserved around it.

    Args:
        name: what infos and messages call it.
        points: (k, 2) in the sensor's axes [m]; those that are not finite were not measured.
        pose: x [m], y [m] and yaw [rad] of the sensor in the world, when it measured.
        age: how long ago that was [s].
        speed: of the fastest thing around [m/s]; 0 where nothing moves.
        rank: 1 is strict.
        margin: reserved around the cells in any case [m].

    Raises:
        InvalidInputError: if a number is not finite or out of range, or the points are no (k, 2).

    Examples:
        >>> seen = Scan.of_ranges("laser", [1.0, np.inf], [0.0, 0.1], (2.0, 0.0, np.pi / 2))
        >>> seen.conditions[0].h(np.array([2.0, 0.0, 0.0, 0.0])) <= 1.0
        True
    """

    name: str
    points: ArrayLike = field(repr=False)
    pose: tuple[float, float, float]
    age: float = 0.0
    speed: float = 0.0
    rank: int = 1
    margin: float = 0.0
    _pieces: tuple[Grid, Mask, Pieces] | None = field(default=None, repr=False)
    _seen: SeenRegion = field(init=False, repr=False)

    def __post_init__(self) -> None:
        x, y, yaw = finite_array(f"{self.name}: pose", self.pose, (3,), largest=ON_EARTH).tolist()
        object.__setattr__(self, "pose", (x, y, yaw))
        for name in ("age", "speed", "margin"):
            number = finite_float(f"{self.name}: {name}", getattr(self, name), minimum=0.0)
            object.__setattr__(self, name, number)
        if self._pieces is None:
            object.__setattr__(self, "_pieces", _covered(self.name, self.points, self.pose))
        assert self._pieces is not None
        grid, cells, pieces = self._pieces
        seen = SeenRegion(
            self.name, self.rank, pieces=pieces, grid=grid, cells=cells,
            margin=self.margin + self.age * self.speed,
        )  # fmt: skip
        object.__setattr__(self, "_seen", seen)

    @classmethod
    def of_ranges(
        cls,
        name: str,
        ranges: ArrayLike,
        angles: ArrayLike,
        pose: tuple[float, float, float],
        age: float = 0.0,
        speed: float = 0.0,
        rank: int = 1,
        margin: float = 0.0,
    ) -> Self:
        """Return a scan of beams.

        Args:
            name: what infos and messages call it.
            ranges: (k,) [m]; as ROS has it, +inf saw nothing, and −inf something nearer than can
                be measured, which is taken for the sensor's own place. NaN is a beam that failed.
            angles: (k,) of the beams in the sensor's axes [rad].
            pose: as the class takes it.
            age: likewise.
            speed: likewise.
            rank: likewise.
            margin: likewise.

        Raises:
            InvalidInputError: if there are not as many angles as ranges, or one is no number.
        """
        far = _numbers(f"{name}: ranges", ranges, 1)
        turn = finite_array(f"{name}: angles", angles, (far.size,))
        far = np.where(np.isneginf(far), 0.0, far)
        if (far < 0.0).any():
            raise InvalidInputError(f"{name}: ranges: got {far.min()} m, expected none below 0")
        seen = np.isfinite(far)
        points = far[seen, None] * np.column_stack([np.cos(turn), np.sin(turn)])[seen]
        return cls(name, points, pose, age, speed, rank, margin)

    def aged(self, age: float) -> Self:
        """Return the same scan at another age [s]: nothing is covered anew."""
        return replace(self, age=age)

    @property
    def conditions(self) -> tuple[Barrier, ...]:
        """The one barrier that it stands for."""
        return (self._seen,)


def _numbers(name: str, values: ArrayLike, axes: int) -> Array:
    """Return an array of numbers, finite or infinite.

    Raises:
        InvalidInputError: if it is none, of another number of axes, or has a NaN: what failed is
            not what saw nothing.
    """
    given = as_array(name, values)
    given = given.reshape((0, 2)[:axes]) if given.size == 0 else given
    if given.dtype.kind not in "fiu" or given.ndim != axes:
        raise InvalidInputError(f"{name}: got {values!r}, expected {axes} axes of real numbers")
    if np.isnan(given).any():
        raise InvalidInputError(
            f"{name}: got NaN, expected numbers, +inf where nothing is in sight"
        )
    return given.astype(np.float64)


def _covered(
    name: str, points: ArrayLike, pose: tuple[float, float, float]
) -> tuple[Grid, Mask, Pieces]:
    """Return the cells in which points lie, in a grid around the sensor, and what covers them.

    Raises:
        InvalidInputError: if the points are no (k, 2).
    """
    given = _numbers(f"{name}: points", points, 2)
    if given.shape[1] != 2:
        raise InvalidInputError(f"{name}: points: got shape {given.shape}, expected (k, 2)")
    near = given[np.isfinite(given).all(axis=1)]
    near = near[(np.abs(near) < REACH).all(axis=1)]
    count = int(np.ceil(2.0 * REACH / SIDE))
    grid = Grid(SIDE, _corner(pose), (count, count))
    cells = np.zeros(grid.shape, dtype=np.bool_)
    at = np.floor((near + REACH) / SIDE).astype(np.int64)
    at = np.minimum(at, count - 1)  # what rounding puts on the far edge
    cells[at[:, 1], at[:, 0]] = True
    cells.flags.writeable = False
    cover = Cover.of(cells)
    corners = grid.to_world(cover.grown().reshape(-1, 2)).reshape(-1, 8, 2)
    return grid, cells, Pieces(corners, cover.sizes, grid.origin)


def _corner(pose: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the origin of a grid that reaches as far from a pose to all sides."""
    x, y, yaw = pose
    cos, sin = np.cos(yaw), np.sin(yaw)
    return float(x - REACH * (cos - sin)), float(y - REACH * (sin + cos)), yaw
