"""Wheeled robots: x starts with the position (x, y) and the heading θ."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel
from hcbf_gym.errors import finite_float
from hcbf_gym.models.reduced_order import ReducedOrderModel, namespace


@dataclass(frozen=True)
class Unicycle(ReducedOrderModel):
    """A robot that drives where it looks: x = (p, θ) (3,), u = (speed [m/s], turn rate [rad/s]).

    ``ṗ = u₁ (cos θ, sin θ)``, ``θ̇ = u₂``

    A condition on p alone has relative degree 1 in the speed and 2 in the turn rate. Its row, of
    degree 1, leaves the turn rate free: the filter brakes and does not steer. One that reads a
    point ahead of the wheels, p + ℓ (cos θ, sin θ), reaches both.
    """

    n: int = field(init=False, repr=False, default=3)
    n_u: int = field(init=False, repr=False, default=2)
    velocity_at: int | None = field(init=False, repr=False, default=None)

    def f(self, x: Any) -> Any:
        """Return (3,) the drift, 0."""
        return 0.0 * x

    def g(self, x: Any) -> Any:
        """Return (3, 2) the input matrix."""
        if type(x) is np.ndarray:
            return _unicycle_inputs(x)
        xp = namespace(x)
        zero = 0.0 * x[2]
        drive = xp.stack([xp.cos(x[2]), xp.sin(x[2]), zero])
        return xp.stack([drive, xp.stack([zero, zero, zero + 1.0])], axis=1)

    def terms_of(self, x: Array) -> tuple[Array, Array]:
        """Return f (N, 3) and g (N, 3, 2) at N states x (N, 3)."""
        own = type(self) is Unicycle
        return (np.zeros(x.shape), _unicycles_inputs(x)) if own else super().terms_of(x)

    def f_jacobian(self, x: Array) -> Array:
        """Return (3, 3) ∂f/∂x."""
        return np.zeros((3, 3))

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Advance x (3,) by dt [s] under a constant u (2,): one Runge–Kutta step, 4th order."""
        own = type(self) is Unicycle
        return _unicycle_step(x, u, dt) if own else super().step(x, u, dt)

    def steps_of(self, x: Array, u: Array, dt: float) -> Array:
        """Advance N states x (N, 3) by dt [s] under constant inputs u (N, 2)."""
        own = type(self) is Unicycle
        return _unicycles_steps(x, u, dt) if own else super().steps_of(x, u, dt)


@dataclass(frozen=True)
class KinematicBicycle(ReducedOrderModel):
    r"""A car whose slip angle β at the centre of mass is small: x = (p, θ, v) (4,), u = (a, β).

    .. math::
        \dot p = v \begin{pmatrix} \cos θ − β \sin θ \\ \sin θ + β \cos θ \end{pmatrix}, \qquad
        \dot θ = \frac{v}{ℓ_r} β, \qquad \dot v = a

    The steering angle δ that makes β is ``tan δ = (ℓ_f + ℓ_r) / ℓ_r · tan β``. A condition on p
    alone has relative degree 1 in β and 2 in a. Its row, of degree 1, leaves a free: the filter
    steers and does not brake. One that also reads v, such as the distance left after braking,
    reaches both.

    Args:
        rear: ℓ_r, from the centre of mass to the rear axle [m], positive.

    Raises:
        InvalidInputError: if `rear` is not positive.

    Source: Kong et al., "Kinematic and dynamic vehicle models for autonomous driving control
    design", IV 2015, with cos β = 1 and sin β = β.
    """

    rear: float = 1.5
    n: int = field(init=False, repr=False, default=4)
    n_u: int = field(init=False, repr=False, default=2)
    velocity_at: int | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        rear = finite_float("rear", self.rear, minimum=0.0, exclusive=True)
        object.__setattr__(self, "rear", rear)

    def f(self, x: Any) -> Any:
        """Return (4,) the drift (v cos θ, v sin θ, 0, 0)."""
        if type(x) is np.ndarray:
            return _bicycle_rate(x, 0.0, 0.0, self.rear)
        xp = namespace(x)
        zero = 0.0 * x[3]
        return xp.stack([x[3] * xp.cos(x[2]), x[3] * xp.sin(x[2]), zero, zero])

    def g(self, x: Any) -> Any:
        """Return (4, 2) the input matrix."""
        if type(x) is np.ndarray:
            return _bicycle_inputs(x, self.rear)
        xp = namespace(x)
        zero = 0.0 * x[3]
        v = x[3]
        accelerate = xp.stack([zero, zero, zero, zero + 1.0])
        steer = xp.stack([-v * xp.sin(x[2]), v * xp.cos(x[2]), v / self.rear, zero])
        return xp.stack([accelerate, steer], axis=1)

    def brake(self, x: Array, dt: float) -> Array:
        """Return (2,) the input after which v is 0: ``a = −v/dt``, straight on."""
        return np.array([-x[3] / dt, 0.0])

    def terms_of(self, x: Array) -> tuple[Array, Array]:
        """Return f (N, 4) and g (N, 4, 2) at N states x (N, 4)."""
        own = type(self) is KinematicBicycle
        return _bicycles_terms(x, self.rear) if own else super().terms_of(x)

    def brakes_of(self, x: Array, dt: float) -> Array:
        """Return (N, 2) the inputs after which v of N states x (N, 4) is 0, straight on."""
        if type(self) is not KinematicBicycle:
            return super().brakes_of(x, dt)
        return np.column_stack([-x[:, 3] / dt, np.zeros(len(x))])

    def f_jacobian(self, x: Array) -> Array:
        """Return (4, 4) ∂f/∂x."""
        cos = np.cos(x[2])
        sin = np.sin(x[2])
        v = x[3]
        jacobian = np.zeros((4, 4))
        jacobian[0, 2:], jacobian[1, 2:] = (-v * sin, cos), (v * cos, sin)
        return jacobian

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Advance x (4,) by dt [s] under a constant u (2,): one Runge–Kutta step, 4th order."""
        own = type(self) is KinematicBicycle
        return _bicycle_step(x, u, dt, self.rear) if own else super().step(x, u, dt)

    def steps_of(self, x: Array, u: Array, dt: float) -> Array:
        """Advance N states x (N, 4) by dt [s] under constant inputs u (N, 2)."""
        own = type(self) is KinematicBicycle
        return _bicycles_steps(x, u, dt, self.rear) if own else super().steps_of(x, u, dt)


@kernel(error_model="numpy")
def _unicycle_inputs(x: Array) -> Array:
    """Return g (3, 2) at x (3,)."""
    g = np.zeros((3, 2))
    g[0, 0], g[1, 0], g[2, 1] = np.cos(x[2]), np.sin(x[2]), 1.0
    return g


@kernel(error_model="numpy")
def _unicycle_step(x: Array, u: Array, dt: float) -> Array:
    """Return x (3,) after dt; where θ̇ is constant, the four rates are those of Simpson's rule."""
    half, end = x[2] + 0.5 * dt * u[1], x[2] + dt * u[1]
    forward = dt / 6.0 * u[0]
    after = np.empty(3)
    after[0] = x[0] + forward * (np.cos(x[2]) + 4.0 * np.cos(half) + np.cos(end))
    after[1] = x[1] + forward * (np.sin(x[2]) + 4.0 * np.sin(half) + np.sin(end))
    after[2] = end
    return after


@kernel(error_model="numpy")
def _bicycle_inputs(x: Array, rear: float) -> Array:
    """Return g (4, 2) at x (4,)."""
    g = np.zeros((4, 2))
    g[3, 0] = 1.0
    g[0, 1], g[1, 1], g[2, 1] = -x[3] * np.sin(x[2]), x[3] * np.cos(x[2]), x[3] / rear
    return g


@kernel(error_model="numpy")
def _bicycle_rate(x: Array, a: float, slip: float, rear: float) -> Array:
    """Return ẋ (4,) under the inputs a and β."""
    cos, sin = np.cos(x[2]), np.sin(x[2])
    rate = np.empty(4)
    rate[0], rate[1] = x[3] * (cos - slip * sin), x[3] * (sin + slip * cos)
    rate[2], rate[3] = x[3] * slip / rear, a
    return rate


@kernel(error_model="numpy")
def _bicycle_step(x: Array, u: Array, dt: float, rear: float) -> Array:
    """Return x (4,) after dt; see `ReducedOrderModel.step`."""
    a, slip = u[0], u[1]
    k1 = _bicycle_rate(x, a, slip, rear)
    k2 = _bicycle_rate(x + 0.5 * dt * k1, a, slip, rear)
    k3 = _bicycle_rate(x + 0.5 * dt * k2, a, slip, rear)
    k4 = _bicycle_rate(x + dt * k3, a, slip, rear)
    return x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


@kernel(error_model="numpy")
def _unicycles_inputs(x: Array) -> Array:
    """Return g (N, 3, 2) at N states."""
    g = np.empty((len(x), 3, 2))
    for i in range(len(x)):
        g[i] = _unicycle_inputs(x[i])
    return g


@kernel(error_model="numpy")
def _unicycles_steps(x: Array, u: Array, dt: float) -> Array:
    """Return N states x (N, 3) after dt."""
    after = np.empty(x.shape)
    for i in range(len(x)):
        after[i] = _unicycle_step(x[i], u[i], dt)
    return after


@kernel(error_model="numpy")
def _bicycles_terms(x: Array, rear: float) -> tuple[Array, Array]:
    """Return f (N, 4) and g (N, 4, 2) at N states."""
    f, g = np.empty(x.shape), np.empty((len(x), 4, 2))
    for i in range(len(x)):
        f[i], g[i] = _bicycle_rate(x[i], 0.0, 0.0, rear), _bicycle_inputs(x[i], rear)
    return f, g


@kernel(error_model="numpy")
def _bicycles_steps(x: Array, u: Array, dt: float, rear: float) -> Array:
    """Return N states x (N, 4) after dt."""
    after = np.empty(x.shape)
    for i in range(len(x)):
        after[i] = _bicycle_step(x[i], u[i], dt, rear)
    return after
