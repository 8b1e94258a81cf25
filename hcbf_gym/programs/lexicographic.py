"""Lex-CBF-QP: no row gives way while one of lower priority still could."""

from collections.abc import Sequence

import numpy as np

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import InvalidInputError, finite_float
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.general.qp import Solver
from hcbf_gym.programs.general.stage import SoftRows, meet, nearest, relax, required
from hcbf_gym.programs.program import Array, Program


class LexicographicCbfQp(Program):
    r"""Stage by stage the least violation, which the later stages may not add to.

    For each priority p = 1, 2, …, with :math:`δ_i^⋆` the violations of the earlier stages,

    .. math::
        \min_{u ∈ U,\, δ ≥ 0} \sum_{k ∈ p} δ_k² \quad \text{s.t.}\quad
        a_i u ≥ b_i − δ_i^⋆ \;(\text{priorities } 1 … p−1), \qquad a_k u ≥ b_k − δ_k,

    and at last the u nearest u*. A level with a finite weight minimises
    :math:`λ_u ‖u^⋆ − u‖² + \sum_{k ∈ p} λ_{δ_k} δ_k²` instead, and its δ is locked in the same way.

    Args:
        input_set: U.
        solver: the solver's name.
        weights: γ₀ of each priority from 1 on; None is a strict level, and so is a priority
            beyond the end. Priority 1 is always strict.
        delta_gamma: Δγ of the levels with a weight, ``λ_δ = γ₀ (1 + Δγ max(0, −h))``.
        lambda_u: λ_u of the levels with a weight.

    Raises:
        InvalidInputError: on weights that are negative or not finite, or one for priority 1.
    """

    options = ("weights", "delta_gamma", "lambda_u")

    def __init__(
        self,
        input_set: InputSet,
        solver: str,
        *,
        weights: Sequence[float | None] = (),
        delta_gamma: float = 0.0,
        lambda_u: float = 1.0,
    ) -> None:
        super().__init__(input_set, solver)
        if isinstance(weights, str) or not isinstance(weights, Sequence):
            raise InvalidInputError(f"weights: got {weights!r}, expected a list of numbers or None")
        if weights and weights[0] is not None:
            raise InvalidInputError(f"weights: got {weights[0]} for priority 1, expected None")
        gamma0 = [np.inf if w is None else finite_float("weights", w, minimum=0.0) for w in weights]
        self._gamma0 = np.array([np.inf, *gamma0[1:], np.inf])
        self.delta_gamma = finite_float("delta_gamma", delta_gamma, minimum=0.0)
        self.lambda_u = finite_float("lambda_u", lambda_u, minimum=0.0)

    def weight(self, rows: CbfRows) -> Array:
        """Return λ_δ(h) (m,) of each row, infinity for the strict levels."""
        gamma0 = self._gamma0[np.minimum(rows.priority, self._gamma0.size) - 1]
        return gamma0 * (1.0 + self.delta_gamma * np.maximum(0.0, -rows.h))

    def decide(self, u_nominal: Array, rows: CbfRows, solver: Solver) -> tuple[Array, None]:
        """Solve the cascade."""
        feasible, weight = self._admissible, self.weight(rows)
        if np.isinf(weight).all():
            u = nearest(feasible.intersect(rows.a, rows.b), u_nominal, solver)
            if u is not None:
                return u, None  # no conflict: every violation is 0, the least there is
        for priority in range(1, rows.priority.max(initial=0) + 1):
            level = rows.priority == priority
            a, b = rows.a[level], rows.b[level]
            if np.isinf(weight[level]).all():
                feasible, u = meet(feasible, a, b, u_nominal, solver)
                continue
            soft = SoftRows(a, b, weight[level], np.zeros(b.size))
            u = required(relax(feasible, u_nominal, soft, self.lambda_u, solver))
            feasible = feasible.bound(a, b, u)
        return required(nearest(feasible, u_nominal, solver)), None
