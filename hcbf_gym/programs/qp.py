"""QP solvers by name, as second opinions: each answers the core's projections on polyhedra.

All read ``minimise ½‖x − centre‖² subject to a x ≥ lower``, rows of norms from 1/2 to 1; the point
is checked. Each is imported when it is first called: without a name none is.
"""

import importlib
import warnings
from typing import Any

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.errors import SolverError, choose

PRIMAL = 1e-7
"""The distance by which a solver's point may miss a row, relative to 1 + max|x|."""

# Where a solver's own default is too loose to pass that check, or to agree with others.
SETTINGS: dict[str, dict[str, Any]] = {
    "clarabel": {"tol_gap_abs": 1e-12, "tol_gap_rel": 1e-12, "tol_feas": 1e-12},
    "osqp": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 20000},
    "scs": {"eps_abs": 1e-9, "eps_rel": 1e-9},
    "proxqp": {"eps_abs": 1e-10, "eps_rel": 0.0},
    "piqp": {"eps_abs": 1e-10, "eps_rel": 1e-10},
}


def solver_names() -> list[str]:
    """Return the names that `solver` may take on this machine."""
    return sorted({"daqp", *_qpsolvers().available_solvers})


def check_solver(name: str) -> str:
    """Return `name`.

    Raises:
        UnknownNameError: if no solver of that name is installed; the message lists those that are.
    """
    if isinstance(name, str) and name == "daqp":  # which needs no look around
        return name
    return choose("solver", name, {known: known for known in solver_names()})


def solve(solver: str, centre: Array, a: Array, lower: Array) -> Array | None:
    """Return the minimiser (n,) that a solver finds; None where it finds none, or misses a row.

    Args:
        solver: one of :func:`solver_names`.
        centre: (n,) the point to stay near.
        a: (k, n) rows.
        lower: (k,) their bounds.
    """
    answer = _daqp(centre, a, lower) if solver == "daqp" else _found(solver, centre, a, lower)
    if answer is None:
        return None
    x = np.ascontiguousarray(answer, np.float64)
    missed = (lower - a @ x).max(initial=0.0)
    return x if missed <= PRIMAL * (1.0 + np.abs(x).max()) else None  # NaN fails


def _daqp(centre: Array, a: Array, lower: Array) -> Any:
    import daqp

    upper, sense = np.full(lower.size, np.inf), np.zeros(lower.size, dtype=np.intc)
    identity = np.eye(centre.size)
    x, _, flag, _ = daqp.solve(identity, -centre, a, upper, lower, sense, primal_tol=1e-9)
    return x if flag == 1 else None


def _qpsolvers() -> Any:
    """Return the module, imported at need: it imports all that it finds, JAX and others for 1 s."""
    return importlib.import_module("qpsolvers")


def _found(solver: str, centre: Array, a: Array, lower: Array) -> Any:
    import scipy.sparse

    qpsolvers = _qpsolvers()
    matrix = np.asarray if solver in qpsolvers.dense_solvers else scipy.sparse.csc_matrix
    problem = qpsolvers.Problem(matrix(np.eye(centre.size)), -centre, matrix(-a), -lower)
    with warnings.catch_warnings():  # backends warn of their own deprecations and of accuracy
        warnings.simplefilter("ignore")
        answer = qpsolvers.solve_problem(problem, solver=solver, **SETTINGS.get(solver, {}))
    return answer.x if answer.found else None


class Solver:
    """A solver with the core behind it, which counts how often that was needed.

    Args:
        name: one of :func:`solver_names`.
    """

    def __init__(self, name: str) -> None:
        self.name, self.fallbacks = name, 0

    def project(self, centre: Array, a: Array, lower: Array, nonempty: bool) -> Array | None:
        """Return the minimiser (n,), or None where the rows leave nothing; see `solve`.

        Args:
            centre: (n,) the point to stay near.
            a: (k, n) rows.
            lower: (k,) their bounds.
            nonempty: whether there is a minimiser by construction: then None is not returned.

        Raises:
            SolverError: if there is one, and neither the solver finds it nor the core.
        """
        x = solve(self.name, centre, a, lower)
        if x is None:
            x = _core.nearest_point(a, lower, centre)
            self.fallbacks += x is not None
        if x is None and nonempty:
            raise SolverError(f"neither {self.name} nor the core solved {centre}, {a}, {lower}")
        return x
