"""QP solvers by name, as second opinions: they compute projections in place of the core.

Each solves ``minimise ½‖x − centre‖² subject to a x ≥ lower``, with rows of norms from 1/2 to 1,
and its point is checked. A solver is imported when it is called first.
"""

import importlib
import warnings
from typing import Any

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.errors import SolverError, choose

PRIMAL_TOLERANCE = 1e-7
"""The distance by which a solver's point may miss a row, relative to 1 + max|x|."""

# for solvers whose defaults are too loose to pass that check, or to agree with others
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
    if isinstance(name, str) and name == "daqp":  # a dependency of the package
        return name
    return choose("solver", name, {known: known for known in solver_names()})


def solve(solver: str, centre: Array, a: Array, lower: Array) -> Array | None:
    """Return the minimiser (n,) that a solver finds; None if it finds none, or misses a row.

    Args:
        solver: one of :func:`solver_names`.
        centre: (n,) the point that is projected.
        a: (k, n) gradients of the rows.
        lower: (k,) lower bounds of the rows.
    """
    if solver == "daqp":
        x = _solve_by_daqp(centre, a, lower)
    else:
        x = _solve_by_qpsolvers(solver, centre, a, lower)
    if x is None:
        return None
    x = np.ascontiguousarray(x, np.float64)
    violation = (lower - a @ x).max(initial=0.0)
    tolerance = PRIMAL_TOLERANCE * (1.0 + np.abs(x).max())
    return x if violation <= tolerance else None  # NaN fails


def _solve_by_daqp(centre: Array, a: Array, lower: Array) -> Any:
    import daqp

    upper, sense = np.full(lower.size, np.inf), np.zeros(lower.size, dtype=np.intc)
    identity = np.eye(centre.size)
    x, _, flag, _ = daqp.solve(identity, -centre, a, upper, lower, sense, primal_tol=1e-9)
    return x if flag == 1 else None


def _qpsolvers() -> Any:
    """Return the module, imported at need, because it imports all solvers in about 1 s."""
    return importlib.import_module("qpsolvers")


def _solve_by_qpsolvers(solver: str, centre: Array, a: Array, lower: Array) -> Any:
    import scipy.sparse

    qpsolvers = _qpsolvers()
    matrix = np.asarray if solver in qpsolvers.dense_solvers else scipy.sparse.csc_matrix
    problem = qpsolvers.Problem(matrix(np.eye(centre.size)), -centre, matrix(-a), -lower)
    with warnings.catch_warnings():  # backends warn of their own deprecations and of accuracy
        warnings.simplefilter("ignore")
        solution = qpsolvers.solve_problem(problem, solver=solver, **SETTINGS.get(solver, {}))
    return solution.x if solution.found else None


class Solver:
    """A solver by name, with the core in reserve.

    Attributes:
        name: one of :func:`solver_names`.
        fallbacks: how often the solver failed and the core solved the problem.
    """

    def __init__(self, name: str) -> None:
        self.name, self.fallbacks = name, 0

    def project(self, centre: Array, a: Array, lower: Array, nonempty: bool) -> Array | None:
        """Return the minimiser (n,), or None if no point meets all rows; see `solve`.

        Raises:
            SolverError: if there is a minimiser by construction (`nonempty`), and neither the
                solver finds it nor the core.
        """
        x = solve(self.name, centre, a, lower)
        if x is None:
            x = _core.nearest_point(a, lower, centre)
            self.fallbacks += x is not None
        if x is None and nonempty:
            raise SolverError(f"neither {self.name} nor the core solved {centre}, {a}, {lower}")
        return x
