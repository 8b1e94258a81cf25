"""The stages of a cascade for any number of inputs: each is a projection on what remains."""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.programs.general.dense import lock, pin
from hcbf_gym.programs.general.rational import SoftRows
from hcbf_gym.programs.general.remaining import Remaining
from hcbf_gym.programs.general.soft import least_cost, trade
from hcbf_gym.programs.general.stage_rows import StageRows
from hcbf_gym.programs.tolerances import ZERO_GRADIENT


class SolverInputs(Remaining):
    """What remains, with the stages that choose from it."""

    __slots__ = ()

    def meeting(self, a: Array, b: Array) -> "SolverInputs | None":
        """Keep those that meet ``a u ≥ b``; None where none does."""
        met = self.intersect(a, b)
        u = met.attempt()
        return None if u is None else met._replace(known=u)

    def violating_least(self, rows: StageRows) -> "SolverInputs":
        """Keep those that violate the rows least, ``min Σ max(0, b_k − a_k u)²``."""
        steer = np.einsum("ij,ij->i", rows.a, rows.a) > ZERO_GRADIENT**2
        a = rows.a[steer]
        b = rows.b[steer]
        soft = SoftRows(a, b, np.ones(b.size), np.zeros(b.size))
        return self._lock(a, b, least_cost(self, soft))

    def meet(self, rows: StageRows) -> "SolverInputs":
        """Keep those that meet the rows or, where none does, violate them least."""
        met = self.meeting(rows.a, rows.b)
        return self.violating_least(rows) if met is None else met

    def relax(self, rows: StageRows, lambda_u: float) -> Array:
        """Return ``argmin λ_u ‖u − u*‖² + Σ λ_δk max(δ_min, b_k − a_k u)²``."""
        paid = rows.weight > 0.0
        if not paid.any():
            return self.nearest()
        a = rows.a[paid]
        b = rows.b[paid]
        weight = rows.weight[paid]
        least = rows.least[paid]
        if lambda_u > 0.0:
            return trade(self, SoftRows(a, b, weight / lambda_u, least))
        u = least_cost(self, SoftRows(a, b, weight, least))
        root = np.sqrt(weight)
        return self._lock(root[:, None] * a, root * (b - least), u).nearest()

    def draw(self, rows: StageRows, lambda_u: float) -> Array:
        """Return ``argmin λ_u ‖u − u*‖² + Σ λ_δk (t_k − a_k u)²``."""
        paid = rows.weight > 0.0
        if not paid.any():
            return self.nearest()
        a = rows.a[paid]
        t = rows.target[paid]
        weight = rows.weight[paid]
        if lambda_u > 0.0:
            return trade(self, SoftRows(a, t, weight / lambda_u, None))
        return self._pin(a, least_cost(self, SoftRows(a, t, weight, None))).nearest()

    def pin(self, rows: StageRows, u: Array) -> "SolverInputs":
        """Keep those at which each row has the value that it has at u, one of them."""
        return self._pin(rows.a, u)

    def bound(self, rows: StageRows, u: Array) -> "SolverInputs":
        """Keep those at which no row is violated more than at u, one of them."""
        return self.intersect(rows.a, np.minimum(rows.b, rows.a @ u))

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
