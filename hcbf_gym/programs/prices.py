"""What rows that are not strict pay under a plan: λ_δ, λ_u and δ_min, read from its options."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import InvalidInputError, choose, finite_float
from hcbf_gym.programs.plans import Plan
from hcbf_gym.programs.weights import Weights


class Prices(NamedTuple):
    """The numbers of a program, beside its plan.

    Attributes:
        weights: λ_δ(h) of each priority; infinity is a strict level.
        lambda_u: λ_u.
        known_offset: whether δ_min comes from α₂(ψ); 0 if not.
    """

    weights: Weights = Weights()
    lambda_u: float = 1.0
    known_offset: bool = False

    @classmethod
    def read(
        cls,
        plan: Plan,
        *,
        gamma0: ArrayLike = 5.0,
        delta_gamma: ArrayLike | None = None,
        lambda_u: float = 1.0,
        epsilon: str = "zero",
        weights: Sequence[float | None] = (),
    ) -> "Prices":
        """Return the prices of a plan's options.

        Args:
            plan: which of them it has stands in `Plan.options`.
            gamma0: γ₀ ≥ 0, or one for each priority from 2 on, the last one repeated; (N, levels)
                for a batch whose N states have weights of their own.
            delta_gamma: Δγ ≥ 0, 1.3 unless given, 0 beside `weights`; (N, 1) likewise.
            lambda_u: λ_u ≥ 0. λ_u = 0 and λ_δ = 0 are limits: the first breaks ties towards u*,
                the second lets the row go.
            epsilon: "zero" gives δ_min = 0; "known" takes the least offset ε = max(0, −ψ) that
                puts the state into the enlarged set: δ_min = α₂(ψ + ε) − α₂(ψ).
            weights: γ₀ of each priority from 1 on; None is a strict level, and so is a priority
                beyond the end. Priority 1 is always strict.

        Raises:
            UnknownNameError: on another epsilon; the message lists the choices.
            InvalidInputError: on weights that are negative or not finite, or one for priority 1.
        """
        if plan.lower == "nothing":
            return cls() if plan.strict == "all" else cls(Weights.read(0.0, 0.0))
        known = choose("epsilon", epsilon, {"zero": False, "known": True})
        price = finite_float("lambda_u", lambda_u, minimum=0.0)
        if plan.strict == "all":
            slope = 0.0 if delta_gamma is None else delta_gamma
            return cls(Weights.of_levels(weights, slope), price, known)
        slope = 1.3 if delta_gamma is None else delta_gamma
        return cls(Weights.read(gamma0, slope), price, known)

    def least_slack(self, rows: CbfRows) -> Array:
        """Return δ_min (m,), the least relaxation that the program allows.

        Since ψ + ε is 0 where ψ < 0 and ψ elsewhere, ``α₂(ψ + ε) − α₂(ψ) = max(0, −α₂(ψ))``.

        Raises:
            InvalidInputError: if ε is to be known and the rows do not carry α₂(ψ).
        """
        if not self.known_offset:
            return np.zeros(rows.b.shape)
        if rows.alpha2_psi is None:
            raise InvalidInputError(
                "rows.alpha2_psi: got None, expected α₂(ψ) of each row for epsilon='known'"
            )
        return np.where(rows.priority == 1, 0.0, np.maximum(0.0, -rows.alpha2_psi))
