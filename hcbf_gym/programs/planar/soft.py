"""The minimum over a polygon of one-sided penalties, ``λ_u ‖u − u*‖² + Σ w_k max(m_k, v_k)²``.

``v_k = b_k − a_k·u`` is row k's violation, m_k ≥ 0 the least slack it pays for. The cost is convex
and quadratic on each cell that the kinks ``v_k = m_k`` cut out of the polygon. Mostly a guess of
the cell is right after a few rounds. If not, the minimum on a kink tells on which side of it the
minimum of the whole lies (`kink`): the polygon is cut down, kink by kink, to one cell.
"""

import numpy as np

from hcbf_gym.arrays import Array, Records
from hcbf_gym.compilation import kernel
from hcbf_gym.programs.planar.kink import MET, OPEN, PAID, settle
from hcbf_gym.programs.planar.polygon import (
    LeastSquares,
    add_row,
    copy,
    cut,
    distance,
    minimise,
    slice_at,
    span,
)
from hcbf_gym.programs.planar.records import CELL, Cost, Line, Point, Workspace, row_line
from hcbf_gym.programs.tolerances import (
    GRADED,
    NEGLIGIBLE,
    SURELY_MET,
    SURELY_PAID,
    THIN,
    ZERO_GRADIENT,
)


@kernel(error_model="numpy")
def soft_minimum(corners: Array, count: int, cost: Cost, w: Workspace) -> Point:
    """Return a minimiser over the polygon; rows of weight 0 drop out.

    Args:
        corners: (capacity, 2) the polygon, left as it is.
        count: its number of corners.
        cost: what to minimise; where λ_u is 0 the minimiser need not be the one nearest u*.
        w: the working space; `CELL`, `COPY` and the rows' `state` are written to.
    """
    x, y, found = _guess(corners, count, cost, w)
    if found:
        return x, y
    cell = w.polygons[CELL]
    rows = cost.rows
    copy(corners, count, cell)
    for k in range(rows.size):
        pays = rows[k].weight != 0.0 and rows[k].norm > ZERO_GRADIENT
        rows[k].state = OPEN if pays else MET
    while True:
        k = _halving_kink(cell, count, cost, THIN * w.radius)
        if k < 0:
            return minimise(cell, count, _paid(cost), cost.ux, cost.uy, w)
        line = row_line(rows[k], rows[k].b - rows[k].least)
        x, y, side = settle(cell, count, line, k, cost, w.radius)
        if side == 0:
            return x, y
        rows[k].state = MET if side > 0 else PAID
        count = cut(cell, count, Line(side * line.nx, side * line.ny, side * line.d), w.radius)


@kernel(error_model="numpy")
def _paid(cost: Cost) -> LeastSquares:
    """Return the quadratic of the rows that pay."""
    problem = distance(cost.lambda_u, cost.ux, cost.uy)
    for k in range(cost.rows.size):
        row = cost.rows[k]
        if row.state == PAID:
            root = np.sqrt(row.weight)
            problem = add_row(problem, root * row.ax, root * row.ay, root * row.b)
    return problem


@kernel(error_model="numpy")
def _guess(corners: Array, count: int, cost: Cost, w: Workspace) -> tuple[float, float, bool]:
    """Guess which rows pay, minimise with those, and try again with those that then do.

    Without least slacks the cost has a continuous gradient: a point that minimises the quadratic of
    just the rows that it violates minimises the whole.

    Returns:
        The minimiser, and whether it was found within a few rounds.
    """
    for k in range(cost.rows.size):
        if cost.rows[k].least != 0.0:
            return 0.0, 0.0, False
    x, y = corners[0, 0], corners[0, 1]
    for i in range(1, count):
        x, y = x + corners[i, 0], y + corners[i, 1]
    x, y = x / count, y / count
    for attempt in range(8):
        if _confirms(cost, x, y, w.radius) and attempt > 0:
            return x, y, True
        x, y = minimise(corners, count, _paid(cost), cost.ux, cost.uy, w)
    return x, y, False


@kernel(error_model="numpy")
def _confirms(cost: Cost, x: float, y: float, radius: float) -> bool:
    """Note which rows pay at a point; return whether they are those of the guess before."""
    confirms = True
    for k in range(cost.rows.size):
        row = cost.rows[k]
        if row.weight == 0.0 or row.norm <= ZERO_GRADIENT:
            row.state = MET
            continue
        lack = row.b - row.ax * x - row.ay * y
        if row.state == PAID:
            confirms &= lack >= SURELY_PAID * row.norm * radius
        else:
            confirms &= lack <= SURELY_MET * (abs(row.b) + row.norm * radius)
        row.state = PAID if lack > 0.0 else MET
    return confirms


@kernel(error_model="numpy")
def _halving_kink(cell: Array, count: int, cost: Cost, thin: float) -> int:
    """Return the open row whose kink halves the cell best, −1 if none crosses it.

    Rows whose kinks pass the cell by are noted as met or paid.
    """
    chosen = -1
    depth = 0.0
    for k in range(cost.rows.size):
        row = cost.rows[k]
        if row.state != OPEN:
            continue
        line = row_line(row, row.b - row.least)
        lowest, highest = span(cell, count, line.nx, line.ny)
        if lowest >= line.d - thin:
            row.state = MET
        elif highest <= line.d + thin:
            row.state = PAID
        elif min(line.d - lowest, highest - line.d) > depth:
            chosen = k
            depth = min(line.d - lowest, highest - line.d)
    return chosen


@kernel(error_model="numpy")
def keep_least(corners: Array, count: int, cost: Cost, w: Workspace) -> tuple[int, float, float]:
    """Cut a polygon in place to the minimisers of ``Σ w_k max(m_k, v_k)²``.

    Where rows differ so much in steepness that the squares of the flat ones drown in the rounding
    of the steep ones, the steep ones are locked at the minimum of all, and the flat ones decide
    among the inputs that are left. Rows that were locked so have weight 0 afterwards.

    Returns:
        The new number of corners, and a minimiser.
    """
    while True:
        x, y = soft_minimum(corners, count, cost, w)
        floor = flattest_that_counts(cost.rows)
        count = lock(corners, count, cost, x, y, floor, w.radius)
        if not drop(cost.rows, floor):
            return count, x, y


@kernel(error_model="numpy")
def flattest_that_counts(rows: Records) -> float:
    """Return the steepness ``√w_k ‖a_k‖`` below which rows are too flat beside the steepest."""
    steepest = 0.0
    flattest = np.inf
    for k in range(rows.size):
        row = rows[k]
        if row.weight > 0.0 and row.norm > ZERO_GRADIENT:
            steepness = np.sqrt(row.weight) * row.norm
            steepest, flattest = max(steepest, steepness), min(flattest, steepness)
    return steepest / GRADED if steepest > GRADED * flattest else 0.0


@kernel(error_model="numpy")
def drop(rows: Records, floor: float) -> bool:
    """Give the rows that are not flatter weight 0; return whether rows are left, for 0 False."""
    if floor == 0.0:
        return False
    for k in range(rows.size):
        row = rows[k]
        if np.sqrt(row.weight) * row.norm >= floor:
            row.weight = 0.0
    return True


@kernel(error_model="numpy")
def lock(
    corners: Array, count: int, cost: Cost, x: float, y: float, floor: float, radius: float
) -> int:
    """Cut a polygon in place to the inputs at which rows pay what they pay at a minimiser u.

    Each violation above m_k has one value on all minimisers. Returns the new number of corners.

    Args:
        corners: (capacity, 2) the polygon.
        count: its number of corners.
        cost: ``Σ w_k max(m_k, v_k)²``.
        x: of u.
        y: of u.
        floor: the steepness ``√w_k ‖a_k‖`` below which rows are passed over.
        radius: the largest norm of an input.
    """
    total = 0.0
    for k in range(cost.rows.size):
        row = cost.rows[k]
        excess = max(0.0, row.b - row.least - row.ax * x - row.ay * y)
        total += row.weight * excess * excess
    negligible = NEGLIGIBLE * np.sqrt(total)
    for k in range(cost.rows.size):
        row = cost.rows[k]
        root = np.sqrt(row.weight)
        if root == 0.0 or row.norm <= ZERO_GRADIENT or root * row.norm < floor:
            continue
        line = row_line(row, row.b - row.least)
        here = line.nx * x + line.ny * y
        excess = row.norm * (line.d - here)
        if here < line.d - THIN * radius and root * excess > negligible:
            count = slice_at(corners, count, Line(line.nx, line.ny, here), radius)
        else:
            count = cut(corners, count, Line(line.nx, line.ny, min(here, line.d)), radius)
    return count
