"""The geodesic field on a grid: what the cheapest way from every cell to the goal costs.

The field T solves the eikonal equation ``‖∇T‖ = c``, ``T(goal) = 0``, by upwind differences,

    Σ_axes max(0, T − T_axis)² = (c · side)²,     T_axis the lower neighbour's on that axis.

Cells settle in stages: first the open ones and those of ranks that may be crossed at their price;
then, of all that is left, the lowest rank, and so on up to rank 1. A stage begins at a toll above
all that is settled. So no closed rank lies on a way where one without it exists, however long that
is, and from within a closed region the field leads out, through strict cells only where nothing
else is left.

Cells wait in buckets of equal T, and one whose T falls is looked at again. So the order is a
matter of speed alone, the result solves the equations whatever is known at the beginning, and a
window of cells that changes is repaired from the cells that do not depend on it.

Source: J. A. Sethian, A fast marching level set method for monotonically advancing fronts,
PNAS 93, 1996; L. Yatziv, A. Bartesaghi, G. Sapiro, O(N) implementation of the fast marching
algorithm, Journal of Computational Physics 212, 2006.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.arrays import Mask

Cost = NDArray[np.float32]
Field = NDArray[np.float32]
Ranks = NDArray[np.int8]
Places = NDArray[np.int32]

BUCKETS = 1 << 15
"""So many lists of waiting cells, in a ring."""
SPARE = 4.0
"""A stage begins so many times above what is settled: repairs that lengthen ways fit below."""

RING = BUCKETS - 1
NOWHERE = -1


class Queue(NamedTuple):
    """Cells that wait, in lists of about equal T.

    Attributes:
        first: (BUCKETS,) the first cell of each list.
        after: (cells,) the next one in its list.
        before: (cells,) the one before, −2 − list for the first.
        waiting: (cells,) whether a cell is in a list.
    """

    first: Places
    after: Places
    before: Places
    waiting: Mask


@njit(cache=True, error_model="numpy")
def _make_queue(cells: int) -> Queue:
    """Return an empty queue."""
    return Queue(
        np.full(BUCKETS, NOWHERE, dtype=np.int32),
        np.empty(cells, dtype=np.int32),
        np.empty(cells, dtype=np.int32),
        np.zeros(cells, dtype=np.bool_),
    )


@njit(cache=True, inline="always", error_model="numpy")
def _take(queue: Queue, cell: int) -> None:
    """Take a cell out of its list."""
    before, after = queue.before[cell], queue.after[cell]
    if before < NOWHERE:
        queue.first[-2 - before] = after
    else:
        queue.after[before] = after
    if after != NOWHERE:
        queue.before[after] = before
    queue.waiting[cell] = False


@njit(cache=True, inline="always", error_model="numpy")
def _put(queue: Queue, cell: int, bucket: int) -> None:
    """Put a cell into a list, out of the one that it may be in."""
    if queue.waiting[cell]:
        _take(queue, cell)
    head = queue.first[bucket]
    queue.first[bucket] = cell
    queue.after[cell] = head
    queue.before[cell] = -2 - bucket
    if head != NOWHERE:
        queue.before[head] = cell
    queue.waiting[cell] = True


@njit(cache=True, inline="always", error_model="numpy")
def is_open(rank: int, level: int) -> bool:
    """Tell whether a cell of this rank may be entered where ranks from `level` on may; 0: none."""
    return rank == 0 or (level > 0 and rank >= level)


@njit(cache=True, inline="always", error_model="numpy")
def _worst(rank: int, other: int) -> int:
    """Return the higher of two ranks, 0 where both are none."""
    if rank == 0 or other == 0:
        return max(rank, other)
    return min(rank, other)


@njit(cache=True, inline="always", error_model="numpy")
def _lower(field: Field, level: int, toll: float, one: int, other: int) -> tuple[float, int]:
    """Return the lower T of two neighbours and which; what settled in stages before pays toll.

    Out of rank 1 all ways are alike: the shortest is the one, however dear it is from there on.
    """
    t, u = field[one], field[other]
    if t <= toll:
        t = toll + t * (level != 1)
    if u <= toll:
        u = toll + u * (level != 1)
    return (t, one) if t <= u else (u, other)


@njit(cache=True, inline="always", error_model="numpy")
def _arrive(
    field: Field, nx: int, level: int, toll: float, step: float, cell: int
) -> tuple[float, int]:
    """Return T of a cell by the upwind equation, and the neighbour that it comes from."""
    along_x, side_x = _lower(field, level, toll, cell - 1, cell + 1)
    along_y, side_y = _lower(field, level, toll, cell - nx, cell + nx)
    apart = along_x - along_y
    if apart < 0.0:
        apart, least, source = -apart, along_x, side_x
    else:
        least, source = along_y, side_y
    if not apart < step:  # the other axis says nothing, or both are infinite
        return least + step, source
    return 0.5 * (along_x + along_y + np.sqrt(2.0 * step * step - apart * apart)), source


@njit(cache=True, inline="always", error_model="numpy")
def _way(rank: Ranks, through: Ranks, cell: int, source: int) -> int:
    """Return through which rank the goal is reached from a cell by way of a neighbour.

    A robot that presses against a strict edge stands within its clearance, and often in a cell of
    rank 1. It is told of the way that it has from there; what leads *into* rank 1 is no way.
    """
    if rank[cell] == 1:
        return through[source]
    if rank[source] == 1:
        return 1
    return _worst(rank[cell], through[source])


@njit(cache=True, error_model="numpy")
def _begin(
    cost: Cost,
    rank: Ranks,
    nx: int,
    level: int,
    toll: float,
    ceiling: float,
    queue: Queue,
    field: Field,
    through: Ranks,
) -> tuple[int, float]:
    """Put what a stage can settle from what is known into the queue; return how many, and width.

    A bucket is as wide as the cheapest step, so that about equal T wait together.

    Args: as `_relax`; from `ceiling` on T is of later stages, of which nothing follows here.
    """
    found = np.empty(field.size, dtype=np.int32)
    arrivals = np.empty(field.size, dtype=np.float32)
    sources = np.empty(field.size, dtype=np.int32)
    count = 0
    lowest, highest, cheapest, dearest = np.inf, 0.0, np.inf, 0.0
    for cell in range(nx + 1, field.size - nx - 1):
        here = field[cell]
        if here <= toll or not cost[cell] < np.inf or not is_open(rank[cell], level):
            continue
        cheapest, dearest = min(cheapest, cost[cell]), max(dearest, cost[cell])
        arrival, source = _arrive(field, nx, level, toll, cost[cell], cell)
        if np.float32(arrival) < here and arrival <= ceiling:
            lowest, highest = min(lowest, arrival), max(highest, arrival)
            found[count], arrivals[count], sources[count] = cell, arrival, source
            count += 1
    width = max(cheapest, (highest - lowest + 2.0 * dearest) / (BUCKETS - 2))
    for k in range(count):
        cell = found[k]
        through[cell] = _way(rank, through, cell, sources[k])
        field[cell] = arrivals[k]
        _put(queue, cell, int(field[cell] / width) & RING)
    return count, width


@njit(cache=True, error_model="numpy")
def _relax(
    cost: Cost,
    rank: Ranks,
    nx: int,
    level: int,
    toll: float,
    width: float,
    queue: Queue,
    waiting: int,
    field: Field,
    through: Ranks,
) -> float:
    """Settle what waits and all that follows from it; return the highest T among it.

    Args:
        cost: (cells,) what a step through a cell costs.
        rank: (cells,) the ranks.
        nx: cells of a row.
        level: ranks from it on may be entered, 0 for none.
        toll: what settled in the stages before, up to this T, pays so much.
        width: T of a bucket.
        queue: with the cells that begin.
        waiting: how many they are; the least T waits in the list of its own bucket.
        field: (cells,) T, written to.
        through: (cells,) written to.
    """
    highest = 0.0
    lowest = np.inf
    for bucket in range(BUCKETS):
        cell = int(queue.first[bucket])
        while cell != NOWHERE:
            lowest = min(lowest, field[cell])
            cell = int(queue.after[cell])
    turn = int(lowest / width) if waiting > 0 else 0
    while waiting > 0:
        cell = int(queue.first[turn & RING])
        if cell == NOWHERE:
            turn += 1
            continue
        _take(queue, cell)
        waiting -= 1
        here = field[cell]
        highest = max(highest, here)
        for side in (-1, 1, -nx, nx):
            near = cell + side
            if field[near] <= here or not is_open(rank[near], level):
                continue
            arrival, source = _arrive(field, nx, level, toll, cost[near], near)
            if np.float32(arrival) < field[near]:
                field[near] = arrival
                through[near] = _way(rank, through, near, source)
                waiting += not queue.waiting[near]
                _put(queue, near, max(turn, int(field[near] / width)) & RING)
    return highest


@njit(cache=True, error_model="numpy")
def _stages(rank: Ranks, opened: int) -> Ranks:
    """Return the level of every stage, as `is_open` takes it: what is open first, rank 1 last.

    Args:
        rank: (cells,).
        opened: ranks from it on may be crossed at their price, above 1; 0 for none.
    """
    there = np.zeros(128, dtype=np.bool_)
    for cell in range(rank.size):
        there[rank[cell]] = True
    levels = np.empty(128, dtype=np.int8)
    levels[0] = opened
    count = 1
    for level in range(127, 0, -1):
        if there[level] and not is_open(level, opened):
            levels[count] = level
            count += 1
    return levels[:count]


@njit(cache=True, error_model="numpy")
def settle(
    cost: Cost,
    rank: Ranks,
    nx: int,
    side: float,
    levels: Ranks,
    tolls: NDArray[np.float64],
    field: Field,
    through: Ranks,
) -> bool:
    """Bring a field into agreement with its costs, from the goal or from what is known.

    Args:
        cost: (cells,) what a step through a cell costs, infinite along the grid's border.
        rank: (cells,) the highest rank among the regions that a cell lies in, 0 in the open.
        nx: cells of a row.
        side: of a cell [m].
        levels: of the stages, see `_stages`.
        tolls: of the stages; those that are not finite are chosen here.
        field: (cells,) T; infinity where it is not known.
        through: (cells,) through which rank the goal is reached: 0 none, 1 not at all.

    Returns:
        Whether every stage stayed below the next one's toll; if not, the field is of no use.
    """
    queue = _make_queue(field.size)
    highest = 0.0
    for k in range(levels.size):
        if not np.isfinite(tolls[k]):
            tolls[k] = SPARE * highest + side if k > 0 else -1.0
        if highest > tolls[k] and k > 0:
            return False
        level, toll = levels[k], tolls[k]
        ceiling = tolls[k + 1] if k + 1 < levels.size else np.inf
        count, width = _begin(cost, rank, nx, level, toll, ceiling, queue, field, through)
        reached = _relax(cost, rank, nx, level, toll, width, queue, count, field, through)
        highest = max(highest, reached)
    return True


@njit(cache=True, error_model="numpy")
def march(
    cost: Cost, rank: Ranks, nx: int, side: float, opened: int, goal: int, field: Field,
    through: Ranks,
) -> NDArray[np.float64]:  # fmt: skip
    """Write T and `through` of a whole grid; return the stages' tolls.

    Args: as `settle`; `opened` as `_stages` takes it, `goal` is the goal's cell.
    """
    levels = _stages(rank, opened)
    tolls = np.full(levels.size, np.inf)
    field[:] = np.inf
    through[:] = 0
    field[goal] = 0.0
    through[goal] = 0
    settle(cost, rank, nx, side, levels, tolls, field, through)
    return tolls


@njit(cache=True, error_model="numpy")
def _rests_on(
    cost: Cost,
    nx: int,
    levels: Ranks,
    tolls: NDArray[np.float64],
    field: Field,
    cell: int,
    near: int,
) -> bool:
    """Tell whether T of a cell was computed with that of a neighbour."""
    level, toll = levels[0], tolls[0]
    for k in range(1, tolls.size):
        if tolls[k] < field[cell]:
            level, toll = levels[k], tolls[k]
    along_x, side_x = _lower(field, level, toll, cell - 1, cell + 1)
    along_y, side_y = _lower(field, level, toll, cell - nx, cell + nx)
    if near == side_x:
        return along_x - along_y < cost[cell]
    return near == side_y and along_y - along_x < cost[cell]


@njit(cache=True, error_model="numpy")
def forget(
    cost: Cost,
    nx: int,
    levels: Ranks,
    tolls: NDArray[np.float64],
    changed: Places,
    goal: int,
    field: Field,
) -> None:
    """Forget T of cells whose cost or rank has changed, and of all that was computed from them.

    Args: as `settle`; `changed` (n,) are the cells.
    """
    known = np.ones(field.size, dtype=np.bool_)
    stack = np.empty(field.size, dtype=np.int32)
    top = 0
    for cell in changed:
        if cell != goal and known[cell]:
            known[cell] = False
            stack[top] = cell
            top += 1
    count = top
    done = 0
    while done < count:
        cell = stack[done]
        done += 1
        for side in (-1, 1, -nx, nx):
            near = cell + side
            if not known[near] or not field[near] < np.inf or near == goal:
                continue
            if _rests_on(cost, nx, levels, tolls, field, near, cell):
                known[near] = False
                stack[count] = near
                count += 1
    for k in range(count):
        field[stack[k]] = np.inf


@njit(cache=True, error_model="numpy")
def repair(
    cost: Cost, rank: Ranks, before: Ranks, nx: int, side: float, opened: int, goal: int,
    changed: Places, tolls: NDArray[np.float64], field: Field, through: Ranks,
) -> NDArray[np.float64]:  # fmt: skip
    """Bring a field into agreement with cells that have changed; return the tolls, as `march`.

    Args: as `march`, and `before` (cells,), the ranks as they were, `changed` (n,), the cells whose
        cost or rank is another, `tolls` as they were returned last.
    """
    levels = _stages(rank, opened)
    if np.array_equal(levels, _stages(before, opened)):
        forget(cost, nx, levels, tolls, changed, goal, field)
        if settle(cost, rank, nx, side, levels, tolls, field, through):
            return tolls
    return march(cost, rank, nx, side, opened, goal, field, through)
