"""The programs of any number of inputs; each stage is a projection on a polyhedron.

The core computes the projections (`core/include/hcbf/general_cascade.hpp`), or a QP solver by name.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import _core
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import SolverError, finite_array, floats
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.plans import LOCK, LOWER, Plan
from hcbf_gym.programs.prices import Prices
from hcbf_gym.programs.program import Program, check_rows
from hcbf_gym.programs.qp import Solver, check_solver
from hcbf_gym.programs.result import FilterResult, FilterStatus


class GeneralProgram(Program):
    """A program of any number of inputs for a single state.

    Args:
        plan: the stages that are solved.
        prices: the weights of violations.
        input_set: U.
        solver: the name of a QP solver that computes the projections, unless it fails.

    Raises:
        UnknownNameError: if no such solver is installed.
        InvalidInputError: if the prices are those of several states.
    """

    def __init__(
        self, plan: Plan, prices: Prices, input_set: InputSet, solver: str | None = None
    ) -> None:
        self.plan, self.prices, self.input_set = plan, prices, input_set
        prices.check(1)
        self.solver = None if solver is None else check_solver(solver)
        self._core = _core.GeneralProgram(
            LOWER.index(plan.lower),
            plan.order == "by level",
            LOCK.index(plan.lock),
            plan.ranks,
            input_set.radius,
            prices.lambda_u,
            prices.known_offset,
            np.ascontiguousarray(prices.weights),
            *input_set.halfspaces(),
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.plan, self.prices, self.input_set, self.solver)

    def __call__(self, u_nominal: ArrayLike, rows: CbfRows) -> FilterResult:
        """Filter one nominal input; see :class:`Program`."""
        n_u = self.input_set.n_u
        u_nominal = finite_array("u_nominal", floats("u_nominal", u_nominal, (n_u,)), (n_u,))
        check_rows(rows, n_u)
        if rows.alpha2_psi is None:
            rows = self.prices.complete(rows)
        m = rows.b.size
        answer = np.empty(n_u + 2 * m + 1)  # u, slack, delta, status
        solver = None if self.solver is None else Solver(self.solver)
        try:
            fallbacks = self._core.filter(
                np.ascontiguousarray(u_nominal),
                np.ascontiguousarray(rows.a, np.float64),
                np.ascontiguousarray(rows.b, np.float64),
                np.ascontiguousarray(rows.h, np.float64),
                np.ascontiguousarray(rows.priority, np.int64),
                np.ascontiguousarray(rows.alpha2_psi, np.float64),
                None if solver is None else solver.project,
                self.input_set.project,
                answer,
            )
            is_solved = bool(np.isfinite(answer[:n_u]).all())  # squares may overflow
        except SolverError:
            fallbacks, is_solved = 0, False
        if solver is not None:
            fallbacks += solver.fallbacks
        if not is_solved:
            braking = np.zeros(n_u)
            slack = _core.violation(rows.a, rows.b, braking, self.input_set.radius)
            return FilterResult(braking, slack, slack.copy(), FilterStatus.BACKUP, fallbacks)
        u, slack, delta, status = np.split(answer, (n_u, n_u + m, n_u + 2 * m))
        return FilterResult(u, slack, delta, FilterStatus(int(status[0])), fallbacks)
