"""The cascades of `programs.cascades`, compiled: one state, or N of them, on polygons.

`filter_batch` can be called from other compiled code; it allocates once for all N states. What it
calls here is inlined: across a call Numba counts the references to every array of a record.
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.compilation import borrowed
from hcbf_gym.programs.planar import stages
from hcbf_gym.programs.planar.polygon import contains, copy, nearest
from hcbf_gym.programs.planar.records import (
    CBF,
    EXPLICIT,
    FEASIBLE,
    HIERARCHICAL,
    LEXICOGRAPHIC,
    RELAXED,
    Array,
    Cost,
    Point,
    Settings,
    Workspace,
    make_workspace,
)
from hcbf_gym.programs.result import FilterResult, FilterStatus
from hcbf_gym.programs.tolerances import NOMINAL, SLACK

Integers = NDArray[np.int64]

GRADED = -1
"""The status of a state that is left to rational arithmetic."""
_NOMINAL, _SAFE = int(FilterStatus.NOMINAL), int(FilterStatus.SAFE)
_RELAXED, _VIOLATED = int(FilterStatus.RELAXED), int(FilterStatus.VIOLATED)


@njit(cache=True, error_model="numpy")
def filter_batch(settings: Settings, u_nominal: Array, rows: CbfRows, answer: FilterResult) -> None:
    """Filter the nominal inputs of N states.

    Args:
        settings: the program.
        u_nominal: (N, 2) u*.
        rows: the rows of N states, finite, priorities from 1 to `LOWEST_RANK`; m ≥ 0. `alpha2_psi`
            is an array even where the program does not read it.
        answer: written to: u (N, 2), slack (N, m), delta (N, m), status (N,) a `FilterStatus` or
            `GRADED`, fallbacks (N,) zeros.
    """
    w = make_workspace(settings.radius, settings.vertices.shape[0], rows.b.shape[1])
    filter_range(settings, u_nominal, rows, answer, w, 0, u_nominal.shape[0])


@njit(cache=True, error_model="numpy")
def filter_range(
    settings: Settings,
    u_nominal: Array,
    rows: CbfRows,
    answer: FilterResult,
    w: Workspace,
    first: int,
    end: int,
) -> None:
    """Filter those of N states from `first` on and before `end`; see `filter_batch`."""
    settings, u_nominal = borrowed(settings), borrowed(u_nominal)
    rows, answer, w = borrowed(rows), borrowed(answer), borrowed(w)
    assert rows.alpha2_psi is not None
    for i in range(first, end):
        one = CbfRows(rows.a[i], rows.b[i], rows.h[i], rows.priority[i], rows.alpha2_psi[i])
        weights = settings.weights[i if settings.weights.shape[0] > 1 else 0]
        answer.status[i] = _filter_state(
            settings, weights, u_nominal[i], one, answer.u[i], answer.slack[i], answer.delta[i], w
        )
        answer.fallbacks[i] = 0


@njit(cache=True, error_model="numpy")
def filter_state(
    settings: Settings, u_nominal: Array, rows: CbfRows, u: Array, slack: Array, delta: Array
) -> int:
    """Filter the nominal input of one state, without the leading N; return its status."""
    w = make_workspace(settings.radius, settings.vertices.shape[0], slack.size)
    return _filter_state(settings, settings.weights[0], u_nominal, rows, u, slack, delta, w)


@njit(cache=True, error_model="numpy", inline="always")
def _filter_state(
    settings: Settings,
    weights: Array,
    u_nominal: Array,
    rows: CbfRows,
    u: Array,
    slack: Array,
    delta: Array,
    w: Workspace,
) -> int:
    """Filter one nominal input, writing u (2,), slack (m,) and delta (m,); return the status."""
    ux, uy = u_nominal[0], u_nominal[1]
    if _allowed(settings.vertices, rows, ux, uy):
        u[0], u[1] = ux, uy
        for k in range(slack.size):
            slack[k] = 0.0
            delta[k] = _least_slack(settings, rows, k)
        return _NOMINAL
    levels = _sort(rows.priority, w)
    for k in range(slack.size):
        _load(settings, weights, rows, w.rows[k])
    w.graded[0] = False
    x, y = _decide(settings, levels, ux, uy, w)
    if w.graded[0]:
        return GRADED
    u[0], u[1] = x, y
    moved = max(abs(x - ux), abs(y - uy)) > NOMINAL * (1.0 + settings.radius)
    return _account(settings, _SAFE if moved else _NOMINAL, u, slack, delta, w)


@njit(cache=True, error_model="numpy", inline="always")
def _allowed(vertices: Array, rows: CbfRows, ux: float, uy: float) -> bool:
    """Tell whether u* lies in U and meets every row."""
    for k in range(rows.b.size):
        if rows.a[k, 0] * ux + rows.a[k, 1] * uy < rows.b[k]:
            return False
    return contains(vertices, vertices.shape[0], ux, uy)


@njit(cache=True, error_model="numpy", inline="always")
def _least_slack(settings: Settings, rows: CbfRows, k: int) -> float:
    """Return δ_min of row k; with a known offset ``α₂(ψ + ε) − α₂(ψ) = max(0, −α₂(ψ))``."""
    if not settings.known_offset or rows.priority[k] == 1:
        return 0.0
    assert rows.alpha2_psi is not None
    return max(0.0, -rows.alpha2_psi[k])


@njit(cache=True, error_model="numpy", inline="always")
def _sort(priority: Integers, w: Workspace) -> int:
    """Sort by priority: ``w.rows[k].index``, and where each level starts in ``w.start``.

    Returns:
        The number of levels.
    """
    start, levels = w.start, 0
    for k in range(priority.size):
        levels = max(levels, priority[k])
    for level in range(levels + 2):
        start[level] = 0
    for k in range(priority.size):
        start[priority[k]] += 1
    total = 0
    for level in range(levels + 1):  # start[p] becomes where level p's rows are to go next
        count = start[level]
        start[level] = total
        total += count
    for k in range(priority.size):
        row: Any = w.rows[start[priority[k]]]
        row.index = k
        start[priority[k]] += 1
    return levels


@njit(cache=True, error_model="numpy", inline="always")
def _load(settings: Settings, weights: Array, rows: CbfRows, row: Any) -> None:
    """Fill in a row whose index is set; λ_δ(h) is γ₀, times 1 + Δγ |h| where h < 0."""
    k = row.index
    row.ax, row.ay, row.b = rows.a[k, 0], rows.a[k, 1], rows.b[k]
    row.norm = np.hypot(row.ax, row.ay)
    gamma0 = weights[min(rows.priority[k] - 1, weights.size - 1)]
    row.strict = rows.priority[k] == 1 or settings.kind == CBF or np.isinf(gamma0)
    row.weight = 1.0 if row.strict else gamma0 * (1.0 + weights[0] * max(0.0, -rows.h[k]))
    row.least = _least_slack(settings, rows, k)


@njit(cache=True, error_model="numpy", inline="always")
def _decide(settings: Settings, levels: int, ux: float, uy: float, w: Workspace) -> Point:
    """Run one program on rows sorted by priority."""
    vertices, rows = settings.vertices, w.rows
    count = vertices.shape[0]
    copy(vertices, count, w.polygons[FEASIBLE])
    if settings.kind == CBF:
        count = stages.meet(count, rows, w)
        return nearest(w.polygons[FEASIBLE], count, ux, uy)
    strict = w.start[1]
    count = stages.meet(count, rows[:strict], w)
    lower = rows[strict:]
    if settings.kind == LEXICOGRAPHIC:
        return _lexicographic(count, levels, Cost(rows, settings.lambda_u, ux, uy), w)
    if settings.kind == RELAXED:
        return stages.relax(count, Cost(lower, settings.lambda_u, ux, uy), w)
    stages.set_targets(vertices, lower, ux, uy, w)
    if settings.kind == HIERARCHICAL:
        return stages.draw(count, Cost(lower, settings.lambda_u, ux, uy), w)
    return _explicit(count, levels, Cost(rows, settings.lambda_u, ux, uy), w)


@njit(cache=True, error_model="numpy", inline="always")
def _explicit(count: int, levels: int, cost: Cost, w: Workspace) -> Point:
    """Run EH-CBF-QP's stages 2, 3, … on the inputs that stage 1 left."""
    x, y = nearest(w.polygons[FEASIBLE], count, cost.ux, cost.uy)
    for level in range(1, levels):
        if count == 1:
            break  # nothing is left to decide
        rows = cost.rows[w.start[level] : w.start[level + 1]]
        if rows.size == 0:
            continue
        x, y = stages.draw(count, Cost(rows, cost.lambda_u, cost.ux, cost.uy), w)
        count = stages.pin(count, rows, x, y, w)
    return x, y


@njit(cache=True, error_model="numpy", inline="always")
def _lexicographic(count: int, levels: int, cost: Cost, w: Workspace) -> Point:
    """Run Lex-CBF-QP's stages 2, 3, … on the inputs that stage 1 left."""
    for level in range(1, levels):
        if count == 1:
            break
        rows = cost.rows[w.start[level] : w.start[level + 1]]
        if rows.size == 0:
            continue
        if rows[0].strict:
            count = stages.meet(count, rows, w)
        else:
            x, y = stages.relax(count, Cost(rows, cost.lambda_u, cost.ux, cost.uy), w)
            count = stages.bound(count, rows, x, y, w)
    return nearest(w.polygons[FEASIBLE], count, cost.ux, cost.uy)


@njit(cache=True, error_model="numpy", inline="always")
def _account(
    settings: Settings, status: int, u: Array, slack: Array, delta: Array, w: Workspace
) -> int:
    """Write what each row pays at u; return the status, given that of an input without slack."""
    for k in range(slack.size):
        row = w.rows[k]
        value = row.ax * u[0] + row.ay * u[1]
        lack = row.b - value
        rounding = SLACK * (row.norm * settings.radius + abs(row.b))
        paid = lack if lack > rounding else 0.0
        slack[row.index] = delta[row.index] = paid
        lower = k >= w.start[1]
        if lower and settings.kind == RELAXED:
            delta[row.index] = max(paid, row.least)
        elif lower and settings.kind in (HIERARCHICAL, EXPLICIT):
            delta[row.index] = row.target - value
        if paid > 0.0:
            gives_way = lower and settings.kind != CBF
            status = max(status, _RELAXED if gives_way else _VIOLATED)
    return status
