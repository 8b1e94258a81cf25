"""Draws of (γ₀, Δγ) from a normal distribution that rejects negative weights."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Pair
from hcbf_gym.errors import InvalidInputError, finite_array

_MAX_REJECTED = 10_000


class Draw(NamedTuple):
    """One accepted draw."""

    gamma0: float  # γ₀
    delta_gamma: float  # Δγ
    rejected: int  # the number of rejected draws before it


@dataclass(frozen=True)
class Normal:
    """The distribution (γ₀, Δγ) ~ N(µ, Σ), restricted to γ₀ ≥ 0 and Δγ ≥ 0 by rejection.

    Raises:
        InvalidInputError: if Σ is not symmetric or not positive semidefinite.

    Source: section III-C of the paper; the defaults are those of section IV-A.
    """

    mean: Pair = (3.0, 1.5)  # (2,) µ
    # (2, 2) Σ, symmetric and positive semidefinite
    covariance: tuple[Pair, Pair] = ((1.0, 0.0), (0.0, 1.0))
    _root: Array = field(init=False, repr=False, compare=False)  # (2, 2) L with L Lᵀ = Σ

    def __post_init__(self) -> None:
        mean = finite_array("mean", self.mean, (2,))
        covariance = finite_array("covariance", self.covariance, (2, 2))
        eigenvalues, vectors = np.linalg.eigh(covariance)
        rounding = 1e-12 * np.abs(covariance).max(initial=0.0)
        if not np.array_equal(covariance, covariance.T) or eigenvalues.min() < -rounding:
            raise InvalidInputError(
                f"covariance: got {covariance.tolist()}, "
                "expected a symmetric positive semidefinite matrix"
            )
        object.__setattr__(self, "mean", tuple(mean.tolist()))
        object.__setattr__(self, "covariance", tuple(map(tuple, covariance.tolist())))
        object.__setattr__(self, "_root", vectors * np.sqrt(np.maximum(eigenvalues, 0.0)))

    def draw(self, seed: int, number: int) -> Draw:
        """Return the draw of (seed, number), which does not depend on draws before.

        Raises:
            InvalidInputError: if 10,000 draws in a row are negative.
        """
        rng = np.random.default_rng([seed, number])
        for rejected in range(_MAX_REJECTED):
            pair = np.array(self.mean) + self._root @ rng.standard_normal(2)
            if (pair >= 0.0).all():
                gamma0, delta_gamma = pair.tolist()
                return Draw(gamma0, delta_gamma, rejected)
        raise InvalidInputError(
            f"distribution: got mean {self.mean} and covariance {self.covariance}, "
            f"of which {_MAX_REJECTED} draws in a row were negative"
        )
