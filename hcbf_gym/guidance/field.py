"""The fields of scenes: what a march from the goal leaves in a grid.

A field is stored flat, row by row. Its geometry (7,) says where: x and y of the first cell's
centre, side of a cell [m], ny, nx, and cos and sin of the angle by which the grid is turned.
"""

from typing import TypeVar

import numpy as np

from hcbf_gym.arrays import Array, Field, Ranks
from hcbf_gym.compilation import kernel
from hcbf_gym.guidance.ground import Ground
from hcbf_gym.guidance.march import Cells, is_open, march

Number = TypeVar("Number", float, Array)
Kept = TypeVar("Kept", Field, Ranks)


@kernel(error_model="numpy")
def grid(values: Kept, geometry: Array) -> Kept:
    """Return the (ny, nx) view of one scene's flat values."""
    ny, nx = int(geometry[3]), int(geometry[4])
    return values[: ny * nx].reshape(ny, nx)


@kernel(error_model="numpy")
def to_cells(x: float, y: float, geometry: Array) -> tuple[float, float]:
    """Return row and column of a point, whole numbers at the cells' centres."""
    away_x, away_y = x - geometry[0], y - geometry[1]
    cos, sin = geometry[5], geometry[6]
    return (cos * away_y - sin * away_x) / geometry[2], (cos * away_x + sin * away_y) / geometry[2]


@kernel(error_model="numpy")
def to_world(row: Number, column: Number, geometry: Array) -> tuple[Number, Number]:
    """Return the point of a row and a column, or those of many; see `to_cells`."""
    along, up = column * geometry[2], row * geometry[2]
    cos, sin = geometry[5], geometry[6]
    return geometry[0] + cos * along - sin * up, geometry[1] + sin * along + cos * up


@kernel(error_model="numpy")
def cell_of(x: float, y: float, geometry: Array) -> tuple[int, int]:
    """Return row and column of the cell nearest a point."""
    row, column = to_cells(x, y, geometry)
    j = min(max(row, 0.0), geometry[3] - 1.0)
    i = min(max(column, 0.0), geometry[4] - 1.0)
    return round(j), round(i)


@kernel(error_model="numpy")
def solve(
    ground: Ground, geometry: Array, goal: Array, opened: int, field: Field, through: Ranks
) -> None:
    """Write the field of a painted ground.

    Args:
        ground: with its border.
        geometry: (7,) of the grid.
        goal: (2,) [m].
        opened: as `ground.paint_barriers` takes it.
        field: (capacity,) T, of which the first ny·nx entries are written.
        through: (capacity,) through which rank the goal is reached: 0 none, 1 not at all.
    """
    rows, nx = ground.cost.shape
    arrival, ranks = np.empty(rows * nx, dtype=np.float32), np.empty(rows * nx, dtype=np.int8)
    cells = Cells(ground.cost.ravel(), ground.rank.ravel(), nx, arrival, ranks)
    j, i = cell_of(goal[0], goal[1], geometry)
    march(cells, geometry[2], opened, (j + 1) * nx + i + 1)
    for j in range(rows - 2):
        here, there = j * (nx - 2), (j + 1) * nx + 1
        for i in range(nx - 2):
            field[here + i] = arrival[there + i]
            through[here + i] = ranks[there + i]


@kernel(error_model="numpy")
def crossing(rank: Ranks, view: Field, j: int, i: int, opened: int) -> tuple[int, int, int]:
    """Return rank, row and column of the first closed region that the path from a cell enters.

    What the path begins in counts only where it leads on into a higher rank; rank 0 is no region.

    Args:
        rank: (ny + 2, nx + 2) of the ground.
        view: (ny, nx) T.
        j: row of the first cell.
        i: its column.
        opened: ranks from it on may be crossed, 0 for none.
    """
    ny, nx = view.shape
    within = rank[j + 1, i + 1]
    while view[j, i] > 0.0:
        low_j, low_i = j, i
        for dj, di in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            y, x = j + dj, i + di
            if 0 <= y < ny and 0 <= x < nx and view[y, x] < view[low_j, low_i]:
                low_j, low_i = y, x
        if low_j == j and low_i == i:
            return 1, j, i
        j, i = low_j, low_i
        here = rank[j + 1, i + 1]
        if not is_open(here, opened) and not 0 < within <= here:
            return here, j, i
        within = 0 if within == 0 or here == 0 else here
    return 0, j, i
