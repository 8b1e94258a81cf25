"""What a plan does stage by stage, for two inputs: compiled, for N states, on polygons.

`general.cascade` is the same for any number of inputs; the tests hold them together.

What `filter_range` calls here is inlined: across a call Numba counts the references to every array
of a record.
"""

import numpy as np

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.compilation import borrowed, kernel
from hcbf_gym.programs.planar import stages
from hcbf_gym.programs.planar.polygon import contains, copy, nearest
from hcbf_gym.programs.planar.records import (
    BOUND,
    DRAWN,
    FEASIBLE,
    PIN,
    RELAXED,
    Cost,
    Own,
    Point,
    Settings,
    Workspace,
    own_of,
)
from hcbf_gym.programs.result import FilterResult, FilterStatus, slack_of
from hcbf_gym.programs.tolerances import NOMINAL
from hcbf_gym.programs.weights import gamma0_of, weight_of

_NOMINAL, _SAFE = int(FilterStatus.NOMINAL), int(FilterStatus.SAFE)
_RELAXED, _VIOLATED = int(FilterStatus.RELAXED), int(FilterStatus.VIOLATED)


@kernel(error_model="numpy")
def filter_range(
    settings: Settings,
    u_nominal: Array,
    rows: CbfRows,
    answer: FilterResult,
    w: Workspace,
    first: int,
    end: int,
) -> None:
    """Filter those of N states from `first` on and before `end`; see the core's `cascade.hpp`."""
    settings, u_nominal = borrowed(settings), borrowed(u_nominal)
    rows, answer, w = borrowed(rows), borrowed(answer), borrowed(w)
    assert rows.alpha2_psi is not None
    for i in range(first, end):
        one = CbfRows(rows.a[i], rows.b[i], rows.h[i], rows.priority[i], rows.alpha2_psi[i])
        own, u, slack, delta = own_of(settings, i), answer.u[i], answer.slack[i], answer.delta[i]
        answer.status[i] = _filter_state(settings, own, u_nominal[i], one, u, slack, delta, w)
        answer.fallbacks[i] = 0


@kernel(error_model="numpy", inline="always")
def _filter_state(
    settings: Settings,
    own: Own,
    u_nominal: Array,
    rows: CbfRows,
    u: Array,
    slack: Array,
    delta: Array,
    w: Workspace,
) -> int:
    """Filter one nominal input, writing u (2,), slack (m,) and delta (m,); return the status."""
    ux, uy = u_nominal[0], u_nominal[1]
    if _allowed(own.vertices, rows, ux, uy):
        u[0], u[1] = ux, uy
        for k in range(slack.size):
            slack[k] = 0.0
            delta[k] = _least_slack(settings, rows, k)
        return _NOMINAL
    count = _sort(settings, own.weights, rows.priority, w)
    for k in range(slack.size):
        _load(settings, own.weights, rows, w.rows[k])
    x, y = _decide(settings, own.vertices, count, ux, uy, w)
    u[0], u[1] = x, y
    moved = max(abs(x - ux), abs(y - uy)) > NOMINAL * (1.0 + settings.radius)
    return _account(settings, _SAFE if moved else _NOMINAL, rows.priority, u, slack, delta, w)


@kernel(error_model="numpy", inline="always")
def _allowed(vertices: Array, rows: CbfRows, ux: float, uy: float) -> bool:
    """Return whether u* lies in U and meets every row."""
    for k in range(rows.b.size):
        if rows.a[k, 0] * ux + rows.a[k, 1] * uy < rows.b[k]:
            return False
    return contains(vertices, vertices.shape[0], ux, uy)


@kernel(error_model="numpy", inline="always")
def _least_slack(settings: Settings, rows: CbfRows, k: int) -> float:
    """Return δ_min of row k; with a known offset ``α₂(ψ + ε) − α₂(ψ) = max(0, −α₂(ψ))``."""
    if not settings.known_offset or rows.priority[k] <= 1:
        return 0.0
    assert rows.alpha2_psi is not None
    return max(0.0, -rows.alpha2_psi[k])


@kernel(error_model="numpy", inline="always")
def _stage(settings: Settings, weights: Array, priority: int) -> int:
    """Return the stage of the rows of a priority, from 1; of no row, which has priority 0, 0."""
    if settings.by_level or priority == 0:
        return priority
    return 1 if np.isinf(gamma0_of(weights, priority)) else 2


@kernel(error_model="numpy", inline="always")
def _sort(settings: Settings, weights: Array, priority: Integers, w: Workspace) -> int:
    """Sort by stage: ``w.rows[k].index``, and where each stage starts in ``w.start``.

    Returns:
        The number of stages.
    """
    start = w.start
    count = 0
    for k in range(priority.size):
        count = max(count, _stage(settings, weights, priority[k]))
    for stage in range(count + 2):
        start[stage] = 0
    for k in range(priority.size):
        start[_stage(settings, weights, priority[k])] += 1
    total = 0
    for stage in range(count + 1):  # start[s] becomes where stage s's rows are to go next
        size = start[stage]
        start[stage] = total
        total += size
    for k in range(priority.size):
        stage = _stage(settings, weights, priority[k])
        row: np.record = w.rows[int(start[stage])]
        row.index = k
        start[stage] += 1
    return count


@kernel(error_model="numpy", inline="always")
def _load(settings: Settings, weights: Array, rows: CbfRows, row: np.record) -> None:
    """Fill in a row whose index is set."""
    k: int = row.index
    row.ax = rows.a[k, 0]
    row.ay = rows.a[k, 1]
    row.b = rows.b[k]
    row.norm = np.hypot(row.ax, row.ay)
    weight = weight_of(weights, rows.priority[k], rows.h[k])
    row.strict = np.isinf(weight)
    row.weight = 1.0 if row.strict else weight
    row.least = _least_slack(settings, rows, k)


@kernel(error_model="numpy", inline="always")
def _decide(
    settings: Settings, vertices: Array, stage_count: int, ux: float, uy: float, w: Workspace
) -> Point:
    """Run the stages on rows sorted by them."""
    feasible = w.polygons[FEASIBLE]
    count = vertices.shape[0]
    copy(vertices, count, feasible)
    if settings.lower == DRAWN:
        stages.set_targets(vertices, w.rows, ux, uy, w)
    x, y, found = 0.0, 0.0, False
    for stage in range(stage_count):
        rows = w.rows[w.start[stage] : w.start[stage + 1]]
        if rows.size == 0:
            continue
        if count == 1:
            break  # nothing is left to decide
        if rows[0].strict:
            count = stages.meet(count, rows, w)
            found = False
        elif settings.lower == RELAXED:
            x, y = stages.relax(count, Cost(rows, settings.lambda_u, ux, uy), w)
            found = True
        elif settings.lower == DRAWN:
            x, y = stages.draw(count, Cost(rows, settings.lambda_u, ux, uy), w)
            found = True
        if found and settings.lock == PIN:
            count = stages.pin(count, rows, x, y, w)
        elif found and settings.lock == BOUND:
            count = stages.bound(count, rows, x, y, w)
    return (x, y) if found else nearest(feasible, count, ux, uy)


@kernel(error_model="numpy", inline="always")
def _account(
    settings: Settings,
    status: int,
    priority: Integers,
    u: Array,
    slack: Array,
    delta: Array,
    w: Workspace,
) -> int:
    """Write what each row pays at u; return the status, given that of an input without slack."""
    for k in range(slack.size):
        row = w.rows[k]
        value = row.ax * u[0] + row.ay * u[1]
        paid = slack_of(row.b - value, row.norm, row.b, settings.radius)
        slack[row.index] = delta[row.index] = paid
        if not row.strict and settings.lower == RELAXED:
            delta[row.index] = max(paid, row.least)
        elif not row.strict and settings.lower == DRAWN:
            delta[row.index] = row.target - value
        if paid > 0.0:
            gives_way = settings.ranks and priority[row.index] > 1
            status = max(status, _RELAXED if gives_way else _VIOLATED)
    return status
