"""What the compiled cascade is made of: its stages, on polygons.

The polygon `FEASIBLE` holds the inputs that the stages so far leave. A stage that narrows them cuts
it in place and returns the new number of its corners.
"""

import numpy as np

from hcbf_gym.arrays import Array, Records
from hcbf_gym.compilation import kernel
from hcbf_gym.programs.planar.polygon import (
    LeastSquares,
    add_row,
    copy,
    cut,
    distance,
    minimise,
    nearest,
    slice_at,
    span,
)
from hcbf_gym.programs.planar.records import (
    FEASIBLE,
    TRIAL,
    Cost,
    Line,
    Point,
    Workspace,
    row_line,
)
from hcbf_gym.programs.planar.soft import drop, flattest_that_counts, keep_least, soft_minimum
from hcbf_gym.programs.tolerances import THIN, ZERO_GRADIENT


@kernel(error_model="numpy")
def meet(count: int, rows: Records, w: Workspace) -> int:
    """Keep the inputs that meet the rows or, where none does, violate them least (``min Σ δ²``)."""
    feasible = w.polygons[FEASIBLE]
    trial = w.polygons[TRIAL]
    new = count
    if rows.size == 1:  # a cut that cannot be met leaves the face of least violation
        row = rows[0]
        return cut(feasible, count, row_line(row, row.b), w.radius) if _steers(row) else count
    copy(feasible, count, trial)
    for k in range(rows.size):
        row = rows[k]
        if not _steers(row):
            continue
        line = row_line(row, row.b)
        _, highest = span(trial, new, line.nx, line.ny)
        if highest < line.d - THIN * w.radius:
            return keep_least(feasible, count, Cost(rows, 0.0, 0.0, 0.0), w)[0]
        new = cut(trial, new, line, w.radius)
    copy(trial, new, feasible)
    return new


@kernel(error_model="numpy")
def _steers(row: np.record) -> bool:
    """Return whether a row is more than a constant."""
    return row.norm > ZERO_GRADIENT


@kernel(error_model="numpy")
def relax(count: int, cost: Cost, w: Workspace) -> Point:
    """Return ``argmin λ_u ‖u − u*‖² + Σ λ_k max(m_k, b_k − a_k u)²``.

    For λ_u = 0 it is the minimiser nearest u*.
    """
    feasible, trial = w.polygons[FEASIBLE], w.polygons[TRIAL]
    if cost.lambda_u > 0.0:
        return soft_minimum(feasible, count, cost, w)
    copy(feasible, count, trial)
    count, _, _ = keep_least(trial, count, cost, w)
    return nearest(trial, count, cost.ux, cost.uy)


@kernel(error_model="numpy")
def draw(count: int, cost: Cost, w: Workspace) -> Point:
    """Return ``argmin λ_u ‖u − u*‖² + Σ λ_k (t_k − a_k u)²`` with the rows' targets t_k.

    For λ_u = 0 steep rows come first where flat ones would drown in their rounding; `keep_least`.
    """
    corners = w.polygons[FEASIBLE]
    x, y = minimise(corners, count, _drawn(cost), cost.ux, cost.uy, w)
    if cost.lambda_u > 0.0:
        return x, y
    floor = flattest_that_counts(cost.rows)
    if floor > 0.0:
        corners = w.polygons[TRIAL]
        copy(w.polygons[FEASIBLE], count, corners)
    while floor > 0.0:
        for k in range(cost.rows.size):
            row = cost.rows[k]
            if row.weight**0.5 * row.norm >= floor and count > 1:
                line = row_line(row, 0.0)
                here = line.nx * x + line.ny * y
                count = slice_at(corners, count, Line(line.nx, line.ny, here), w.radius)
        drop(cost.rows, floor)
        x, y = minimise(corners, count, _drawn(cost), cost.ux, cost.uy, w)
        floor = flattest_that_counts(cost.rows)
    return x, y


@kernel(error_model="numpy")
def _drawn(cost: Cost) -> LeastSquares:
    problem = distance(cost.lambda_u, cost.ux, cost.uy)
    for k in range(cost.rows.size):
        row = cost.rows[k]
        root = row.weight**0.5
        problem = add_row(problem, root * row.ax, root * row.ay, root * row.target)
    return problem


@kernel(error_model="numpy")
def set_targets(vertices: Array, rows: Records, ux: float, uy: float, w: Workspace) -> None:
    """Write ``a_k û_k`` of each row that is not strict, û_k its own program's solution."""
    corners = vertices.shape[0]
    trial = w.polygons[TRIAL]
    x0, y0 = nearest(vertices, corners, ux, uy)
    for k in range(rows.size):
        row = rows[k]
        if row.strict:
            continue
        row.target = row.ax * x0 + row.ay * y0
        if row.target >= row.b or not _steers(row):
            continue
        copy(vertices, corners, trial)
        count = cut(trial, corners, row_line(row, row.b), w.radius)
        x, y = nearest(trial, count, ux, uy)
        row.target = row.ax * x + row.ay * y


@kernel(error_model="numpy")
def pin(count: int, rows: Records, x: float, y: float, w: Workspace) -> int:
    """Keep the inputs at which each row has the value that it has at u."""
    for k in range(rows.size):
        if _steers(rows[k]) and count > 1:
            line = row_line(rows[k], 0.0)
            here = line.nx * x + line.ny * y
            count = slice_at(w.polygons[FEASIBLE], count, Line(line.nx, line.ny, here), w.radius)
    return count


@kernel(error_model="numpy")
def bound(count: int, rows: Records, x: float, y: float, w: Workspace) -> int:
    """Keep the inputs at which no row is violated more than at u."""
    for k in range(rows.size):
        if _steers(rows[k]):
            line = row_line(rows[k], rows[k].b)
            here = min(line.d, line.nx * x + line.ny * y)
            count = cut(w.polygons[FEASIBLE], count, Line(line.nx, line.ny, here), w.radius)
    return count
