"""The grid of a field: that of the scene's map, or one over all that the scene holds.

Its geometry (7,) says where the cells lie, see `guidance.field`.
"""

import numpy as np

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import kernels, layout, shapes
from hcbf_gym.barriers.shapes import half_plane
from hcbf_gym.compilation import kernel
from hcbf_gym.models.grid import Grid

PAD = 1.5
"""Room around start, goal and regions, for the ways round them [m]."""
BEHIND_WALL = 0.5
"""How far the grid goes beyond a strict wall along an axis [m]."""
CELL = 0.1
"""Side of a cell [m] where the scene is not too large for that."""
FINE = 0.05
"""The same where a body has to pass gaps that are little wider than itself [m]."""
MAX_CELLS = 10_000
"""A larger scene gets larger cells, so that a field takes no longer than 5 ms; of finer cells there
may be as many as on the same area, and it takes 20 ms."""


@kernel()
def scene_extent(
    kind: Integers,
    parameters: Array,
    priority: Integers,
    start: Array,
    goal: Array,
    t: float,
    extent: Array,
) -> None:
    """Write ((x_min, y_min), (x_max, y_max)) around start, goal and the bounded regions.

    Strict walls along an axis cut it off `BEHIND_WALL` beyond them.

    Args:
        kind: (m,) as in `BarrierSet`.
        parameters: (m, 19) as in `BarrierSet`.
        priority: (m,) 1 is strict.
        start: (2,) [m].
        goal: (2,) [m].
        t: time [s].
        extent: (2, 2) to be written [m].
    """
    for axis in range(2):
        extent[0, axis] = min(start[axis], goal[axis])
        extent[1, axis] = max(start[axis], goal[axis])
    for k in range(kind.size):
        if kernels.is_region(kind[k]):
            low_x, low_y, high_x, high_y = shapes.bounds(kind[k], parameters[k])
            dx, dy = parameters[k, layout.VELOCITY_X] * t, parameters[k, layout.VELOCITY_Y] * t
            low_x, low_y, high_x, high_y = low_x + dx, low_y + dy, high_x + dx, high_y + dy
            extent[0, 0], extent[0, 1] = min(extent[0, 0], low_x), min(extent[0, 1], low_y)
            extent[1, 0], extent[1, 1] = max(extent[1, 0], high_x), max(extent[1, 1], high_y)
    for axis in range(2):
        extent[0, axis] -= PAD
        extent[1, axis] += PAD
    for k in range(kind.size):
        if kind[k] == half_plane.CODE and priority[k] == 1:
            for axis in range(2):
                along = parameters[k, half_plane.NORMAL_X + axis]
                wall = parameters[k, half_plane.OFFSET]
                if along == 1.0:
                    extent[0, axis] = max(extent[0, axis], wall - BEHIND_WALL)
                elif along == -1.0:
                    extent[1, axis] = min(extent[1, axis], BEHIND_WALL - wall)


@kernel()
def geometry_over(extent: Array, cell: float, geometry: Array) -> None:
    """Write the geometry (7,) of a grid over an extent, its cells larger where it is large."""
    width, height = extent[1, 0] - extent[0, 0], extent[1, 1] - extent[0, 1]
    finer = min(1.0, cell / CELL)
    side = max(cell, finer * np.sqrt(width * height / MAX_CELLS))
    side = max(side, 4.0 * max(width, height) / MAX_CELLS)  # a strip is two cells wide at least
    geometry[0], geometry[1], geometry[2] = extent[0, 0], extent[0, 1], side
    geometry[3] = max(2.0, np.ceil(height / side) + 1.0)
    geometry[4] = max(2.0, np.ceil(width / side) + 1.0)
    geometry[5], geometry[6] = 1.0, 0.0


def geometry_of(grid: Grid) -> Array:
    """Return the geometry (7,) of a map's grid."""
    first = grid.to_world([[0.5, 0.5]])[0]
    return np.array([*first, grid.resolution, *grid.shape, *grid.axes[:, 0]])
