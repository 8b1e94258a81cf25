"""The grid of a field: that of the scene's map, or one over all that the scene holds.

Its geometry (7,) says where the cells lie, see `guidance.field`.
"""

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.models.grid import Grid

CELL: float = _core.FIELD_CELL
"""Side of a cell [m] where the scene is not too large for that."""
FINE: float = _core.FIELD_FINE
"""The same where a body has to pass gaps that are little wider than itself [m]."""
MAX_CELLS: int = _core.FIELD_MAX_CELLS
"""A larger scene gets larger cells, so that a field takes no longer than 5 ms; of finer cells there
may be as many as on the same area, and it takes 20 ms."""


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

    With 1.5 m of room for the ways round them. Strict walls along an axis cut it off 0.5 m beyond
    them.

    Args:
        kind: (m,) as in `BarrierSet`.
        parameters: (m, 19) as in `BarrierSet`.
        priority: (m,) 1 is strict.
        start: (2,) [m].
        goal: (2,) [m].
        t: time [s].
        extent: (2, 2) to be written [m].
    """
    _core.scene_extent(kind, parameters, priority, start, goal, t, extent)


def geometry_over(extent: Array, cell: float, geometry: Array) -> None:
    """Write the geometry (7,) of a grid over an extent, its cells larger where it is large."""
    _core.geometry_over(extent, cell, geometry)


def geometry_of(grid: Grid) -> Array:
    """Return the geometry (7,) of a map's grid."""
    first = grid.to_world([[0.5, 0.5]])[0]
    return np.array([*first, grid.resolution, *grid.shape, *grid.axes[:, 0]])
