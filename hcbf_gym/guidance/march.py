"""The geodesic field on a grid: what the cheapest path from every cell to the goal costs.

The field T solves the eikonal equation ``‖∇T‖ = c``, ``T(goal) = 0``, by upwind differences,

    Σ_axes max(0, T − T_axis)² = (c · side)²,     T_axis the lower neighbour's on that axis.

Cells settle in stages: first the open ones and those of ranks that may be crossed at their price;
then, of all that is left, the lowest rank, and so on up to rank 1. A stage begins at a toll above
all that is settled. So no closed rank lies on a path where one without it exists, however long that
is, and from within a closed region the field leads out, through strict cells only where nothing
else is left.

Cells wait in buckets of equal T, and one whose T falls waits again: the order is a matter of speed
alone.

Source: J. A. Sethian, A fast marching level set method for monotonically advancing fronts,
PNAS 93, 1996; L. Yatziv, A. Bartesaghi, G. Sapiro, O(N) implementation of the fast marching
algorithm, Journal of Computational Physics 212, 2006.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Field, Mask, Places, Ranks
from hcbf_gym.compilation import kernel

BUCKETS = 1 << 15
"""So many lists of waiting cells, in a ring."""
APART = 4.0
"""A stage begins so many times above what is settled: T alone says which cells are settled."""

RING = BUCKETS - 1
NOWHERE = -1


class Cells(NamedTuple):
    """A grid's cells in one row each, with a border that is never entered.

    Attributes:
        cost: (cells,) what a step through a cell costs, infinite on the border.
        rank: (cells,) the highest rank among the regions that a cell lies in, 0 in the open.
        nx: cells of a row.
        field: (cells,) T, written to; infinity where it is not known.
        through: (cells,) through which rank the goal is reached: 0 none, 1 not at all; written to.
    """

    cost: Field
    rank: Ranks
    nx: int
    field: Field
    through: Ranks


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


@kernel(error_model="numpy")
def _make_queue(cells: int) -> Queue:
    """Return an empty queue."""
    return Queue(
        np.full(BUCKETS, NOWHERE, dtype=np.int32),
        np.empty(cells, dtype=np.int32),
        np.empty(cells, dtype=np.int32),
        np.zeros(cells, dtype=np.bool_),
    )


@kernel(inline="always", error_model="numpy")
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


@kernel(inline="always", error_model="numpy")
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


@kernel(inline="always", error_model="numpy")
def is_open(rank: int, level: int) -> bool:
    """Return whether a cell of this rank may be entered: ranks from `level` on may, for 0 none."""
    return rank == 0 or (level > 0 and rank >= level)


@kernel(inline="always", error_model="numpy")
def _worst(rank: int, other: int) -> int:
    """Return the higher of two ranks, 0 where both are none."""
    if rank == 0 or other == 0:
        return max(rank, other)
    return min(rank, other)


@kernel(inline="always", error_model="numpy")
def _lower(field: Field, level: int, toll: float, one: int, other: int) -> tuple[float, int]:
    """Return the lower T of two neighbours and which; what settled in stages before pays toll.

    Out of rank 1 all paths are alike: the shortest is the one, however dear it is from there on.
    """
    t, u = field[one], field[other]
    if t <= toll:
        t = toll + t * (level != 1)
    if u <= toll:
        u = toll + u * (level != 1)
    return (t, one) if t <= u else (u, other)


@kernel(inline="always", error_model="numpy")
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


@kernel(inline="always", error_model="numpy")
def _reached(rank: Ranks, through: Ranks, cell: int, source: int) -> int:
    """Return through which rank the goal is reached from a cell over a neighbour.

    A robot that presses against a strict edge stands within its clearance, and often in a cell of
    rank 1. Its own cell does not count; a path *into* rank 1 is none.
    """
    if rank[cell] == 1:
        return through[source]
    if rank[source] == 1:
        return 1
    return _worst(rank[cell], through[source])


@kernel(error_model="numpy")
def _begin(cells: Cells, level: int, toll: float, queue: Queue) -> tuple[int, float]:
    """Put what a stage can settle from what is settled into the queue; return how many, and width.

    A bucket is as wide as the cheapest step, so that about equal T wait together.

    Args: as `_relax`.
    """
    cost, rank, nx, field, through = cells
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
        if np.float32(arrival) < here:
            lowest, highest = min(lowest, arrival), max(highest, arrival)
            found[count], arrivals[count], sources[count] = cell, arrival, source
            count += 1
    width = max(cheapest, (highest - lowest + 2.0 * dearest) / (BUCKETS - 2))
    for k in range(count):
        cell = found[k]
        through[cell] = _reached(rank, through, cell, sources[k])
        field[cell] = arrivals[k]
        _put(queue, cell, int(field[cell] / width) & RING)
    return count, width


@kernel(error_model="numpy")
def _relax(
    cells: Cells, level: int, toll: float, width: float, queue: Queue, waiting: int
) -> float:
    """Settle what waits and all that follows from it; return the highest T among it.

    Args:
        cells: of the grid.
        level: ranks from it on may be entered, 0 for none.
        toll: what settled in the stages before, up to this T, pays so much.
        width: T of a bucket.
        queue: with the cells that begin.
        waiting: how many they are; the least T waits in the list of its own bucket.
    """
    cost, rank, nx, field, through = cells
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
            if field[near] <= here or not cost[near] < np.inf or not is_open(rank[near], level):
                continue  # on the border: what is behind it is no cell
            arrival, source = _arrive(field, nx, level, toll, cost[near], near)
            if np.float32(arrival) < field[near]:
                field[near] = arrival
                through[near] = _reached(rank, through, near, source)
                waiting += not queue.waiting[near]
                _put(queue, near, max(turn, int(field[near] / width)) & RING)
    return highest


@kernel(error_model="numpy")
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


@kernel(error_model="numpy")
def march(cells: Cells, side: float, opened: int, goal: int) -> None:
    """Write T and `through` of a whole grid.

    Args:
        cells: of the grid.
        side: of a cell [m].
        opened: as `_stages` takes it.
        goal: the goal's cell.
    """
    queue = _make_queue(cells.field.size)
    cells.field[:] = np.inf
    cells.through[:] = 0
    cells.field[goal] = 0.0
    highest, toll = 0.0, -1.0
    for level in _stages(cells.rank, opened):
        count, width = _begin(cells, level, toll, queue)
        highest = max(highest, _relax(cells, level, toll, width, queue, count))
        toll = APART * highest + side
