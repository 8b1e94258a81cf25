"""R-CBF-QP: the rows of lower priority may be missed, at a price (paper, section III-A)."""

from typing import Any, Literal

import numpy as np

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import InvalidInputError, choose
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.general.qp import Solver
from hcbf_gym.programs.general.stage import SoftRows, meet, relax, required
from hcbf_gym.programs.program import Array, WeightedProgram


class RelaxedCbfQp(WeightedProgram):
    r"""R-CBF-QP with m rows.

    .. math::
        \min_{u ∈ U,\, δ ≥ δ_{min}} λ_u ‖u^⋆ − u‖² + \sum_k λ_{δ_k} δ_k² \quad \text{s.t.}\quad
        a_i u ≥ b_i \;(\text{priority } 1), \qquad a_k u ≥ b_k − δ_k \;(\text{others}).

    Args:
        input_set: U.
        solver: the solver's name.
        epsilon: "zero" gives δ_min = 0; "known" takes the least offset ε = max(0, −ψ) that puts
            the state into the enlarged set: δ_min = α₂(ψ + ε) − α₂(ψ).
        weights: γ₀, Δγ and λ_u, as :class:`WeightedProgram` takes them.

    Raises:
        InvalidInputError: on other values.
    """

    options = (*WeightedProgram.options, "epsilon")

    def __init__(
        self,
        input_set: InputSet,
        solver: str,
        *,
        epsilon: Literal["zero", "known"] = "zero",
        **weights: Any,
    ) -> None:
        super().__init__(input_set, solver, **weights)
        self.epsilon = choose("epsilon", epsilon, {"zero": "zero", "known": "known"})

    def least_slack(self, rows: CbfRows) -> Array:
        """Return δ_min (m,).

        Since ψ + ε is 0 where ψ < 0 and ψ elsewhere, ``α₂(ψ + ε) − α₂(ψ) = max(0, −α₂(ψ))``.

        Raises:
            InvalidInputError: if ε is to be known and the rows do not carry α₂(ψ).
        """
        if self.epsilon == "zero":
            return np.zeros(rows.b.shape)
        if rows.alpha2_psi is None:
            raise InvalidInputError(
                "rows.alpha2_psi: got None, expected α₂(ψ) of each row for epsilon='known'"
            )
        return np.maximum(0.0, -rows.alpha2_psi)

    def decide(self, u_nominal: Array, rows: CbfRows, solver: Solver) -> tuple[Array, Array]:
        """Solve R-CBF-QP."""
        strict, least = rows.priority == 1, self.least_slack(rows)
        lower = ~strict
        soft = SoftRows(rows.a[lower], rows.b[lower], self.weight(rows)[lower], least[lower])
        feasible = self._admissible.intersect(rows.a[strict], rows.b[strict])
        u = relax(feasible, u_nominal, soft, self.lambda_u, solver)
        if u is None:
            feasible, _ = meet(self._admissible, rows.a[strict], rows.b[strict], u_nominal, solver)
            u = required(relax(feasible, u_nominal, soft, self.lambda_u, solver))
        floor = np.where(strict, 0.0, least)
        return u, np.maximum(floor, rows.b - rows.a @ u)
