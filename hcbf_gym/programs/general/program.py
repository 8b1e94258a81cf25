"""The programs for any number of inputs, or with a solver by name."""

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import SolverError, finite_array, floats
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.general.cascade import decide
from hcbf_gym.programs.general.polyhedron import SolverInputs
from hcbf_gym.programs.general.qp import Solver, check_solver
from hcbf_gym.programs.general.stage_rows import StageRows, stage_rows
from hcbf_gym.programs.plans import Plan
from hcbf_gym.programs.prices import Prices
from hcbf_gym.programs.program import Program, check_rows
from hcbf_gym.programs.result import FilterResult, FilterStatus, classify, violation


class GeneralProgram(Program):
    """A program whose stages a QP solver answers.

    Args:
        plan: what is solved.
        prices: its numbers.
        input_set: U.
        solver: the solver's name; Clarabel answers where it fails (DAQP where that is Clarabel).

    Raises:
        UnknownNameError: if no such solver is installed.
        InvalidInputError: if the prices are those of several states.
    """

    def __init__(self, plan: Plan, prices: Prices, input_set: InputSet, solver: str) -> None:
        self.plan, self.prices, self.input_set = plan, prices, input_set
        prices.weights.check(1)
        self.solver = check_solver(solver)
        nothing = np.zeros(input_set.n_u)
        self._admissible = SolverInputs.of(input_set, nothing, Solver(solver))

    def __call__(self, u_nominal: ArrayLike, rows: CbfRows) -> FilterResult:
        """Filter one nominal input; see :class:`Program`."""
        given = floats("u_nominal", u_nominal, (self.input_set.n_u,))
        desired = finite_array("u_nominal", given, given.shape)
        check_rows(rows, desired.size)
        least = self.prices.least_slack(rows)
        if self.input_set.contains(desired, 0.0) and (rows.a @ desired >= rows.b).all():
            slack = np.zeros(rows.b.size)
            return FilterResult(desired, slack, least, FilterStatus.NOMINAL, 0)
        staged = stage_rows(self.plan, self.prices, rows, least)
        solver = Solver(self.solver)
        radius = self.input_set.radius
        try:
            inputs = self._admissible._replace(u_nominal=desired, solver=solver)
            u, target = decide(self.plan, inputs, staged, self.prices.lambda_u)
        except SolverError:
            braking = np.zeros_like(desired)
            slack = violation(rows, braking, radius)
            return FilterResult(braking, slack, slack.copy(), FilterStatus.BACKUP, solver.fallbacks)
        u = self.input_set.project(u)
        slack = violation(rows, u, radius)
        first = (rows.priority == 1) if self.plan.ranks else np.full(slack.shape, True)
        status = classify(u, desired, slack, first, radius)
        delta = self._delta(staged, u, slack, target)
        return FilterResult(u, slack, delta, status, solver.fallbacks)

    def _delta(self, rows: StageRows, u: Array, slack: Array, target: Array) -> Array:
        """Return the program's own relaxation δ (m,): the slack of strict rows."""
        if self.plan.lower == "drawn":
            return np.where(rows.strict, slack, target - rows.a @ u)
        return np.maximum(slack, rows.least)
