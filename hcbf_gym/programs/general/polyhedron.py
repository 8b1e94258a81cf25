"""The inputs that the stages so far leave, for any number of inputs: each stage is a projection.

They are kept as a point, an orthonormal basis of the directions that are still free, and
inequalities. A stage that pins a row removes a direction from the basis instead of adding an
equality, so that no later stage can be infeasible through rounding.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.general.cascade import StageRows
from hcbf_gym.programs.general.dense import level_rows, lock, pin, unit_rows
from hcbf_gym.programs.general.qp import QpProblem, Solver
from hcbf_gym.programs.general.rational import SoftRows
from hcbf_gym.programs.general.soft import least_cost, trade
from hcbf_gym.programs.tolerances import DEPENDENT, MET, ZERO_GRADIENT

Array = NDArray[np.float64]


class SolverInputs(NamedTuple):
    """``{u : u = point + basis z, a u ≥ b}``, never empty; which the stages narrow.

    Attributes:
        u_nominal: (n_u,) u*.
        solver: who answers.
        point: (n_u,) a point of the affine subspace; a member of the set once rows are pinned.
        basis: (n_u, r) orthonormal free directions.
        a: (k, n_u) rows of norms from 1/2 to 1.
        b: (k,) their lower bounds.
        radius: the largest norm of an input in U.
        known: (n_u,) the member nearest u*, where it is known already.
    """

    u_nominal: Array
    solver: Solver
    point: Array
    basis: Array
    a: Array
    b: Array
    radius: float
    known: Array | None = None

    @classmethod
    def of(cls, input_set: InputSet, u_nominal: Array, solver: Solver) -> "SolverInputs":
        """Return U."""
        n_u, (a, b) = input_set.n_u, input_set.halfspaces()
        return cls(u_nominal, solver, np.zeros(n_u), np.eye(n_u), a, b, input_set.radius)

    def nearest(self) -> Array:
        """Return ``argmin ‖u − u*‖²``.

        Raises:
            SolverError: if nobody finds it.
        """
        if self.known is not None:
            return self.known
        rows, lower = self.reduced()
        z = self.solver.must(QpProblem(self.centre(), rows, lower))
        return self.point + self.basis @ z

    def meeting(self, rows: StageRows) -> "SolverInputs | None":
        """Keep those that meet the rows; None where none does."""
        met = self.intersect(rows.a, rows.b)
        u = met.attempt()
        return None if u is None else met._replace(known=u)

    def violating_least(self, rows: StageRows) -> "SolverInputs":
        """Keep those that violate the rows least, ``min Σ max(0, b_k − a_k u)²``."""
        steer = np.einsum("ij,ij->i", rows.a, rows.a) > ZERO_GRADIENT**2
        a, b = rows.a[steer], rows.b[steer]
        soft = SoftRows(a, b, np.ones(b.size), np.zeros(b.size))
        return self._lock(a, b, least_cost(self, soft))

    def meet(self, rows: StageRows) -> "SolverInputs":
        """Keep those that meet the rows or, where none does, violate them least."""
        met = self.meeting(rows)
        return self.violating_least(rows) if met is None else met

    def relax(self, rows: StageRows, lambda_u: float) -> Array:
        """Return ``argmin λ_u ‖u − u*‖² + Σ λ_δk max(δ_min, b_k − a_k u)²``."""
        paid = rows.weight > 0.0
        if not paid.any():
            return self.nearest()
        a, b, weight, least = rows.a[paid], rows.b[paid], rows.weight[paid], rows.least[paid]
        if lambda_u > 0.0:
            return trade(self, SoftRows(a, b, weight / lambda_u, least))
        u, root = least_cost(self, SoftRows(a, b, weight, least)), np.sqrt(weight)
        return self._lock(root[:, None] * a, root * (b - least), u).nearest()

    def draw(self, rows: StageRows, lambda_u: float) -> Array:
        """Return ``argmin λ_u ‖u − u*‖² + Σ λ_δk (t_k − a_k u)²``."""
        paid = rows.weight > 0.0
        if not paid.any():
            return self.nearest()
        a, t, weight = rows.a[paid], rows.target[paid], rows.weight[paid]
        if lambda_u > 0.0:
            return trade(self, SoftRows(a, t, weight / lambda_u, None))
        return self._pin(a, least_cost(self, SoftRows(a, t, weight, None))).nearest()

    def pin(self, rows: StageRows, u: Array) -> "SolverInputs":
        """Keep those at which each row has the value that it has at u, one of them."""
        return self._pin(rows.a, u)

    def bound(self, rows: StageRows, u: Array) -> "SolverInputs":
        """Keep those at which no row is violated more than at u, one of them."""
        return self.intersect(rows.a, np.minimum(rows.b, rows.a @ u))

    def centre(self) -> Array:
        """Return u* in the coordinates z of the free directions."""
        return self.basis.T @ (self.u_nominal - self.point)

    def reduced(self) -> tuple[Array, Array]:
        """Return the inequalities in the coordinates z of the free directions.

        A row that none of those directions changes is a constant and left out.
        """
        n_u, free = self.basis.shape
        if free == n_u:  # nothing is pinned yet: z = u
            return self.a, self.b
        lower = self.b - self.a @ self.point
        return unit_rows(self.a @ self.basis, lower, DEPENDENT)

    def attempt(self) -> Array | None:
        """Return the member nearest u*, or None where there is none."""
        if not self.basis.shape[1]:
            return self.point if (self.a @ self.point >= self.b - MET).all() else None
        rows, lower = self.reduced()
        z = self.solver.attempt(QpProblem(self.centre(), rows, lower))
        return None if z is None else self.point + self.basis @ z

    def intersect(self, a: Array, b: Array) -> "SolverInputs":
        """Keep those that meet ``a u ≥ b``, rows of any length; there may be none."""
        level, bound = level_rows(a, b, ZERO_GRADIENT)
        rows, bounds = np.concatenate((self.a, level)), np.concatenate((self.b, bound))
        return self._replace(a=rows, b=bounds, known=None)

    def _pin(self, a: Array, u: Array) -> "SolverInputs":
        """Keep the inputs on which the rows a (s, n_u) have their value at u, one of them."""
        lower, basis = pin(self.a, self.b, self.basis, a, u)
        if basis.shape == self.basis.shape:
            return self._replace(b=lower, known=None)
        return self._replace(b=lower, point=u, basis=basis, known=None if basis.size else u)

    def _lock(self, a: Array, b: Array, u: Array) -> "SolverInputs":
        """Keep the minimisers of a stage of which u is one, ``min Σ max(0, b_k − a_k u)²``.

        Each violated row has one value on all of them: it is pinned; the others are met.
        """
        rows, bounds, violated = lock(self.a, self.b, a, b, u)
        return self._replace(a=rows, b=bounds)._pin(violated, u)
