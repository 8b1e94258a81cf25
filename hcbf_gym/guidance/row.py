r"""The guidance row: keep moving down the field, as far as every safety row lets you.

With d the unit vector towards the point that lies `look_ahead` further down the field, the row is

.. math::
    dᵀu ≥ −k\,(dᵀv − β \min(1, r / r_0)),

r the distance from the goal. Where it holds, the speed along d does not fall below β. It has the
last rank of all, so that no safety row pays for it.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Field, Integers, Ranks
from hcbf_gym.compilation import kernel
from hcbf_gym.guidance.field import cell_of, grid, to_cells, to_world

AHEAD = 2.0
"""Cells along the last row from which a path is sought that goes on there."""


class Pull(NamedTuple):
    """How the guidance row pulls.

    Attributes:
        gain: k [1/s].
        speed: β, the least speed along the path [m/s].
        look_ahead: how far down the field the row aims [m].
        ease: r₀, the distance from the goal within which β falls to zero [m]; short, as many a
            robot with legs stands where a slow velocity is commanded.
    """

    gain: float = 3.0
    speed: float = 0.4
    look_ahead: float = 0.6
    ease: float = 0.3


@kernel(error_model="numpy")
def interpolate(view: Field, row: float, column: float) -> tuple[float, float, float]:
    """Return T and its slope by row and by column, bilinear between the cells' centres."""
    ny, nx = view.shape
    row = min(max(row, 0.0), ny - 1.000001)
    column = min(max(column, 0.0), nx - 1.000001)
    j, i = int(row), int(column)
    q, p = row - j, column - i
    t00, t01, t10, t11 = view[j, i], view[j, i + 1], view[j + 1, i], view[j + 1, i + 1]
    by_row = (1.0 - p) * (t10 - t00) + p * (t11 - t01)
    by_column = (1.0 - q) * (t01 - t00) + q * (t11 - t10)
    lower, upper = (1.0 - p) * t00 + p * t01, (1.0 - p) * t10 + p * t11
    return (1.0 - q) * lower + q * upper, by_row, by_column


@kernel(error_model="numpy")
def lowest_neighbour(view: Field, row: float, column: float) -> tuple[float, float]:
    """Return row and column of the lowest cell around the one nearest a place."""
    ny, nx = view.shape
    j = round(min(max(row, 0.0), ny - 1.0))
    i = round(min(max(column, 0.0), nx - 1.0))
    low_j = j
    low_i = i
    for near_j in range(max(j - 1, 0), min(j + 2, ny)):
        for near_i in range(max(i - 1, 0), min(i + 2, nx)):
            if view[near_j, near_i] < view[low_j, low_i]:
                low_j = near_j
                low_i = near_i
    return float(low_j), float(low_i)


@kernel(error_model="numpy")
def descent(
    view: Field, geometry: Array, goal: Array, x: float, y: float, length: float
) -> tuple[float, float]:
    """Return the point that lies `length` further down the field, or the goal if that is nearer.

    Steps are one cell long and follow the gradient; one that would climb, in a valley narrower
    than two cells, goes to the lowest cell around instead. So T decreases at every step.
    """
    row, column = to_cells(x, y, geometry)
    goal_row, goal_column = to_cells(goal[0], goal[1], geometry)
    value, by_row, by_column = interpolate(view, row, column)
    for _ in range(int(np.ceil(length / geometry[2]))):
        if (goal_row - row) ** 2 + (goal_column - column) ** 2 <= 2.25:
            return goal[0], goal[1]
        slope = max(np.sqrt(by_row * by_row + by_column * by_column), 1e-9)
        next_row, next_column = row - by_row / slope, column - by_column / slope
        next_value, by_row, by_column = interpolate(view, next_row, next_column)
        if next_value >= value:
            next_row, next_column = lowest_neighbour(view, row, column)
            next_value, by_row, by_column = interpolate(view, next_row, next_column)
        row, column, value = next_row, next_column, next_value
    return to_world(row, column, geometry)


@kernel(error_model="numpy")
def has_field(capacity: int, geometry: Array) -> bool:
    """Return whether a scene's field was computed: nothing else here checks an index."""
    ny, nx = int(geometry[3]), int(geometry[4])
    return ny >= 2 and nx >= 2 and ny * nx <= capacity


@kernel(error_model="numpy")
def row(
    field: Field, geometry: Array, goal: Array, x: Array, pull: Pull, last: Array
) -> tuple[float, float, float]:
    """Return (a_x, a_y, b) of the row ``a·u ≥ b`` at one state x (4,).

    At the goal, where the state is not finite, and where there is no field yet, it requests
    nothing: a = 0, b = −1.

    Args:
        field: (capacity,) of one scene.
        geometry: (7,) of its grid, see `guidance.field`.
        goal: (2,) [m].
        x: (4,) position [m] and velocity [m/s].
        pull: gain, speed and ranges.
        last: (3,) the row before; zeros where there was none.
    """
    px, py = x[0], x[1]
    if not (has_field(field.size, geometry) and np.isfinite(px + py + x[2] + x[3])):
        return 0.0, 0.0, -1.0
    view = grid(field, geometry)
    tx, ty = descent(view, geometry, goal, px, py, pull.look_ahead)
    if last[0] * (tx - px) + last[1] * (ty - py) < 0.0:
        tx, ty = on_the_same_side(view, geometry, goal, x, pull.look_ahead, last, tx, ty)
    dx, dy = tx - px, ty - py
    length = np.sqrt(dx * dx + dy * dy)
    if length < 1e-6:
        return 0.0, 0.0, -1.0
    dx, dy = dx / length, dy / length
    away = np.sqrt((goal[0] - px) ** 2 + (goal[1] - py) ** 2)
    speed = pull.speed * min(1.0, away / pull.ease)
    return dx, dy, -pull.gain * (dx * x[2] + dy * x[3] - speed)


@kernel(error_model="numpy")
def on_the_same_side(
    view: Field,
    geometry: Array,
    goal: Array,
    x: Array,
    length: float,
    last: Array,
    tx: float,
    ty: float,
) -> tuple[float, float]:
    """Return where to aim where the path turns back: where the last row led, if that is as near.

    On the ridge between two ways round, a place decides which is the shorter by a hair, and a robot
    that is led to one and the other in turn stands.

    Args:
        view: the field.
        geometry: (7,) of its grid.
        goal: (2,) [m].
        x: (4,) position [m] first.
        length: how far down the field the row aims [m].
        last: (3,) the row before.
        tx: where it would aim now [m].
        ty: likewise.
    """
    step = AHEAD * geometry[2]
    sx, sy = x[0] + step * last[0], x[1] + step * last[1]
    sx, sy = descent(view, geometry, goal, sx, sy, max(length - step, step))
    if last[0] * (sx - x[0]) + last[1] * (sy - x[1]) <= 0.0:
        return tx, ty
    there = interpolate(view, *to_cells(sx, sy, geometry))[0]
    return (
        (sx, sy) if there <= interpolate(view, *to_cells(tx, ty, geometry))[0] + step else (tx, ty)
    )


@kernel(error_model="numpy")
def rows(field: Field, geometry: Array, goal: Array, x: Array, pull: Pull, out: Array) -> None:
    """Write a_x, a_y and b of N states, each in its own field, see `row`.

    Args:
        field: (N, capacity).
        geometry: (N, 7).
        goal: (N, 2) [m].
        x: (N, 4) positions [m] and velocities [m/s].
        pull: gain, speed and ranges.
        out: (N, 3) the rows before, or zeros; written to.
    """
    for n in range(x.shape[0]):
        last = out[n]
        last[0], last[1], last[2] = row(field[n], geometry[n], goal[n], x[n], pull, last)


@kernel(error_model="numpy")
def rank_at(ranks: Ranks, geometry: Array, x: float, y: float) -> int:
    """Return what stands at a point's cell in (capacity,) ranks, of paths or zones; 0 for none.

    There is none where no field was computed, or the point is not finite.
    """
    if not (has_field(ranks.size, geometry) and np.isfinite(x + y)):
        return 0
    j, i = cell_of(x, y, geometry)
    return ranks[j * int(geometry[4]) + i]


@kernel(error_model="numpy")
def ranks_at(
    through: Ranks, zones: Ranks, geometry: Array, x: Array, reachable: Array, zone: Array
) -> None:
    """Write through which ranks N states reach their goals, and in which zones they lie.

    Args:
        through: (N, capacity) as `Geodesic` holds it.
        zones: (N, capacity) likewise.
        geometry: (N, 7).
        x: (N, 4) positions first [m].
        reachable: (N,) of `through`, to be written.
        zone: (N,) of `zones`, to be written.
    """
    for n in range(x.shape[0]):
        reachable[n] = rank_at(through[n], geometry[n], x[n, 0], x[n, 1])
        zone[n] = rank_at(zones[n], geometry[n], x[n, 0], x[n, 1])


@kernel(error_model="numpy")
def insert(priority: Integers, reachable: int, zone: int, through: int, out: Integers) -> None:
    """Write the ranks (m + 1,) of m rows and, as the last entry, of the guidance row.

    The guidance row comes last of all. Where the goal can be reached only through a rank that the
    user lets it take, it comes right before the rows of that rank, which then give way to it; so
    it does where the robot stands in a zone of a map, for the nearest edge may lie behind a wall.

    Args:
        priority: (m,) of the safety rows, from 1 without a gap.
        reachable: through which rank the goal can be reached, see `march`.
        zone: the rank of the map's zone that the robot stands in, above 1; 0 for none.
        through: the highest rank that gives way to guidance, above 1; 0 for none.
        out: (m + 1,) to be written.
    """
    m = priority.size
    lowest = 1
    for k in range(m):
        lowest = max(lowest, priority[k])
    place = lowest + 1
    if zone > 1:
        place = zone
    if through > 1 and reachable >= through:
        place = min(place, reachable)
    place = min(place, lowest + 1)
    out[m] = place
    for k in range(m):
        out[k] = priority[k] + 1 if priority[k] >= place else priority[k]


@kernel(error_model="numpy")
def shape(ux: float, uy: float, ax: float, ay: float, b: float) -> tuple[float, float]:
    """Return the input nearest u* that meets the guidance row.

    What guidance means for programs with weights: they have no last rank, but whatever they
    guarantee holds for any u*, and so for this one.
    """
    lack = b - ax * ux - ay * uy
    if lack <= 0.0:
        return ux, uy
    return ux + lack * ax, uy + lack * ay
