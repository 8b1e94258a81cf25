"""Filters plants by a solver that the user names, in place of the compiled program."""

from typing import Any

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import SolverError
from hcbf_gym.programs import FilterResult, FilterStatus, Program

DONE, NOT_FINITE, MISSHAPED, DUE = range(4)
"""The result of a step: it is complete, u* is not finite, the scenes are not of these plants, or a
warning or a user's own brake is due."""


def filter_by_solver(program: Program, core: Any, count: int) -> int:
    """Filter `count` plants, one after the other, by a program that calls a solver.

    `core` is the `_core.Filter` that poses their problems and writes their reports.

    Returns:
        The result of the step, such as `DONE`.
    """
    result_code = core.check()
    if result_code != DONE:
        return result_code
    for i in range(count):
        if not core.pose(i):  # plant i brakes without a program
            result_code = max(result_code, DUE)
            continue
        u_nominal, a, b, h, alpha2_psi, priority = core.problem()
        result = solve(program, u_nominal, CbfRows(a, b, h, priority, alpha2_psi))
        status, fallbacks = FilterStatus.BACKUP, 0
        if result is not None:
            u, slack, delta = core.answer()
            u[:], slack[:], delta[:] = result.u, result.slack, result.delta
            status, fallbacks = result.status, result.fallbacks
        closed = core.close(i, result is not None, int(status), int(fallbacks))
        result_code = max(result_code, closed)
    return result_code


def solve(program: Program, u_nominal: Array, rows: CbfRows) -> FilterResult | None:
    """Return a program's result for one plant; None if no solver finds a finite one.

    Args:
        program: the program with its solver.
        u_nominal: (n_u,) u*.
        rows: m rows; the priority is 0 where a scene has no row.
    """
    has_row = rows.priority > 0
    psi = None if rows.alpha2_psi is None else rows.alpha2_psi[has_row]
    a, b, h = rows.a[has_row], rows.b[has_row], rows.h[has_row]
    present = CbfRows(a, b, h, rows.priority[has_row], psi)
    try:
        result = program(u_nominal, without_gaps(present))
    except (SolverError, ArithmeticError, np.linalg.LinAlgError):
        return None
    if result.status == FilterStatus.BACKUP or not np.isfinite(result.u).all():
        return None
    slack, delta = np.zeros((2, rows.b.size))  # without the row that `without_gaps` may append
    slack[has_row], delta[has_row] = result.slack[: b.size], result.delta[: b.size]
    return result._replace(slack=slack, delta=delta)


def without_gaps(rows: CbfRows) -> CbfRows:
    """Return rows whose priorities are 1, 2, … without a gap.

    Barriers without a row leave gaps. Rows of priority 1 keep it, because they are strict. If there
    are none, a row of priority 1 that every input meets is appended.
    """
    if _core.has_no_gap(rows.priority):
        return rows
    ranks = np.unique(rows.priority)
    lower = ranks[ranks > 1]
    priority = np.where(rows.priority == 1, 1, 2 + np.searchsorted(lower, rows.priority))
    rows = rows._replace(priority=priority)
    if ranks[0] == 1:
        return rows
    psi = None if rows.alpha2_psi is None else np.append(rows.alpha2_psi, 0.0)
    return CbfRows(
        a=np.vstack([rows.a, np.zeros(rows.a.shape[1])]),
        b=np.append(rows.b, -1.0),
        h=np.append(rows.h, 1.0),
        priority=np.append(priority, 1),
        alpha2_psi=psi,
    )
