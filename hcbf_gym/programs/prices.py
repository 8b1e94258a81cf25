"""What rows that are not strict pay under a plan: λ_δ, λ_u and δ_min, read from its options.

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
        weights: (K, 1 + L) Δγ, then γ₀ of each priority from 2 on, the last one repeated; infinity
            is a strict level.
        states: for how many states of a batch the weights are; None is any number, and K is 1.
        lambda_u: λ_u.
        known_offset: whether δ_min comes from α₂(ψ); 0 if not.
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
        """Return the prices of a plan's options.

        Args:
            plan: `Plan.options` names which of them it has.
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
        known = choose("epsilon", epsilon, {"zero": False, "known": True})
        price = finite_float("lambda_u", lambda_u, minimum=0.0)
        if plan.strict == "all":
            slope = 0.0 if delta_gamma is None else delta_gamma
            return cls(_of_levels(weights, slope), None, price, known)
        slope = 1.3 if delta_gamma is None else delta_gamma
        return cls(*_of_states(gamma0, slope), price, known)

    def check(self, states: int) -> None:
        """Refuse a batch of another number of states.

        Raises:
            InvalidInputError: if the weights are for that of others.
        """
        if self.states not in (None, states):
            raise InvalidInputError(
                f"gamma0, delta_gamma: got weights of {self.states} states, expected {states}"
            )

    def complete(self, rows: CbfRows) -> CbfRows:
        """Return rows without α₂(ψ) with an array for it, which the core does not read.

        Raises:
            InvalidInputError: if ε is to be known and the rows do not carry α₂(ψ).
        """
        if self.known_offset:
            raise InvalidInputError(
                "rows.alpha2_psi: got None, expected α₂(ψ) of each row for epsilon='known'"
            )
        return rows._replace(alpha2_psi=rows.b)


def _of_levels(weights: Sequence[float | None], delta_gamma: ArrayLike) -> Array:
    """Return the weights of the priorities from 1 on; None, and what is beyond, is strict."""
    if isinstance(weights, str) or not isinstance(weights, Sequence):
        raise InvalidInputError(
            f"weights: got {shown(weights)}, expected a list of numbers or None"
        )
    if weights and weights[0] is not None:
        raise InvalidInputError(f"weights: got {shown(weights[0])} for priority 1, expected None")
    slope = finite_float("delta_gamma", delta_gamma, minimum=0.0)
    levels = [np.inf if w is None else finite_float("weights", w, minimum=0.0) for w in weights[1:]]
    return np.array([[slope, *levels, np.inf]])


def _of_states(gamma0: ArrayLike, delta_gamma: ArrayLike) -> tuple[Array, int | None]:
    """Return the table of weights, and for how many states it is."""
    given = _numbers("delta_gamma", delta_gamma, 1), _numbers("gamma0", gamma0, None)
    states = {len(value) for value, is_of_states in given if is_of_states}
    if len(states) > 1:
        raise InvalidInputError(
            f"gamma0 and delta_gamma: got weights of {sorted(states)} states, expected as many"
        )
    count = states.pop() if states else None
    columns = [np.broadcast_to(v, (count or 1, v.shape[1])) for v, _ in given]
    return np.concatenate(columns, axis=1), count


def _numbers(name: str, value: Any, columns: int | None) -> tuple[Array, bool]:
    """Return weights as an array of one row for each state, and whether it names states."""
    if isinstance(value, np.ndarray) and value.ndim == 2 and value.size:
        array = finite_array(name, value, (None, columns))
        if (array < 0.0).any():
            raise InvalidInputError(f"{name}: got {array.min()}, expected numbers >= 0.0")
        return array, True
    is_list = columns is None and isinstance(value, Sequence | np.ndarray)
    is_list = is_list and not isinstance(value, bytes)
    is_list = is_list and not (isinstance(value, np.ndarray) and value.ndim == 0)
    entries = list(value) if is_list else [value]
    if not entries:
        raise InvalidInputError(f"{name}: got an empty list, expected at least one weight")
    return np.array([[finite_float(name, entry, minimum=0.0) for entry in entries]]), False
