"""The geodesic field of a scene: the cost of the cheapest way to the goal, from every cell.

On a grid of square cells the field T solves the eikonal equation ``‖∇T‖ = c(p)``, ``T(goal) = 0``,
by fast marching. A cell costs `RANK_COST` inside a region, most where the rank is highest, and 1
in the open, a little more close to an edge: so the way stays out of regions as their ranks ask,
leads out of one by the cheapest side, and leaves some distance where there is room.

Source: J. A. Sethian, A fast marching level set method for monotonically advancing fronts,
PNAS 93, 1996.
"""

import heapq
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.barriers import kernels

Array = NDArray[np.float64]
Field = NDArray[np.float32]
Integers = NDArray[np.int64]
Ranks = NDArray[np.int8]

RANK_COST = np.array([1e4, 1e3, 1e2, 1e1])
"""What a metre inside a region of rank 1, 2, 3 or lower costs, against 1 in the open."""
HALO = 0.4
"""Up to this distance from an edge a cell costs more than in the open [m]."""
HALO_COST = 20.0
"""By how much, at the edge itself; it falls with the fourth power, so that slits are avoided."""


@njit(cache=True)
def paint(h: Array, priority: int, clearance: float, cost: Array, rank: Ranks) -> None:
    """Raise the cost of the cells inside one barrier's region, and of those beside it.

    Args:
        h: (ny, nx) the barrier's values at the cells [m].
        priority: 1 is strict.
        clearance: what counts as inside: h below it [m].
        cost: (ny, nx) c, at least 1.
        rank: (ny, nx) the highest rank among the regions that a cell lies in, 0 in the open.
    """
    inside = RANK_COST[min(priority, RANK_COST.size) - 1]
    for j in range(h.shape[0]):
        for i in range(h.shape[1]):
            free = h[j, i] - clearance
            if free < 0.0:
                cost[j, i] = max(cost[j, i], inside)
                if rank[j, i] == 0 or priority < rank[j, i]:
                    rank[j, i] = priority
            elif free < HALO:
                near = 1.0 - free / HALO
                cost[j, i] = max(cost[j, i], 1.0 + HALO_COST * near**4)


@njit(cache=True, error_model="numpy")
def grid(values: Any, geometry: Array) -> Any:
    """Return the (ny, nx) view of one scene's flat values; `geometry` ends with ny and nx."""
    ny, nx = int(geometry[3]), int(geometry[4])
    return values[: ny * nx].reshape(ny, nx)


@njit(cache=True)
def sample(kind: int, c: Array, t: float, geometry: Array, h: Array) -> None:
    """Write h (ny, nx) of one built-in planar barrier at the cells of a grid."""
    cell = geometry[2]
    for j in range(h.shape[0]):
        y = geometry[1] + j * cell
        for i in range(h.shape[1]):
            h[j, i] = kernels.height(kind, c, geometry[0] + i * cell, y, t)


@njit(cache=True)
def march(cost: Array, start_j: int, start_i: int, cell: float, field: Field) -> None:
    """Write T (ny, nx) of the costs, zero at the cell of the goal."""
    ny, nx = cost.shape
    known = np.zeros((ny, nx), dtype=np.bool_)
    field[:] = np.inf
    field[start_j, start_i] = 0.0
    heap = [(0.0, start_j * nx + start_i)]
    while len(heap) > 0:
        _, index = heapq.heappop(heap)
        j = index // nx
        i = index % nx
        if known[j, i]:
            continue
        known[j, i] = True
        for dj, di in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            y, x = j + dj, i + di
            if y < 0 or y >= ny or x < 0 or x >= nx or known[y, x]:
                continue
            along_x, along_y = np.inf, np.inf  # the smaller neighbour's T on either axis
            if x > 0:
                along_x = min(along_x, field[y, x - 1])
            if x < nx - 1:
                along_x = min(along_x, field[y, x + 1])
            if y > 0:
                along_y = min(along_y, field[y - 1, x])
            if y < ny - 1:
                along_y = min(along_y, field[y + 1, x])
            step = cost[y, x] * cell
            difference = abs(along_x - along_y)
            if difference >= step:
                arrival = min(along_x, along_y) + step
            else:
                root = np.sqrt(2.0 * step * step - difference * difference)
                arrival = 0.5 * (along_x + along_y + root)
            if arrival < field[y, x]:
                field[y, x] = arrival
                heapq.heappush(heap, (float(arrival), y * nx + x))


@njit(cache=True)
def flood(rank: Ranks, start_j: int, start_i: int, through: Ranks) -> None:
    """Write through which rank the goal can be reached at best: 0 through none, 1 the worst.

    Of all ways from a cell to the goal, over the four neighbours of each, the best is the one
    whose highest rank is the lowest.

    Args:
        rank: (ny, nx) what `paint` wrote.
        start_j: row of the goal's cell.
        start_i: its column.
        through: (ny, nx) highest rank on the best way, both ends included.
    """
    ny, nx = rank.shape
    lowest = rank.max()
    reached = np.zeros((ny, nx), dtype=np.bool_)
    stack = np.empty(ny * nx, dtype=np.int64)
    for stage in range(lowest + 1):  # the open first, then ranks lowest, …, 2, 1
        level = 0 if stage == 0 else lowest + 1 - stage
        top = 0
        for j in range(ny):
            for i in range(nx):
                if not reached[j, i] and _enters(rank[j, i], level):
                    beside = (
                        (j == start_j and i == start_i)
                        or (i > 0 and reached[j, i - 1])
                        or (i < nx - 1 and reached[j, i + 1])
                        or (j > 0 and reached[j - 1, i])
                        or (j < ny - 1 and reached[j + 1, i])
                    )
                    if beside:
                        reached[j, i] = True
                        through[j, i] = level
                        stack[top] = j * nx + i
                        top += 1
        while top > 0:
            top -= 1
            j = stack[top] // nx
            i = stack[top] % nx
            for dj, di in ((0, 1), (0, -1), (1, 0), (-1, 0)):
                y, x = j + dj, i + di
                if y < 0 or y >= ny or x < 0 or x >= nx or reached[y, x]:
                    continue
                if _enters(rank[y, x], level):
                    reached[y, x] = True
                    through[y, x] = level
                    stack[top] = y * nx + x
                    top += 1


@njit(cache=True)
def look_past_strict(rank: Ranks, field: Field, through: Ranks) -> None:
    """Write, for the cells of rank 1, what holds where the field leads out of it.

    A robot that presses against a strict edge stands within its clearance, and often in a cell
    whose centre lies inside. It is to be told of the way that it has from there.
    """
    ny, nx = rank.shape
    for j in range(ny):
        for i in range(nx):
            y, x = j, i
            while rank[y, x] == 1 and field[y, x] > 0.0:
                low_y, low_x = y, x
                for dj, di in ((0, 1), (0, -1), (1, 0), (-1, 0)):
                    near_y, near_x = y + dj, x + di
                    if (
                        0 <= near_y < ny
                        and 0 <= near_x < nx
                        and field[near_y, near_x] < field[low_y, low_x]
                    ):
                        low_y, low_x = near_y, near_x
                if low_y == y and low_x == x:
                    break
                y, x = low_y, low_x
            through[j, i] = through[y, x]


@njit(cache=True)
def _enters(rank: Any, level: int) -> bool:
    """Tell whether a cell of this rank may be entered where `level` is the highest one allowed."""
    return rank == 0 or (level > 0 and rank >= level)


@njit(cache=True, error_model="numpy")
def cell_of(x: float, y: float, geometry: Array) -> tuple[int, int]:
    """Return row and column of the cell nearest a point."""
    ny, nx = int(geometry[3]), int(geometry[4])
    j = round((y - geometry[1]) / geometry[2])
    i = round((x - geometry[0]) / geometry[2])
    return min(max(j, 0), ny - 1), min(max(i, 0), nx - 1)


@njit(cache=True)
def solve(
    kind: Integers,
    parameters: Array,
    priority: Integers,
    clearance: Array,
    t: float,
    goal: Array,
    geometry: Array,
    field: Field,
    through: Ranks,
) -> None:
    """Write the field of one scene of built-in barriers as they stand at time t.

    Args:
        kind: (m,) as in `BarrierSet`; speed limits are passed over.
        parameters: (m, 19) as in `BarrierSet`.
        priority: (m,) 1 is strict.
        clearance: (m,) what each edge reserves: margin, body radius [m].
        t: time [s].
        goal: (2,) [m].
        geometry: (5,) x and y of the first cell's centre, side of a cell [m], ny, nx.
        field: (capacity,) T, of which the first ny·nx entries are used.
        through: (capacity,) what `flood` writes.
    """
    ny, nx = int(geometry[3]), int(geometry[4])
    h, cost = np.empty((ny, nx)), np.ones((ny, nx))
    rank = np.zeros((ny, nx), dtype=np.int8)
    for k in range(kind.size):
        if kernels.is_region(kind[k]):
            sample(kind[k], parameters[k], t, geometry, h)
            paint(h, priority[k], clearance[k], cost, rank)
    j, i = cell_of(goal[0], goal[1], geometry)
    march(cost, j, i, geometry[2], grid(field, geometry))
    flood(rank, j, i, grid(through, geometry))
    look_past_strict(rank, grid(field, geometry), grid(through, geometry))


@njit(cache=True)
def solve_batch(
    mask: NDArray[np.bool_],
    kind: Integers,
    parameters: Array,
    priority: Integers,
    clearance: Array,
    t: Array,
    goal: Array,
    geometry: Array,
    field: Field,
    through: Ranks,
) -> None:
    """Write the fields of the masked (N,) scenes; each array as in `solve` with a leading N."""
    for n in range(mask.size):
        if mask[n]:
            solve(
                kind[n], parameters[n], priority[n], clearance[n], t[n], goal[n], geometry[n],
                field[n], through[n],
            )  # fmt: skip
