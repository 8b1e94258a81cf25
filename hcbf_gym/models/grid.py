"""Square cells in the plane: the grid of a map."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, finite_array, finite_float, reals, shown
from hcbf_gym.models.constants import ON_EARTH

LARGEST = 25_000_000
"""The greatest number of cells of a map: a building of 250 m at 5 cm."""
FINEST, COARSEST = 1e-3, 100.0
"""The smallest and the largest side of a cell [m]."""


@dataclass(frozen=True)
class Grid:
    """Square cells in the plane, ``p = origin + R(yaw) · resolution · (column, row)``.

    Row 0 is the lowest one: rows run up the grid's own y axis. Cell (r, c) covers
    [c, c + 1) × [r, r + 1).

    Args:
        resolution: side of a cell [m].
        origin: pose of the lower left corner of cell (0, 0): x [m], y [m] and yaw [rad].
        shape: rows and columns.

    Raises:
        InvalidInputError: if a number is not finite or out of range, or there are no or too many
            cells.
    """

    resolution: float
    origin: tuple[float, float, float]
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        side = finite_float("map: resolution", self.resolution, minimum=FINEST, maximum=COARSEST)
        origin = finite_array("map: origin", self.origin, (3,), largest=ON_EARTH)
        object.__setattr__(self, "resolution", side)
        object.__setattr__(self, "origin", tuple(origin.tolist()))
        object.__setattr__(self, "shape", checked_shape(self.shape))

    def moved(self, step: Array) -> "Grid":
        """Return the same cells a step (2,) [m] away."""
        x, y, yaw = self.origin
        return replace(self, origin=(x + float(step[0]), y + float(step[1]), yaw))

    @cached_property
    def axes(self) -> Array:
        """The grid's own x and y axes in the world, the columns of (2, 2)."""
        cos, sin = np.cos(self.origin[2]), np.sin(self.origin[2])
        return np.array([[cos, -sin], [sin, cos]])

    def to_cells(self, points: ArrayLike) -> Array:
        """Return (N, 2) fractional column and row of points (N, 2) [m]."""
        points = _pairs("points", points)
        return (points - self.origin[:2]) @ self.axes / self.resolution

    def to_world(self, cells: ArrayLike) -> Array:
        """Return (N, 2) points [m] of fractional columns and rows (N, 2)."""
        cells = _pairs("cells", cells)
        return self.origin[:2] + (self.resolution * cells) @ self.axes.T

    @cached_property
    def corners(self) -> Array:
        """The corners (4, 2) of the whole grid, counter-clockwise [m]."""
        rows, columns = self.shape
        return self.to_world([[0, 0], [columns, 0], [columns, rows], [0, rows]])


def _pairs(name: str, values: ArrayLike) -> Array:
    """Return real numbers of the shape (…, 2); refuse other shapes."""
    pairs = reals(name, values)
    if pairs.shape[-1:] != (2,):
        raise InvalidInputError(f"{name}: got shape {pairs.shape}, expected (N, 2)")
    return pairs


def checked_shape(shape: object) -> tuple[int, int]:
    """Return the numbers of rows and columns of a map.

    Raises:
        InvalidInputError: if these are not two positive integers, or there are too many cells.
    """
    numbers = tuple(shape) if isinstance(shape, tuple | list) else ()
    if len(numbers) != 2 or any(
        isinstance(n, bool) or not isinstance(n, int | np.integer) or n < 1 for n in numbers
    ):
        raise InvalidInputError(f"map: shape: got {shown(shape)}, expected two positive integers")
    rows, columns = map(int, numbers)
    if rows * columns > LARGEST:
        raise InvalidInputError(
            f"map: got {rows} x {columns} cells, expected at most {LARGEST}: "
            "crop the map or take larger cells"
        )
    return rows, columns
