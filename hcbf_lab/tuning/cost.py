"""The cost of an episode under a pair of weights, by which the paper tunes them."""

from dataclasses import dataclass

import numpy as np

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.errors import InvalidInputError, finite_float


@dataclass(frozen=True)
class Cost:
    r"""The cost of a trajectory sampled at the control times iΔt, i = 0 … N, Δt = 0.02 s.

    .. math::
        r = \sum_{i=1}^{N-1} ‖e(iΔt)‖_{w_i} + ‖e(NΔt)‖_{w_f} + w_δ \sum_{i=1}^{N} δ(iΔt)

    The paper leaves three symbols open. Here ``e`` is the position error p_ref − p, as in its
    feedback law u = K_p e + K_d ė. ``‖e‖_w = √(eᵀ w e)``, as ‖·‖_M in its Proposition 2. δ is the
    relaxation of all rows, ``Σ_k max(0, δ_k)``, because a negative δ_k of H-CBF-QP relaxes nothing.

    Raises:
        InvalidInputError: if a weight is negative or not finite.

    Source: section III-C; the default weights are those of section IV-A.
    """

    w_i: float = 1.0  # w_i ≥ 0, of the tracking error before the end
    w_f: float = 1000.0  # w_f ≥ 0, of the tracking error at the end
    w_delta: float = 0.5  # w_δ ≥ 0, of the relaxation

    def __post_init__(self) -> None:
        for name in ("w_i", "w_f", "w_delta"):
            finite_float(name, getattr(self, name), minimum=0.0)

    def __call__(self, tracking_error: Array, relaxation: Array) -> Array:
        """Return r (…) of each trajectory.

        Args:
            tracking_error: (N + 1, …) ‖e(iΔt)‖ [m], i = 0 … N.
            relaxation: (N, …) δ(iΔt) [m/s²], i = 1 … N.

        Raises:
            InvalidInputError: if the shapes do not fit each other.
        """
        steps, *others = relaxation.shape
        if steps < 1 or tracking_error.shape != (steps + 1, *others):
            raise InvalidInputError(
                f"cost: got tracking errors of shape {tracking_error.shape} and relaxations of "
                f"shape {relaxation.shape}, expected (N + 1, …) and (N, …)"
            )
        return (
            np.sqrt(self.w_i) * _sum(tracking_error[1:-1])
            + np.sqrt(self.w_f) * tracking_error[-1]
            + self.w_delta * _sum(relaxation)
        )


def _sum(series: Array) -> Array:
    """Return the sum over time, added in order, so that no bit depends on a batch's size."""
    return np.add.accumulate(series, axis=0)[-1] if len(series) else np.zeros(series.shape[1:])


def relaxation(delta: Array, priority: Integers) -> Array:
    """Return ``Σ_k max(0, δ_k)`` (…) over the rows below priority 1.

    Args:
        delta: (…, m) the program's δ_k [m/s²].
        priority: (m,) of the rows.
    """
    return np.maximum(delta[..., priority > 1], 0.0).sum(axis=-1)
