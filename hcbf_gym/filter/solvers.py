"""A program that is solved by a solver by name, in the place of the compiled program."""

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


def answer(program: Program, posed: Any, count: int) -> int:
    """Filter N plants by a program's answers, and return the result of the step, such as `DONE`.

    Args:
        program: with its solver.
        posed: the `_core.Filter` that poses the problems, one plant after the other.
        count: N.
    """
    result_code = posed.check()
    if result_code != DONE:
        return result_code
    for i in range(count):
        if not posed.pose(i):
            result_code = max(result_code, DUE)
            continue
        u, a, b, h, alpha2_psi, priority = posed.problem()
        result = solve(program, u, CbfRows(a, b, h, priority, alpha2_psi))
        status, fallbacks = FilterStatus.BACKUP, 0
        if result is not None:
            for place, value in zip(posed.answer(), result, strict=False):
                place[:] = value
            status, fallbacks = result.status, result.fallbacks
        closed = posed.close(i, result is not None, int(status), int(fallbacks))
        result_code = max(result_code, closed)
    return result_code


def solve(program: Program, u_nominal: Array, rows: CbfRows) -> FilterResult | None:
    """Return a program's answer; None where no solver has one that is finite.

    Args:
        program: with its solver.
        u_nominal: (n_u,) u*.
        rows: (m,) of rank 0 where there is no row.
    """
    there = rows.priority > 0
    psi = None if rows.alpha2_psi is None else rows.alpha2_psi[there]
    kept = CbfRows(rows.a[there], rows.b[there], rows.h[there], rows.priority[there], psi)
    try:
        result = program(u_nominal, without_gaps(kept))
    except (SolverError, ArithmeticError, np.linalg.LinAlgError):
        return None
    if result.status == FilterStatus.BACKUP or not np.isfinite(result.u).all():
        return None
    slack, delta = np.zeros((2, rows.b.size))
    slack[there], delta[there] = result.slack[: kept.b.size], result.delta[: kept.b.size]
    return result._replace(slack=slack, delta=delta)


def without_gaps(rows: CbfRows) -> CbfRows:
    """Return rows whose ranks are 1, 2, …: barriers that are not in sight leave gaps.

    Where nothing strict is in sight, a last row of rank 1 requires nothing.
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
        np.vstack([rows.a, np.zeros(rows.a.shape[1])]),
        np.append(rows.b, -1.0),
        np.append(rows.h, 1.0),
        np.append(priority, 1),
        psi,
    )
