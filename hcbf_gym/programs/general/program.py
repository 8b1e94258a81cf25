"""The programs for any number of inputs, or with a solver asked for by name."""

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import SolverError, finite_array
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.cascades import Cascade
from hcbf_gym.programs.general.polyhedron import SolverInputs
from hcbf_gym.programs.general.qp import Solver, check_solver
from hcbf_gym.programs.program import Program, account, check_rows
from hcbf_gym.programs.result import FilterResult, FilterStatus, violation


class GeneralProgram(Program):
    """A program whose stages a QP solver answers.

    Args:
        cascade: what is solved.
        input_set: U.
        solver: the solver's name; Clarabel answers where it fails (DAQP where that is Clarabel).

    Raises:
        UnknownNameError: if no such solver is installed.
    """

    def __init__(self, cascade: Cascade, input_set: InputSet, solver: str) -> None:
        super().__init__(cascade, input_set)
        cascade.weights.check(1)
        self.solver = check_solver(solver)
        nothing = np.zeros(input_set.n_u)
        self._admissible = SolverInputs.of(input_set, nothing, Solver(solver))

    def __call__(self, u_nominal: ArrayLike, rows: CbfRows) -> FilterResult:
        """Filter one nominal input; see :class:`Program`."""
        desired = finite_array("u_nominal", u_nominal, (self.input_set.n_u,))
        check_rows(rows, desired.size)
        stage_rows = self.cascade.stage_rows(rows)
        if self.input_set.contains(desired, 0.0) and (rows.a @ desired >= rows.b).all():
            slack = np.zeros(rows.b.size)
            return FilterResult(desired, slack, stage_rows.least, FilterStatus.NOMINAL, 0)
        solver = Solver(self.solver)
        try:
            inputs = self._admissible._replace(u_nominal=desired, solver=solver)
            u, target = self.cascade.decide(inputs, stage_rows)
        except SolverError:
            braking = np.zeros_like(desired)
            slack = violation(rows, braking, self.input_set.radius)
            return FilterResult(braking, slack, slack.copy(), FilterStatus.BACKUP, solver.fallbacks)
        u = self.input_set.project(u)
        result = account(self.cascade, self.input_set.radius, desired, rows, u, target)
        return result._replace(fallbacks=solver.fallbacks)
