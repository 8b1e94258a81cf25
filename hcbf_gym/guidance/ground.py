"""What a field walks on: cells of a grid, what each costs, and the highest rank that it lies in.

A metre costs 1 in the open, a little more close to an edge, so that the path leaves some distance
where there is room, and far more in a region, so that it leads out by a short path. A cell of a map
lies in a region where its centre is nearer to the occupied squares than the clearance: the body's
radius and what the edges reserve.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Field, Integers, Mask, Ranks

HALO: float = _core.GROUND_HALO
"""Up to this distance from an edge a cell costs more than in the open [m]."""


class Ground(NamedTuple):
    """Cells with a border around them that no path enters.

    Attributes:
        cost: (ny + 2, nx + 2) what a step through a cell costs, infinite on the border.
        rank: (ny + 2, nx + 2) the highest rank among the regions that a cell lies in, 0 in none.
    """

    cost: Field
    rank: Ranks


def open_ground(ny: int, nx: int, side: float) -> Ground:
    """Return ground without regions, of cells with that side [m]."""
    ground = Ground(
        np.full((ny + 2, nx + 2), np.inf, dtype=np.float32),
        np.zeros((ny + 2, nx + 2), dtype=np.int8),
    )
    ground.cost[1:-1, 1:-1] = side
    return ground


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
    _core.paint_barriers(*ground, geometry, kind, parameters, priority, clearance, t, opened)


def distances(cells: Mask, reach: int) -> Field:
    """Return (ny, nx) exact distances of the cells' centres from the nearest occupied square.

    In sides of a cell; infinite beyond `reach` of them along either axis. With n(j, i) the cells
    to the nearest occupied one of the same column, and e(n) = max(0, n − ½),

        d² = min over |k| ≤ reach of e(|k|)² + e(n(j, i + k))².

    Args:
        cells: (ny, nx) the occupied ones.
        reach: how far to look.
    """
    return _core.cell_distances(cells, reach)


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
    _core.paint_cells(*ground, window, cells, side, priority, clearance, opened)
