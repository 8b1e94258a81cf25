"""The programs on one state, on polygons: the compiled counterpart of the cascades.

Rows come sorted by priority, so that a stage is a slice.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.programs.planar.polygon import (
    THIN,
    ZERO_GRADIENT,
    add_row,
    cut,
    minimise,
    slice_at,
)
from hcbf_gym.programs.planar.soft import lock, soft_minimum

Array = NDArray[np.float64]
Point = tuple[float, float]

# Rows of one stage that differ more in steepness are left to rational arithmetic: squared, the
# difference would eat half of the digits of their least squares.
GRADED = 1e3


class Workspace(NamedTuple):
    """What the kernels write to; made once for a whole batch.

    Attributes:
        feasible: (capacity, 2) the inputs that the stages so far leave.
        trial: (capacity, 2) a copy that may be thrown away.
        cell: (capacity, 2) for `soft_minimum`.
        first: (capacity, 2) for cuts.
        second: (capacity, 2) for cuts.
        state: (m,) for `soft_minimum`.
        zeros: (m,) zeros.
        ones: (m,) ones.
        target: (m,) ``a_k û_k``.
        graded: (1,) set where a stage's least squares are beyond doubles; see `is_graded`.
    """

    feasible: Array
    trial: Array
    cell: Array
    first: Array
    second: Array
    state: NDArray[np.int64]
    zeros: Array
    ones: Array
    target: Array
    graded: NDArray[np.bool_]


def make_workspace(corners: int, m: int) -> Workspace:
    """Return the working space for a U with so many corners, and m rows."""
    feasible, trial, cell, first, second = np.empty((5, corners + m + 2, 2))
    state = np.zeros(m, dtype=np.int64)
    zeros, ones, target, graded = np.zeros(m), np.ones(m), np.zeros(m), np.zeros(1, dtype=np.bool_)
    return Workspace(feasible, trial, cell, first, second, state, zeros, ones, target, graded)


@njit(cache=True)
def is_graded(a: Array, b: Array, weight: Array, radius: float) -> bool:
    """Tell whether ``√w_k ‖a_k‖`` of those rows that matter span more than `GRADED`.

    Args:
        a: (s, r) gradients.
        b: (s,) bounds; a row with ``a·u ≥ b`` throughout does not matter.
        weight: (s,) w_k.
        radius: the largest norm of an input.
    """
    flattest, steepest = np.inf, 0.0
    for k in range(weight.size):
        square = 0.0
        for j in range(a.shape[1]):
            square += a[k, j] * a[k, j]
        norm = np.sqrt(square)
        if weight[k] > 0.0 and norm > ZERO_GRADIENT and b[k] > -norm * radius:
            steepness = np.sqrt(weight[k]) * norm
            flattest, steepest = min(flattest, steepness), max(steepest, steepness)
    return steepest > GRADED * flattest


@njit(cache=True)
def project(corners: Array, count: int, ux: float, uy: float, radius: float, w: Workspace) -> Point:
    """Return the point of a polygon that is nearest to u*."""
    nearest = (1.0, 0.0, 1.0, ux, uy)
    return minimise(corners, count, nearest, ux, uy, radius, w.first, w.second)


@njit(cache=True)
def meet(count: int, a: Array, b: Array, radius: float, w: Workspace) -> int:
    """Cut the feasible polygon to the rows of one stage, or to where they are violated least.

    Args:
        count: the polygon's number of corners.
        a: (s, 2) the stage's gradients.
        b: (s,) its bounds.
        radius: the largest norm of an input.
        w: the working space; its `feasible` is cut in place.

    Returns:
        The new number of corners.
    """
    if b.size == 1:  # a cut that cannot be met leaves the face of least violation
        norm = np.hypot(a[0, 0], a[0, 1])
        if norm <= ZERO_GRADIENT:
            return count
        nx, ny, d = a[0, 0] / norm, a[0, 1] / norm, b[0] / norm
        return cut(w.feasible, count, nx, ny, d, radius, w.first)
    new = count
    w.trial[:count] = w.feasible[:count]
    for k in range(b.size):
        norm = np.hypot(a[k, 0], a[k, 1])
        if norm <= ZERO_GRADIENT:
            continue
        nx, ny, d = a[k, 0] / norm, a[k, 1] / norm, b[k] / norm
        if not _reaches(w.trial, new, nx, ny, d, radius):
            w.graded[0] |= is_graded(a, b, w.ones[: b.size], radius)
            x, y = soft_minimum(
                w.feasible, count, a, b, w.zeros, w.ones, 0.0, 0.0, 0.0, radius,
                w.cell, w.first, w.second, w.state,
            )  # fmt: skip
            return lock(w.feasible, count, a, b, w.zeros, w.ones, x, y, radius, w.first)
        new = cut(w.trial, new, nx, ny, d, radius, w.first)
    w.feasible[:new] = w.trial[:new]
    return new


@njit(cache=True)
def _reaches(corners: Array, count: int, nx: float, ny: float, d: float, radius: float) -> bool:
    highest = -np.inf
    for i in range(count):
        highest = max(highest, nx * corners[i, 0] + ny * corners[i, 1])
    return highest >= d - THIN * radius


@njit(cache=True)
def relax(
    count: int,
    a: Array,
    b: Array,
    least: Array,
    weight: Array,
    lambda_u: float,
    ux: float,
    uy: float,
    radius: float,
    w: Workspace,
) -> Point:
    """Return ``argmin λ_u ‖u − u*‖² + Σ λ_k max(m_k, b_k − a_k u)²`` over the feasible polygon."""
    x, y = soft_minimum(
        w.feasible, count, a, b, least, weight, lambda_u, ux, uy, radius,
        w.cell, w.first, w.second, w.state,
    )  # fmt: skip
    if lambda_u > 0.0:
        return x, y
    w.graded[0] |= is_graded(a, b - least, weight, radius)
    w.trial[:count] = w.feasible[:count]
    count = lock(w.trial, count, a, b, least, weight, x, y, radius, w.first)
    return project(w.trial, count, ux, uy, radius, w)


def least_cost(
    a: Array,
    target: Array,
    least: Array | None,
    weight: Array,
    rows: Array,
    lower: Array,
    radius: float,
) -> Array:
    """Return a minimiser of ``Σ w_k δ_k²`` over ``rows z ≥ lower``.

    Args:
        a: (s, r) gradients, with one or two free directions r.
        target: (s,) t_k.
        least: (s,) the least δ_k of ``a_k z + δ_k ≥ t_k``, or None for ``a_k z + δ_k = t_k``.
        weight: (s,) w_k.
        rows: (k, r) rows, of norms from 1/2 to 1, of a nonempty set of diameter 2 `radius` at most.
        lower: (k,) their bounds.
        radius: the largest norm of an input.
    """
    free = a.shape[1]
    w = make_workspace(4 + lower.size, target.size)
    size = 4.0 * radius
    if free == 1:
        count = 2
        w.feasible[:2] = [[-size, 0.0], [size, 0.0]]
        pad = ((0, 0), (0, 1))
        a, rows = np.pad(a, pad), np.pad(rows, pad)
    else:
        count = 4
        w.feasible[:4] = [[-size, -size], [size, -size], [size, size], [-size, size]]
    for (nx, ny), d in zip(rows, lower, strict=True):
        count = cut(w.feasible, count, nx, ny, d, radius, w.first)
    if least is None:
        z = draw(count, a, target, weight, 0.0, 0.0, 0.0, radius, w)
    else:
        z = soft_minimum(
            w.feasible, count, a, target, least, weight, 0.0, 0.0, 0.0, radius,
            w.cell, w.first, w.second, w.state,
        )  # fmt: skip
    return np.array(z[:free])


@njit(cache=True)
def draw(
    count: int,
    a: Array,
    target: Array,
    weight: Array,
    lambda_u: float,
    ux: float,
    uy: float,
    radius: float,
    w: Workspace,
) -> Point:
    """Return ``argmin λ_u ‖u − u*‖² + Σ λ_k (t_k − a_k u)²`` over the feasible polygon."""
    w.graded[0] |= lambda_u == 0.0 and is_graded(a, w.zeros[: target.size], weight, radius)
    root = np.sqrt(lambda_u)
    factor = (root, 0.0, root, root * ux, root * uy)
    for k in range(target.size):
        root = np.sqrt(weight[k])
        factor = add_row(factor, root * a[k, 0], root * a[k, 1], root * target[k])
    return minimise(w.feasible, count, factor, ux, uy, radius, w.first, w.second)


@njit(cache=True)
def set_targets(
    vertices: Array, a: Array, b: Array, ux: float, uy: float, radius: float, w: Workspace
) -> None:
    """Write ``a_k û_k`` of each row, û_k the solution of the program of that row alone."""
    count = vertices.shape[0]
    x0, y0 = project(vertices, count, ux, uy, radius, w)
    for k in range(b.size):
        w.target[k] = a[k, 0] * x0 + a[k, 1] * y0
        norm = np.hypot(a[k, 0], a[k, 1])
        if w.target[k] >= b[k] or norm <= ZERO_GRADIENT:
            continue
        w.trial[:count] = vertices
        nx, ny, d = a[k, 0] / norm, a[k, 1] / norm, b[k] / norm
        left = cut(w.trial, count, nx, ny, d, radius, w.first)
        x, y = project(w.trial, left, ux, uy, radius, w)
        w.target[k] = a[k, 0] * x + a[k, 1] * y


@njit(cache=True)
def pin(count: int, a: Array, x: float, y: float, radius: float, w: Workspace) -> int:
    """Cut the feasible polygon to where each row has the value it has at u; return the count."""
    for k in range(a.shape[0]):
        norm = np.hypot(a[k, 0], a[k, 1])
        if norm > ZERO_GRADIENT and count > 1:
            nx, ny = a[k, 0] / norm, a[k, 1] / norm
            count = slice_at(w.feasible, count, nx, ny, nx * x + ny * y, radius, w.first)
    return count


@njit(cache=True)
def explicit(
    count: int,
    a: Array,
    weight: Array,
    start: NDArray[np.int64],
    levels: int,
    lambda_u: float,
    ux: float,
    uy: float,
    radius: float,
    w: Workspace,
) -> Point:
    """Run EH-CBF-QP's stages 2, 3, … on the feasible polygon that stage 1 left.

    Args:
        count: the polygon's number of corners.
        a: (m, 2) gradients, sorted by priority.
        weight: (m,) λ_δk.
        start: (levels + 1,) where each priority's rows start.
        levels: the number of priorities.
        lambda_u: λ_u.
        ux: x component of u*.
        uy: y component of u*.
        radius: the largest norm of an input.
        w: the working space, its targets written.
    """
    x, y = project(w.feasible, count, ux, uy, radius, w)
    for level in range(1, levels):
        if count == 1:
            break
        i, j = start[level], start[level + 1]
        x, y = draw(count, a[i:j], w.target[i:j], weight[i:j], lambda_u, ux, uy, radius, w)
        count = pin(count, a[i:j], x, y, radius, w)
    return x, y


@njit(cache=True)
def lexicographic(
    count: int,
    a: Array,
    b: Array,
    weight: Array,
    start: NDArray[np.int64],
    levels: int,
    lambda_u: float,
    ux: float,
    uy: float,
    radius: float,
    w: Workspace,
) -> Point:
    """Run Lex-CBF-QP's stages 2, 3, … on the feasible polygon that stage 1 left.

    Args: as :func:`explicit`; a weight of infinity marks a row of a strict level.
    """
    for level in range(1, levels):
        if count == 1:
            break
        i, j = start[level], start[level + 1]
        if np.isinf(weight[i]):
            count = meet(count, a[i:j], b[i:j], radius, w)
            continue
        x, y = relax(count, a[i:j], b[i:j], w.zeros[i:j], weight[i:j], lambda_u, ux, uy, radius, w)
        for k in range(i, j):
            norm = np.hypot(a[k, 0], a[k, 1])
            if norm > ZERO_GRADIENT:
                nx, ny = a[k, 0] / norm, a[k, 1] / norm
                d = min(b[k] / norm, nx * x + ny * y)
                count = cut(w.feasible, count, nx, ny, d, radius, w.first)
    return project(w.feasible, count, ux, uy, radius, w)
