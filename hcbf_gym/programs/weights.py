"""What a relaxed row costs: ``λ_δ(h) = γ₀`` where h > 0, else ``γ₀ (1 + Δγ |h|)``."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.errors import InvalidInputError, finite_array, finite_float, shown


class Weights(NamedTuple):
    """The weights of the priorities from 2 on (paper, section III-C).

    Attributes:
        table: (K, 1 + L) Δγ, then γ₀ of each priority from 2 on, the last one repeated; infinity
            is a strict level.
        states: for how many states of a batch they are; None is any number, and K is 1.
    """

    table: Array = np.array([[0.0, np.inf]])
    states: int | None = None

    @classmethod
    def read(cls, gamma0: ArrayLike, delta_gamma: ArrayLike) -> "Weights":
        """Return the weights that a program's options name.

        Args:
            gamma0: a number, a list of them, or (N, L) those of N states.
            delta_gamma: a number, or (N, 1) those of N states.

        Raises:
            InvalidInputError: on an empty list, entries that are negative or not finite, or arrays
                for different numbers of states.
        """
        lists = [
            _numbers(name, value, columns)
            for name, value, columns in (("delta_gamma", delta_gamma, 1), ("gamma0", gamma0, None))
        ]
        states = {len(value) for value, many in lists if many}
        if len(states) > 1:
            raise InvalidInputError(
                f"gamma0 and delta_gamma: got weights of {sorted(states)} states, expected as many"
            )
        count = states.pop() if states else None
        columns = [np.broadcast_to(v, (count or 1, v.shape[1])) for v, _ in lists]
        return cls(np.concatenate(columns, axis=1), count)

    @classmethod
    def of_levels(cls, weights: Sequence[float | None], delta_gamma: ArrayLike) -> "Weights":
        """Return the weights of the priorities from 1 on; None, and what is beyond, is strict.

        Raises:
            InvalidInputError: on what is no list, negative or infinite weights, or one for
                priority 1.
        """
        if isinstance(weights, str) or not isinstance(weights, Sequence):
            raise InvalidInputError(
                f"weights: got {shown(weights)}, expected a list of numbers or None"
            )
        if weights and weights[0] is not None:
            raise InvalidInputError(
                f"weights: got {shown(weights[0])} for priority 1, expected None"
            )
        slope = finite_float("delta_gamma", delta_gamma, minimum=0.0)
        levels = [
            np.inf if w is None else finite_float("weights", w, minimum=0.0) for w in weights[1:]
        ]
        return cls(np.array([[slope, *levels, np.inf]]))

    def of(self, priority: Integers, h: Array) -> Array:
        """Return λ_δ(h) (m,) of one state's rows; infinity for those of strict levels."""
        ranked = zip(priority.tolist(), h.tolist(), strict=True)
        return np.array([_core.row_weight(self.table[0], rank, value) for rank, value in ranked])

    def check(self, states: int) -> None:
        """Refuse a batch of another number of states.

        Raises:
            InvalidInputError: if the weights are for that of others.
        """
        if self.states not in (None, states):
            raise InvalidInputError(
                f"gamma0, delta_gamma: got weights of {self.states} states, expected {states}"
            )


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
