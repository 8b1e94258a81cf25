"""Reduced-order models ẋ = f(x) + g(x)u of a walking robot's base in the plane."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.errors import finite_float

Array = NDArray[np.float64]


class ReducedOrderModel(Protocol):
    """A control-affine model whose state starts with the planar position.

    Source: equation (1) of the paper.
    """

    @property
    def n(self) -> int:
        """The number of states."""
        ...

    @property
    def n_u(self) -> int:
        """The number of inputs."""
        ...

    def f(self, x: Array) -> Array:
        """Return (n,) the drift."""
        ...

    def f_jacobian(self, x: Array) -> Array:
        """Return (n, n) ∂f/∂x."""
        ...

    def g(self, x: Array) -> Array:
        """Return (n, n_u) the input matrix; constant in x, so that L_g ψ needs no ∂g/∂x."""
        ...

    def relative_degree(self, reads_position: bool) -> int:
        """Return how often h must be differentiated until u appears."""
        ...


@dataclass(frozen=True)
class SingleIntegrator:
    """A point whose velocity is the input, ``ṗ = u``: x = p (2,) [m], u (2,) [m/s]."""

    @property
    def n(self) -> int:
        """The number of states."""
        return 2

    @property
    def n_u(self) -> int:
        """The number of inputs."""
        return 2

    def f(self, x: Array) -> Array:
        """Return (2,) the drift."""
        return np.zeros(2)

    def f_jacobian(self, x: Array) -> Array:
        """Return (2, 2) ∂f/∂x."""
        return np.zeros((2, 2))

    def g(self, x: Array) -> Array:
        """Return (2, 2) the input matrix."""
        return np.eye(2)

    def relative_degree(self, reads_position: bool) -> int:
        """Return 1: u is the velocity itself."""
        return 1


@dataclass(frozen=True)
class DoubleIntegrator:
    """A point whose acceleration is the input, ``p̈ = u``: x = (p, v) (4,), u (2,) [m/s²].

    Source: section IV-A of the paper.
    """

    @property
    def n(self) -> int:
        """The number of states."""
        return 4

    @property
    def n_u(self) -> int:
        """The number of inputs."""
        return 2

    def f(self, x: Array) -> Array:
        """Return (4,) the drift (v, 0)."""
        return np.concatenate([x[2:4], np.zeros(2)])

    def f_jacobian(self, x: Array) -> Array:
        """Return (4, 4) ∂f/∂x."""
        return np.eye(4, k=2)

    def g(self, x: Array) -> Array:
        """Return (4, 2) the input matrix."""
        return np.vstack([np.zeros((2, 2)), np.eye(2)])

    def relative_degree(self, reads_position: bool) -> int:
        """Return 2 for a condition on the position, 1 for one on the velocity."""
        return 2 if reads_position else 1


@dataclass(frozen=True)
class LinearInvertedPendulum:
    """A mass at constant height over its pivot, ``p̈ = (g/z)(p − u)``: u (2,) is the pivot [m].

    Args:
        height: z of the mass [m], positive.
        gravity: g [m/s²], positive.

    Raises:
        InvalidInputError: if an argument is not positive.
    """

    height: float = 0.27
    gravity: float = 9.81

    @property
    def n(self) -> int:
        """The number of states."""
        return 4

    @property
    def n_u(self) -> int:
        """The number of inputs."""
        return 2

    def __post_init__(self) -> None:
        finite_float("height", self.height, minimum=0.0, exclusive=True)
        finite_float("gravity", self.gravity, minimum=0.0, exclusive=True)

    def f(self, x: Array) -> Array:
        """Return (4,) the drift (v, (g/z) p)."""
        return self.f_jacobian(x) @ x

    def f_jacobian(self, x: Array) -> Array:
        """Return (4, 4) ∂f/∂x."""
        return np.eye(4, k=2) + self.gravity / self.height * np.eye(4, k=-2)

    def g(self, x: Array) -> Array:
        """Return (4, 2) the input matrix."""
        return np.vstack([np.zeros((2, 2)), -self.gravity / self.height * np.eye(2)])

    def relative_degree(self, reads_position: bool) -> int:
        """Return 2 for a condition on the position, 1 for one on the velocity."""
        return 2 if reads_position else 1


@njit(cache=True)
def double_integrator_step(
    x: Array, u: Array, dt: float, v_max: float
) -> tuple[float, float, float, float]:
    """Advance the double integrator exactly under constant u, its speed capped at v_max.

    ``v' = v + u dt`` (scaled back to v_max where it exceeds it), ``p' = p + (v + v') dt / 2``

    Args:
        x: (4,) p [m] and v [m/s].
        u: (2,) acceleration [m/s²].
        dt: [s].
        v_max: [m/s]; infinity for none.

    Returns:
        p_x, p_y [m], v_x, v_y [m/s] after dt.
    """
    vx, vy = x[2] + u[0] * dt, x[3] + u[1] * dt
    speed = np.sqrt(vx * vx + vy * vy)
    if speed > v_max:
        scale = v_max * (1.0 - 1e-12) / speed  # below the limit whichever way it is rounded
        vx, vy = scale * vx, scale * vy
    return x[0] + 0.5 * (x[2] + vx) * dt, x[1] + 0.5 * (x[3] + vy) * dt, vx, vy
