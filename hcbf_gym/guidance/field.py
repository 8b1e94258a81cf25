r"""Fields of shortest paths on a grid, and the guidance row that follows them.

A field T solves the eikonal equation ``‖∇T‖ = c``, ``T(goal) = 0``, with c the cost of a metre. The
cost is 1 in the open, a little more close to an edge, and far more in a region, so that the path
leads out of it. Fast marching computes T in stages. The first stage settles the open cells and
those of ranks that may be crossed at their price. Each further stage settles the lowest rank that
is left, up to rank 1, and begins at a toll above all settled values. So a path crosses a closed
rank only where no path without it exists, however long, and from within a closed region the field
leads out.

A field is stored flat, row by row. Its geometry is seven numbers: x and y of the first cell's
centre [m], the side of a cell [m], the counts of rows ny and columns nx, and cos and sin of the
angle by which the grid is turned.

Source: J. A. Sethian, A fast marching level set method for monotonically advancing fronts,
PNAS 93, 1996; L. Yatziv, A. Bartesaghi, G. Sapiro, O(N) implementation of the fast marching
algorithm, Journal of Computational Physics 212, 2006.
"""

from typing import NamedTuple, TypeVar

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Field, Ranks
from hcbf_gym.models.grid import Grid

Number = TypeVar("Number", float, Array)
CellValues = TypeVar("CellValues", Field, Ranks)

CELL: float = _core.FIELD_CELL
"""Side of a cell [m]. Scenes of more than `_core.FIELD_MAX_CELLS` have larger cells, because the
core then computes a field in 5 ms."""
FINE: float = _core.FIELD_FINE
"""Side of a cell where a body has to pass gaps that are little wider than itself [m]."""


class Pull(NamedTuple):
    r"""The guidance row, which has the last rank of all, so that no safety row is relaxed for it.

    With d the unit vector towards the point that is `look_ahead` further down the field, and r the
    distance from the goal, the row is

    .. math::
        dᵀu ≥ −k\,(dᵀv − β \min(1, r / r_0)).

    Where it holds, the speed along d does not fall below β.

    Attributes:
        gain: k [1/s].
        speed: β, the least speed along the path [m/s].
        look_ahead: how far down the field the row aims [m].
        ease: r₀, the distance from the goal within which β falls to zero [m]; short, as many a
            robot with legs stays at rest where a slow velocity is commanded.
    """

    gain: float = 3.0
    speed: float = 0.4
    look_ahead: float = 0.6
    ease: float = 0.3


class Ground(NamedTuple):
    """The cells on which a field is computed, with a border around them that no path enters.

    Attributes:
        cost: (ny + 2, nx + 2) the cost of a step through a cell [m], infinite on the border.
        rank: (ny + 2, nx + 2) the highest rank among the regions that a cell is in, 0 in none.
    """

    cost: Field
    rank: Ranks


def open_ground(ny: int, nx: int, side: float) -> Ground:
    """Return the ground of ny rows and nx columns without regions; `side` is a cell's [m]."""
    cost = np.full((ny + 2, nx + 2), np.inf, dtype=np.float32)
    cost[1:-1, 1:-1] = side
    return Ground(cost, np.zeros(cost.shape, dtype=np.int8))


def geometry_of(grid: Grid) -> Array:
    """Return the geometry (7,) of a map's grid."""
    first = grid.to_world([[0.5, 0.5]])[0]
    return np.array([*first, grid.resolution, *grid.shape, *grid.axes[:, 0]])


def grid(values: CellValues, geometry: Array) -> CellValues:
    """Return one scene's flat values, one for each cell, as a view (ny, nx)."""
    ny, nx = int(geometry[3]), int(geometry[4])
    return values[: ny * nx].reshape(ny, nx)


def to_world(row: Number, column: Number, geometry: Array) -> tuple[Number, Number]:
    """Return x and y [m] of a row and a column; whole numbers are the centres of cells."""
    x, y, side, _, _, cos, sin = geometry.tolist()
    along, up = column * side, row * side
    return x + cos * along - sin * up, y + sin * along + cos * up
