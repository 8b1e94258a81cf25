"""The prices of violations under a plan: λ_δ, λ_u and δ_min, read from the plan's options.

``λ_δ(h) = γ₀`` where h > 0, else ``γ₀ (1 + Δγ |h|)`` (paper, section III-C).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import InvalidInputError, choose, finite_array, finite_float, shown
from hcbf_gym.programs.plans import Plan


class Prices(NamedTuple):
    """The numbers of a program, beside its plan.

    Attributes:
        weights: (K, 1 + L) Δγ, then γ₀ of each priority from 2 on. The last γ₀ holds for all lower
            priorities too; infinity makes a level strict.
        states: K, the number of states with weights of their own; None if all share one row.
        lambda_u: λ_u.
        known_offset: whether δ_min follows from α₂(ψ); if not, it is 0.
    """

    weights: Array = np.array([[0.0, np.inf]])
    states: int | None = None
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
        """Return the prices that the options of a plan determine.

        Args:
            plan: the program, which has the options that `Plan.options` names.
            gamma0: γ₀ ≥ 0, or one for each priority from 2 on, the last one repeated; (N, levels)
                for a batch whose N states have weights of their own.
            delta_gamma: Δγ ≥ 0, 1.3 unless given, 0 beside `weights`; (N, 1) for such a batch.
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
            return cls() if plan.strict == "all" else cls(np.zeros((1, 2)))
        known_offset = choose("epsilon", epsilon, {"zero": False, "known": True})
        lambda_u = finite_float("lambda_u", lambda_u, minimum=0.0)
        if plan.strict == "all":
            slope = 0.0 if delta_gamma is None else delta_gamma
            return cls(_weights_of_levels(weights, slope), None, lambda_u, known_offset)
        slope = 1.3 if delta_gamma is None else delta_gamma
        return cls(*_weights_of_states(gamma0, slope), lambda_u, known_offset)

    def check(self, states: int) -> None:
        """Refuse to solve for N `states`, if the weights are for another number of states.

        Raises:
            InvalidInputError: if they are.
        """
        if self.states not in (None, states):
            raise InvalidInputError(
                f"gamma0, delta_gamma: got weights of {self.states} states, expected {states}"
            )

    def complete(self, rows: CbfRows) -> CbfRows:
        """Return rows that lack α₂(ψ) with b in its place, which the core then does not read.

        Raises:
            InvalidInputError: if ε is "known", which requires α₂(ψ).
        """
        if self.known_offset:
            raise InvalidInputError(
                "rows.alpha2_psi: got None, expected α₂(ψ) of each row for epsilon='known'"
            )
        return rows._replace(alpha2_psi=rows.b)


def _weights_of_levels(weights: Sequence[float | None], delta_gamma: ArrayLike) -> Array:
    """Return the table (1, 1 + L) of Δγ and weights, given from priority 1 on; None is strict."""
    if isinstance(weights, str) or not isinstance(weights, Sequence):
        raise InvalidInputError(
            f"weights: got {shown(weights)}, expected a list of numbers or None"
        )
    if weights and weights[0] is not None:
        raise InvalidInputError(f"weights: got {shown(weights[0])} for priority 1, expected None")
    slope = finite_float("delta_gamma", delta_gamma, minimum=0.0)
    levels = [np.inf if w is None else finite_float("weights", w, minimum=0.0) for w in weights[1:]]
    return np.array([[slope, *levels, np.inf]])  # all priorities beyond the end are strict


def _weights_of_states(gamma0: ArrayLike, delta_gamma: ArrayLike) -> tuple[Array, int | None]:
    """Return the table (K, 1 + L) of weights; and K, or None if all states share one row."""
    slopes, levels = _numbers("delta_gamma", delta_gamma, 1), _numbers("gamma0", gamma0, None)
    state_counts = {len(array) for array in (slopes, levels) if array.ndim == 2}
    if len(state_counts) > 1:
        raise InvalidInputError(
            f"gamma0 and delta_gamma: got weights of {sorted(state_counts)} states, "
            "expected as many"
        )
    count = state_counts.pop() if state_counts else None
    columns = [np.broadcast_to(array, (count or 1, array.shape[-1])) for array in (slopes, levels)]
    return np.concatenate(columns, axis=1), count


def _numbers(name: str, value: Any, columns: int | None) -> Array:
    """Return weights of single states as (N, columns), or weights that all share as (columns,)."""
    is_array = isinstance(value, np.ndarray)
    if is_array and value.ndim == 2 and value.size:
        of_states = finite_array(name, value, (None, columns))
        if (of_states < 0.0).any():
            raise InvalidInputError(f"{name}: got {of_states.min()}, expected numbers >= 0.0")
        return of_states
    is_list = value.ndim > 0 if is_array else isinstance(value, Sequence)
    is_list &= columns is None and not isinstance(value, bytes)
    entries = list(value) if is_list else [value]
    if not entries:
        raise InvalidInputError(f"{name}: got an empty list, expected at least one weight")
    return np.array([finite_float(name, entry, minimum=0.0) for entry in entries])
