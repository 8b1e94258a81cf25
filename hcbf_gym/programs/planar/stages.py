"""What the compiled cascade is made of: the stages of `programs.stages`, on polygons.

`w.feasible` holds the inputs that the stages so far leave. A stage that narrows them cuts it in
place and returns the new number of its corners.
"""

from typing import Any

from numba import njit

from hcbf_gym.programs.planar.polygon import add_row, cut, distance, minimise, slice_at, span
from hcbf_gym.programs.planar.records import Array, Cost, Line, Point, Rows, Workspace, row_line
from hcbf_gym.programs.planar.soft import is_graded, lock, soft_minimum
from hcbf_gym.programs.tolerances import THIN, ZERO_GRADIENT


@njit(cache=True)
def nearest(corners: Array, count: int, ux: float, uy: float, w: Workspace) -> Point:
    """Return the point of a polygon that is nearest to u*."""
    return minimise(corners, count, distance(1.0, ux, uy), ux, uy, w)


@njit(cache=True)
def meet(count: int, rows: Rows, w: Workspace) -> int:
    """Keep the inputs that meet the rows or, where none does, violate them least (``min Σ δ²``)."""
    if rows.size == 1:  # a cut that cannot be met leaves the face of least violation
        row = rows[0]
        return cut(w.feasible, count, row_line(row, row.b), w) if _steers(row) else count
    new = count
    w.trial[:count] = w.feasible[:count]
    for k in range(rows.size):
        row = rows[k]
        if not _steers(row):
            continue
        line = row_line(row, row.b)
        _, highest = span(w.trial, new, line.nx, line.ny)
        if highest < line.d - THIN * w.radius:
            cost = Cost(rows, 0.0, 0.0, 0.0)
            w.graded[0] |= is_graded(cost, True, w.radius)
            x, y = soft_minimum(w.feasible, count, cost, w)
            return lock(w.feasible, count, cost, x, y, w)
        new = cut(w.trial, new, line, w)
    w.feasible[:new] = w.trial[:new]
    return new


@njit(cache=True)
def _steers(row: Any) -> bool:
    """Tell whether a row is more than a constant."""
    return row.norm > ZERO_GRADIENT


@njit(cache=True)
def relax(count: int, cost: Cost, w: Workspace) -> Point:
    """Return ``argmin λ_u ‖u − u*‖² + Σ λ_k max(m_k, b_k − a_k u)²``.

    For λ_u = 0 it is the minimiser nearest u*.
    """
    x, y = soft_minimum(w.feasible, count, cost, w)
    if cost.lambda_u > 0.0:
        return x, y
    w.graded[0] |= is_graded(cost, True, w.radius)
    w.trial[:count] = w.feasible[:count]
    count = lock(w.trial, count, cost, x, y, w)
    return nearest(w.trial, count, cost.ux, cost.uy, w)


@njit(cache=True)
def draw(count: int, cost: Cost, w: Workspace) -> Point:
    """Return ``argmin λ_u ‖u − u*‖² + Σ λ_k (t_k − a_k u)²`` with the rows' targets t_k."""
    w.graded[0] |= cost.lambda_u == 0.0 and is_graded(cost, False, w.radius)
    problem = distance(cost.lambda_u, cost.ux, cost.uy)
    for k in range(cost.rows.size):
        row = cost.rows[k]
        root = row.weight**0.5
        problem = add_row(problem, root * row.ax, root * row.ay, root * row.target)
    return minimise(w.feasible, count, problem, cost.ux, cost.uy, w)


@njit(cache=True)
def set_targets(vertices: Array, rows: Rows, ux: float, uy: float, w: Workspace) -> None:
    """Write ``a_k û_k`` of each row, û_k the solution of the program of that row alone."""
    corners = vertices.shape[0]
    x0, y0 = nearest(vertices, corners, ux, uy, w)
    for k in range(rows.size):
        row = rows[k]
        row.target = row.ax * x0 + row.ay * y0
        if row.target >= row.b or not _steers(row):
            continue
        w.trial[:corners] = vertices
        count = cut(w.trial, corners, row_line(row, row.b), w)
        x, y = nearest(w.trial, count, ux, uy, w)
        row.target = row.ax * x + row.ay * y


@njit(cache=True)
def pin(count: int, rows: Rows, x: float, y: float, w: Workspace) -> int:
    """Keep the inputs at which each row has the value that it has at u."""
    for k in range(rows.size):
        if _steers(rows[k]) and count > 1:
            line = row_line(rows[k], 0.0)
            here = line.nx * x + line.ny * y
            count = slice_at(w.feasible, count, Line(line.nx, line.ny, here), w)
    return count


@njit(cache=True)
def bound(count: int, rows: Rows, x: float, y: float, w: Workspace) -> int:
    """Keep the inputs at which no row is violated more than at u."""
    for k in range(rows.size):
        if _steers(rows[k]):
            line = row_line(rows[k], rows[k].b)
            here = min(line.d, line.nx * x + line.ny * y)
            count = cut(w.feasible, count, Line(line.nx, line.ny, here), w)
    return count
