r"""The fields of scenes: what a march from the goal leaves in a grid.

A field T solves the eikonal equation ``‖∇T‖ = c``, ``T(goal) = 0``, c the cost of a metre. It is
marched in stages: first the open cells and those of ranks that may be crossed at their price; then,
of all that is left, the lowest rank, and so on up to rank 1. A stage begins at a toll above all
that is settled. So no closed rank lies on a path where one without it exists, however long that is,
and from within a closed region the field leads out.

A field is stored flat, row by row. Its geometry (7,) says where: x and y of the first cell's
centre, side of a cell [m], ny, nx, and cos and sin of the angle by which the grid is turned.

Source: J. A. Sethian, A fast marching level set method for monotonically advancing fronts,
PNAS 93, 1996; L. Yatziv, A. Bartesaghi, G. Sapiro, O(N) implementation of the fast marching
algorithm, Journal of Computational Physics 212, 2006.
"""

from typing import TypeVar

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Field, Ranks
from hcbf_gym.guidance.ground import Ground

Number = TypeVar("Number", float, Array)
Kept = TypeVar("Kept", Field, Ranks)


def grid(values: Kept, geometry: Array) -> Kept:
    """Return the (ny, nx) view of one scene's flat values."""
    ny, nx = int(geometry[3]), int(geometry[4])
    return values[: ny * nx].reshape(ny, nx)


def to_cells(x: float, y: float, geometry: Array) -> tuple[float, float]:
    """Return row and column of a point, whole numbers at the cells' centres."""
    return _core.field_to_cells(x, y, geometry)


def to_world(row: Number, column: Number, geometry: Array) -> tuple[Number, Number]:
    """Return the point of a row and a column, or those of many; see `to_cells`."""
    x, y, side, _, _, cos, sin = geometry.tolist()
    along, up = column * side, row * side
    return x + cos * along - sin * up, y + sin * along + cos * up


def cell_of(x: float, y: float, geometry: Array) -> tuple[int, int]:
    """Return row and column of the cell nearest a point."""
    return _core.field_cell_of(x, y, geometry)


def solve(
    ground: Ground, geometry: Array, goal: Array, opened: int, field: Field, through: Ranks
) -> None:
    """Write the field of a painted ground.

    Args:
        ground: with its border.
        geometry: (7,) of the grid.
        goal: (2,) [m].
        opened: as `ground.paint_barriers` takes it.
        field: (capacity,) T, of which the first ny·nx entries are written.
        through: (capacity,) through which rank the goal is reached: 0 none, 1 not at all.
    """
    _core.solve_field(*ground, geometry, goal, opened, field, through)


def crossing(rank: Ranks, view: Field, j: int, i: int, opened: int) -> tuple[int, int, int]:
    """Return rank, row and column of the first closed region that the path from a cell enters.

    What the path begins in counts only where it leads on into a higher rank; rank 0 is no region.

    Args:
        rank: (ny + 2, nx + 2) of the ground.
        view: (ny, nx) T.
        j: row of the first cell.
        i: its column.
        opened: ranks from it on may be crossed, 0 for none.
    """
    return _core.field_crossing(rank, view, j, i, opened)
