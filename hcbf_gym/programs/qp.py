"""QP solvers by name, as second opinions: each answers the core's projections on polyhedra.

All read ``minimise ½‖x − centre‖² subject to a x ≥ lower``, rows of norms from 1/2 to 1. A solver's
status is read and its point is checked. Each is imported when it is first called: without a name
none is.
"""

import functools
import importlib
import warnings
from collections.abc import Callable
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.errors import SolverError, choose

PRIMAL = 1e-7
"""The distance by which a solver's point may miss a row, relative to 1 + max|x|."""

# DAQP once more, where it denies that a problem has a solution which it has by construction: slacks
# of 1e5 leave no digits for its usual tolerance.
LOOSE_DAQP = "daqp, loosely"
# The last resort: slacks of millions leave no solver the digits that tell it from infeasible.
CORE = "the core"

# Where a solver's own default is too loose to pass that check.
SETTINGS: dict[str, dict[str, Any]] = {
    "osqp": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 20000},
    "scs": {"eps_abs": 1e-9, "eps_rel": 1e-9},
    "proxqp": {"eps_abs": 1e-10, "eps_rel": 0.0},
    "piqp": {"eps_abs": 1e-10, "eps_rel": 1e-10},
}


class QpProblem(NamedTuple):
    """``minimise ½‖x − centre‖²  subject to  a x ≥ lower``: (n,), (k, n) and (k,)."""

    centre: Array
    a: Array
    lower: Array


class QpStatus(Enum):
    """What is known about a problem after the attempt to solve it."""

    OPTIMAL = "optimal"
    INFEASIBLE = "infeasible"
    FAILED = "failed"


Answer = tuple[Array | None, QpStatus]
"""The minimiser (n,), None unless the status is OPTIMAL; and the status."""


def solver_names() -> list[str]:
    """Return the names that `solver` may take on this machine."""
    return sorted({"daqp", "clarabel", *_qpsolvers().available_solvers})


def check_solver(name: str) -> str:
    """Return `name`.

    Raises:
        UnknownNameError: if no solver of that name is installed; the message lists those that are.
    """
    if isinstance(name, str) and name in ("daqp", "clarabel"):  # which need no look around
        return name
    return choose("solver", name, {known: known for known in solver_names()})


def solve(problem: QpProblem, solver: str) -> Answer:
    """Solve one problem with one of :func:`solver_names`; a point that misses a row is FAILED."""
    x, status = _backend(solver)(problem)
    if x is None or status is not QpStatus.OPTIMAL:
        return None, status
    missed = (problem.lower - problem.a @ x).max(initial=0.0)
    if not missed <= PRIMAL * (1.0 + np.abs(x).max()):  # NaN fails
        return None, QpStatus.FAILED
    return x, status


@functools.cache
def _backend(name: str) -> Callable[[QpProblem], Answer]:
    direct: dict[str, Callable[[QpProblem], Answer]] = {
        "daqp": _daqp,
        LOOSE_DAQP: functools.partial(_daqp, tolerance=1e-7),
        "clarabel": _clarabel,
        CORE: lambda problem: _answer(
            _core.nearest_point(problem.a, problem.lower, problem.centre)
        ),
    }
    return direct.get(name) or functools.partial(_through_qpsolvers, name)


def _answer(x: Array | None, infeasible: bool = False) -> Answer:
    if x is not None:
        return np.ascontiguousarray(x, np.float64), QpStatus.OPTIMAL
    return None, QpStatus.INFEASIBLE if infeasible else QpStatus.FAILED


def _daqp(problem: QpProblem, tolerance: float = 1e-9) -> Answer:
    import daqp

    centre, a, lower = problem
    upper, sense = np.full(lower.size, np.inf), np.zeros(lower.size, dtype=np.intc)
    identity = np.eye(centre.size)
    x, _, flag, _ = daqp.solve(identity, -centre, a, upper, lower, sense, primal_tol=tolerance)
    return _answer(x if flag == 1 else None, infeasible=flag == -1)


def _clarabel(problem: QpProblem) -> Answer:
    import scipy.sparse
    from clarabel import (
        clarabel,  # pyright: ignore[reportAttributeAccessIssue]  # compiled, comes without stubs
    )

    centre, a, lower = problem
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    identity = scipy.sparse.csc_matrix(np.eye(centre.size))
    rows = scipy.sparse.csc_matrix(-a)
    cones = [clarabel.NonnegativeConeT(lower.size)]
    answer = clarabel.DefaultSolver(identity, -centre, rows, -lower, cones, settings).solve()
    status = clarabel.SolverStatus
    # the last two of those that found a point missed 1e-12; the check in `solve` decides
    found = (status.Solved, status.AlmostSolved, status.InsufficientProgress)
    infeasible = (status.PrimalInfeasible, status.AlmostPrimalInfeasible)
    x = np.array(answer.x) if answer.status in found else None
    return _answer(x, answer.status in infeasible)


def _qpsolvers() -> Any:
    """Return the module, imported at need: it imports all that it finds, JAX and others for 1 s."""
    return importlib.import_module("qpsolvers")


def _through_qpsolvers(name: str, problem: QpProblem) -> Answer:
    import scipy.sparse

    qpsolvers = _qpsolvers()
    centre, a, lower = problem
    matrix = np.asarray if name in qpsolvers.dense_solvers else scipy.sparse.csc_matrix
    quadratic = qpsolvers.Problem(matrix(np.eye(centre.size)), -centre, matrix(-a), -lower)
    with warnings.catch_warnings():  # backends warn of their own deprecations and of accuracy
        warnings.simplefilter("ignore")
        answer = qpsolvers.solve_problem(quadratic, solver=name, **SETTINGS.get(name, {}))
    # qpsolvers does not distinguish an infeasible problem from a failed attempt
    return _answer(answer.x if answer.found else None)


class Solver:
    """A solver with its second opinion, which counts how often that was needed.

    Args:
        name: one of :func:`solver_names`.
    """

    def __init__(self, name: str) -> None:
        self.name, self.fallbacks = name, 0
        self.second = "daqp" if name == "clarabel" else "clarabel"

    def project(self, centre: Array, a: Array, lower: Array, nonempty: bool) -> Array | None:
        """Return the minimiser (n,), or None if the problem is infeasible or remains unsolved.

        Args:
            centre: (n,) the point to stay near.
            a: (k, n) rows.
            lower: (k,) their bounds.
            nonempty: whether it has a solution by construction: then None is not returned.

        Raises:
            SolverError: if it has one, and neither solver finds it, nor the core.
        """
        problem = QpProblem(centre, a, lower)
        x, status = solve(problem, self.name)
        if x is not None or (status is QpStatus.INFEASIBLE and not nonempty):
            return x
        if nonempty and self.name == "daqp":
            x, _ = solve(problem, LOOSE_DAQP)
        if x is None:
            self.fallbacks += 1
            x, _ = solve(problem, self.second)
        if x is None and nonempty:
            x, _ = solve(problem, CORE)
            if x is None:
                raise SolverError(f"neither {self.name} nor {self.second} solved {problem}")
        return x
