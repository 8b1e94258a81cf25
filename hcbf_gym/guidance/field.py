r"""Fields of shortest paths: what a march from the goal leaves in a grid, and the row along them.

A field T solves the eikonal equation ``‖∇T‖ = c``, ``T(goal) = 0``, c the cost of a metre: 1 in the
open, a little more close to an edge, and far more in a region, so that the path leads out of it. It
is marched in stages: first the open cells and those of ranks that may be crossed at their price;
then, of all that is left, the lowest rank, and so on up to rank 1. A stage begins at a toll above
all that is settled. So no closed rank is on a path where one without it exists, however long that
is, and from within a closed region the field leads out.

A field is stored flat, row by row. Its geometry (7,) is x and y of the first cell's centre, side of
a cell [m], ny, nx, and cos and sin of the angle by which the grid is turned.

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
Kept = TypeVar("Kept", Field, Ranks)

CELL: float = _core.FIELD_CELL
"""Side of a cell [m]; larger in scenes of more than `_core.FIELD_MAX_CELLS`: a field takes 5 ms."""
FINE: float = _core.FIELD_FINE
"""The same where a body has to pass gaps that are little wider than itself [m]."""


class Pull(NamedTuple):
    r"""How the guidance row pulls: of the last rank of all, so that no safety row pays for it.

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
    """Cells with a border around them that no path enters.

    Attributes:
        cost: (ny + 2, nx + 2) what a step through a cell costs, infinite on the border.
        rank: (ny + 2, nx + 2) the highest rank among the regions that a cell is in, 0 in none.
    """

    cost: Field
    rank: Ranks


def open_ground(ny: int, nx: int, side: float) -> Ground:
    """Return ground without regions, of cells with that side [m]."""
    cost = np.full((ny + 2, nx + 2), np.inf, dtype=np.float32)
    cost[1:-1, 1:-1] = side
    return Ground(cost, np.zeros(cost.shape, dtype=np.int8))


def geometry_of(grid: Grid) -> Array:
    """Return the geometry (7,) of a map's grid."""
    first = grid.to_world([[0.5, 0.5]])[0]
    return np.array([*first, grid.resolution, *grid.shape, *grid.axes[:, 0]])


def grid(values: Kept, geometry: Array) -> Kept:
    """Return the (ny, nx) view of one scene's flat values."""
    ny, nx = int(geometry[3]), int(geometry[4])
    return values[: ny * nx].reshape(ny, nx)


def to_world(row: Number, column: Number, geometry: Array) -> tuple[Number, Number]:
    """Return the point of a row and a column, or those of many; whole numbers are centres."""
    x, y, side, _, _, cos, sin = geometry.tolist()
    along, up = column * side, row * side
    return x + cos * along - sin * up, y + sin * along + cos * up
