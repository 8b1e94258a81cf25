"""What a field walks on: cells of a grid, what each costs, and the highest rank that it lies in.

A metre costs 1 in the open, a little more close to an edge, so that the path leaves some distance
where there is room, and far more in a region, so that it leads out by a short path. A cell of a map
lies in a region where its centre is nearer to the occupied squares than the clearance: the body's
radius and what the edges reserve.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Field, Integers, Mask, Ranks
from hcbf_gym.barriers import kernels, layout, shapes
from hcbf_gym.barriers.shapes import half_plane
from hcbf_gym.compilation import kernel
from hcbf_gym.guidance.march import is_open

CLOSED_COST = 100.0
"""What a metre costs inside a region through which no path leads: out of it by a short one."""
RANK_COST = np.array([1e3, 1e3, 1e2, 1e1])
"""What a metre costs inside a region of rank 1, 2, 3 or lower that may be crossed."""
HALO = 0.4
"""Up to this distance from an edge a cell costs more than in the open [m]."""
HALO_COST = 20.0
"""By how much, at the edge itself; it falls with the fourth power, so that slits are avoided."""


class Ground(NamedTuple):
    """Cells with a border around them that no path enters.

    Attributes:
        cost: (ny + 2, nx + 2) what a step through a cell costs, infinite on the border.
        rank: (ny + 2, nx + 2) the highest rank among the regions that a cell lies in, 0 in none.
    """

    cost: Field
    rank: Ranks


@kernel(error_model="numpy")
def open_ground(ny: int, nx: int, side: float) -> Ground:
    """Return ground without regions, of cells with that side [m]."""
    ground = Ground(
        np.full((ny + 2, nx + 2), np.inf, dtype=np.float32),
        np.zeros((ny + 2, nx + 2), dtype=np.int8),
    )
    ground.cost[1:-1, 1:-1] = side
    return ground


@kernel(inline="always", error_model="numpy")
def _paint(
    ground: Ground, j: int, i: int, free: float, priority: int, opened: int, side: float
) -> None:
    """Raise cost and rank of one cell, whose centre is so far outside a region [m]."""
    if free < 0.0:
        metre = CLOSED_COST
        if is_open(priority, opened):
            metre = RANK_COST[min(priority, RANK_COST.size) - 1]
        ground.cost[j, i] = max(ground.cost[j, i], metre * side)
        if ground.rank[j, i] == 0 or priority < ground.rank[j, i]:
            ground.rank[j, i] = priority
    elif free < HALO:
        near = 1.0 - free / HALO
        ground.cost[j, i] = max(ground.cost[j, i], (1.0 + HALO_COST * near**4) * side)


@kernel(error_model="numpy")
def _paint_barrier(
    ground: Ground,
    geometry: Array,
    kind: int,
    parameters: Array,
    t: float,
    priority: int,
    clearance: float,
    opened: int,
) -> None:
    """Paint the region of one barrier; see `paint_barriers`, of which this takes one entry each."""
    side, ny, nx = geometry[2], int(geometry[3]), int(geometry[4])
    cos, sin = geometry[5], geometry[6]
    first_j, end_j, first_i, end_i = 0, ny, 0, nx
    if kind != half_plane.CODE:
        low_x, low_y, high_x, high_y = shapes.bounds(kind, parameters)
        x = 0.5 * (low_x + high_x) + parameters[layout.VELOCITY_X] * t - geometry[0]
        y = 0.5 * (low_y + high_y) + parameters[layout.VELOCITY_Y] * t - geometry[1]
        reach = 0.5 * np.hypot(high_x - low_x, high_y - low_y) + 2.0 * (clearance + HALO)
        j, i = (cos * y - sin * x) / side, (cos * x + sin * y) / side
        cells = reach / side + 1.0
        first_j, end_j = max(0, int(j - cells)), min(ny, int(j + cells) + 1)
        first_i, end_i = max(0, int(i - cells)), min(nx, int(i + cells) + 1)
    for j in range(first_j, end_j):
        for i in range(first_i, end_i):
            x = geometry[0] + side * (cos * i - sin * j)
            y = geometry[1] + side * (sin * i + cos * j)
            h = kernels.height(kind, parameters, x, y, t)
            _paint(ground, j + 1, i + 1, h - clearance, priority, opened, side)


@kernel(error_model="numpy")
def paint_barriers(
    ground: Ground,
    geometry: Array,
    kind: Integers,
    parameters: Array,
    priority: Integers,
    clearance: Array,
    t: float,
    opened: int,
) -> None:
    """Paint the regions of one scene's built-in barriers as they stand at time t.

    Args:
        ground: written to.
        geometry: (7,) of its grid, see `guidance.field`.
        kind: (m,) as in `BarrierSet`; speed limits are passed over.
        parameters: (m, 19) as in `BarrierSet`.
        priority: (m,) 1 is strict.
        clearance: (m,) what counts as inside, h below it: margin, body radius [m].
        t: time [s].
        opened: ranks from it on may be crossed at their price, above 1; 0 for none.
    """
    for k in range(kind.size):
        if kernels.is_region(kind[k]):
            _paint_barrier(
                ground, geometry, kind[k], parameters[k], t, priority[k], clearance[k], opened
            )


@kernel(error_model="numpy")
def distances(cells: Mask, reach: int) -> Field:
    """Return (ny, nx) exact distances of the cells' centres from the nearest occupied square.

    In sides of a cell; infinite beyond `reach` of them along either axis. With n(j, i) the cells
    to the nearest occupied one of the same column, and e(n) = max(0, n − ½),

        d² = min over |k| ≤ reach of e(|k|)² + e(n(j, i + k))².

    Args:
        cells: (ny, nx) the occupied ones.
        reach: how far to look.
    """
    ny, nx = cells.shape
    squared = np.empty((ny, nx), dtype=np.float32)
    count = np.full(nx, reach + 1, dtype=np.int64)
    for j in range(ny):
        for i in range(nx):
            count[i] = 0 if cells[j, i] else min(count[i] + 1, reach + 1)
            squared[j, i] = count[i]
    count[:] = reach + 1
    for j in range(ny - 1, -1, -1):
        for i in range(nx):
            count[i] = 0 if cells[j, i] else min(count[i] + 1, reach + 1)
            n = min(np.float32(count[i]), squared[j, i])
            e = max(np.float32(0.0), n - np.float32(0.5))
            squared[j, i] = np.float32(np.inf) if n > reach else e * e
    least = squared.copy()
    for j in range(ny):
        for k in range(1, min(reach, nx - 1) + 1):
            e = np.float32((k - 0.5) ** 2)
            for i in range(nx - k):
                least[j, i] = min(least[j, i], squared[j, i + k] + e)
            for i in range(k, nx):
                least[j, i] = min(least[j, i], squared[j, i - k] + e)
    return np.sqrt(least)


@kernel(error_model="numpy")
def paint_cells(
    ground: Ground,
    window: tuple[int, int, int, int],
    cells: Mask,
    side: float,
    priority: int,
    clearance: float,
    opened: int,
) -> None:
    """Paint what occupied cells of one rank make of a window of the ground.

    Args:
        ground: written to.
        window: of the ground, without its border: rows from and to, columns from and to.
        cells: (ny + 2, nx + 2) the occupied ones; the border is what lies around the grid.
        side: of a cell [m].
        priority: 1 is strict.
        clearance: what counts as inside, around their squares [m].
        opened: ranks from it on may be crossed, 0 for none.
    """
    reach = int((clearance + HALO) / side + 0.5) + 1
    first_j, first_i = max(0, window[0] - reach), max(0, window[2] - reach)
    seen = cells[first_j : window[1] + reach, first_i : window[3] + reach]
    apart = distances(seen, reach)
    for j in range(window[0], window[1]):
        for i in range(window[2], window[3]):
            free = side * apart[j - first_j, i - first_i] - clearance
            if free < HALO:
                _paint(ground, j, i, free, priority, opened, side)
