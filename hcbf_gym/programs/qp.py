"""QP solvers by name, in the place of the core: every stage is a projection on a polyhedron.

After scaling, all read ``minimise ½‖x − centre‖² subject to a x ≥ lower``, rows of norm near 1.
DAQP, Clarabel and any solver that qpsolvers finds can answer. A solver's status is read and its
point is checked. Each is imported when it is first called: without a name none is.
"""

import functools
import importlib
import warnings
from collections.abc import Callable
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.errors import SolverError, choose

PRIMAL = 1e-7
"""The distance by which a solver's point may miss a row, relative to 1 + max|x|, before it is not
accepted."""

# DAQP once more, where it denies that a problem has a solution which it has by construction: slacks
# of 1e5 leave no digits for its usual tolerance.
LOOSE_DAQP = "daqp, loosely"

# Where a solver's own default is too loose to pass that check.
SETTINGS: dict[str, dict[str, Any]] = {
    "osqp": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 20000},
    "scs": {"eps_abs": 1e-9, "eps_rel": 1e-9},
    "proxqp": {"eps_abs": 1e-10, "eps_rel": 0.0},
    "piqp": {"eps_abs": 1e-10, "eps_rel": 1e-10},
}


class QpProblem(NamedTuple):
    """``minimise ½‖x − centre‖²  subject to  a x ≥ lower``.

    Attributes:
        centre: (n,) the point to stay near.
        a: (k, n) rows, of norms from 1/2 to 1.
        lower: (k,) lower bounds.
    """

    centre: Array
    a: Array
    lower: Array


class QpStatus(Enum):
    """What is known about a problem after the attempt to solve it."""

    OPTIMAL = "optimal"
    INFEASIBLE = "infeasible"
    FAILED = "failed"


class QpSolution(NamedTuple):
    """The outcome of one attempt.

    Attributes:
        x: (n,) the minimiser; only for status OPTIMAL, else None.
        status: the outcome.
        solver: who answered.
    """

    x: Array | None
    status: QpStatus
    solver: str


Backend = Callable[[QpProblem], tuple[Array | None, QpStatus]]


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


def solve(problem: QpProblem, solver: str = "daqp") -> QpSolution:
    """Solve one problem with one solver, and check what it returns.

    Args:
        problem: the projection to compute.
        solver: one of :func:`solver_names`.

    Returns:
        The solution. A point that misses a row by more than `PRIMAL` has status FAILED.
    """
    x, status = _backend(solver)(problem)
    if x is None or status is not QpStatus.OPTIMAL:
        return QpSolution(None, status, solver)
    if not _core.meets(problem.a, problem.lower, x, PRIMAL):
        return QpSolution(None, QpStatus.FAILED, solver)
    return QpSolution(x, status, solver)


@functools.cache
def _backend(name: str) -> Backend:
    direct: dict[str, Backend] = {
        "daqp": _daqp,
        LOOSE_DAQP: functools.partial(_daqp, tolerance=1e-7),
        "clarabel": _clarabel,
    }
    return direct.get(name) or functools.partial(_through_qpsolvers, name)


@functools.cache
def _identity(n: int) -> Array:
    return np.eye(n)


@functools.cache
def _no_upper_bounds(count: int) -> tuple[Array, NDArray[np.intc]]:
    return np.full(count, np.inf), np.zeros(count, dtype=np.intc)


def _daqp(problem: QpProblem, tolerance: float = 1e-9) -> tuple[Array | None, QpStatus]:
    import daqp

    centre, a, lower = problem
    upper, sense = _no_upper_bounds(lower.size)
    x, _, flag, _ = daqp.solve(
        _identity(centre.size), -centre, a, upper, lower, sense, primal_tol=tolerance
    )
    if flag == 1:
        return x, QpStatus.OPTIMAL
    return None, QpStatus.INFEASIBLE if flag == -1 else QpStatus.FAILED


def _clarabel(problem: QpProblem) -> tuple[Array | None, QpStatus]:
    import scipy.sparse
    from clarabel import (
        clarabel,  # pyright: ignore[reportAttributeAccessIssue]  # compiled, comes without stubs
    )

    centre, a, lower = problem
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    identity = scipy.sparse.csc_matrix(_identity(centre.size))
    rows = scipy.sparse.csc_matrix(-a)
    cones = [clarabel.NonnegativeConeT(lower.size)]
    answer = clarabel.DefaultSolver(identity, -centre, rows, -lower, cones, settings).solve()
    status = clarabel.SolverStatus
    if answer.status in (status.Solved, status.AlmostSolved, status.InsufficientProgress):
        # the last two missed 1e-12; the check in `solve` decides
        return np.array(answer.x), QpStatus.OPTIMAL
    infeasible = answer.status in (status.PrimalInfeasible, status.AlmostPrimalInfeasible)
    return None, QpStatus.INFEASIBLE if infeasible else QpStatus.FAILED


def _qpsolvers() -> Any:
    """Return the module, imported at need: it imports all that it finds, JAX and others for 1 s."""
    return importlib.import_module("qpsolvers")


def _through_qpsolvers(name: str, problem: QpProblem) -> tuple[Array | None, QpStatus]:
    import scipy.sparse

    qpsolvers = _qpsolvers()
    centre, a, lower = problem
    matrix = np.asarray if name in qpsolvers.dense_solvers else scipy.sparse.csc_matrix
    quadratic = qpsolvers.Problem(matrix(_identity(centre.size)), -centre, matrix(-a), -lower)
    with warnings.catch_warnings():  # backends warn of their own deprecations and of accuracy
        warnings.simplefilter("ignore")
        answer = qpsolvers.solve_problem(quadratic, solver=name, **SETTINGS.get(name, {}))
    # qpsolvers does not tell an infeasible problem from a failed attempt
    if not answer.found or answer.x is None:
        return None, QpStatus.FAILED
    return answer.x, QpStatus.OPTIMAL


class Solver:
    """A solver with its second opinion, which counts how often that was needed.

    Args:
        name: one of :func:`solver_names`.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.fallbacks = 0

    def attempt(self, problem: QpProblem) -> Array | None:
        """Return the minimiser (n,), or None if the problem is infeasible or nobody solved it."""
        first = solve(problem, self.name)
        return self._second_opinion(problem) if first.status is QpStatus.FAILED else first.x

    def must(self, problem: QpProblem) -> Array:
        """Return the minimiser (n,) of a problem that has one by construction.

        Raises:
            SolverError: if neither solver finds it.
        """
        x = solve(problem, self.name).x
        if x is None and self.name == "daqp":
            x = solve(problem, LOOSE_DAQP).x
        x = self._second_opinion(problem) if x is None else x
        if x is None:
            raise SolverError(f"neither {self.name} nor its second opinion solved {problem}")
        return x

    def _second_opinion(self, problem: QpProblem) -> Array | None:
        self.fallbacks += 1
        return solve(problem, "daqp" if self.name == "clarabel" else "clarabel").x
