"""Wheeled robots: x starts with the position (x, y) and the heading θ."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
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
            return _unicycle_inputs(x[None])[0]
        xp = namespace(x)
        zero = 0.0 * x[2]
        drive = xp.stack([xp.cos(x[2]), xp.sin(x[2]), zero])
        return xp.stack([drive, xp.stack([zero, zero, zero + 1.0])], axis=1)

    def terms_of(self, x: Array) -> tuple[Array, Array]:
        """Return f (N, 3) and g (N, 3, 2) at N states x (N, 3)."""
        own = type(self) is Unicycle
        return (np.zeros(x.shape), _unicycle_inputs(x)) if own else super().terms_of(x)

    def f_jacobian(self, x: Array) -> Array:
        """Return (3, 3) ∂f/∂x."""
        return np.zeros((3, 3))

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Advance x (3,) by dt [s] under a constant u (2,): one Runge–Kutta step, 4th order."""
        own = type(self) is Unicycle
        return self.steps_of(x[None], u[None], dt)[0] if own else super().step(x, u, dt)

    def steps_of(self, x: Array, u: Array, dt: float) -> Array:
        """Advance N states x (N, 3) by dt [s] under constant inputs u (N, 2)."""
        if type(self) is not Unicycle:
            return super().steps_of(x, u, dt)
        after = np.empty(x.shape)
        _core.unicycle_steps(x, u, dt, after)
        return after


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
            return self._drifts(x[None])[0]
        xp = namespace(x)
        zero = 0.0 * x[3]
        return xp.stack([x[3] * xp.cos(x[2]), x[3] * xp.sin(x[2]), zero, zero])

    def g(self, x: Any) -> Any:
        """Return (4, 2) the input matrix."""
        if type(x) is np.ndarray:
            return self._inputs(x[None])[0]
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
        return (self._drifts(x), self._inputs(x)) if own else super().terms_of(x)

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
        return self.steps_of(x[None], u[None], dt)[0] if own else super().step(x, u, dt)

    def steps_of(self, x: Array, u: Array, dt: float) -> Array:
        """Advance N states x (N, 4) by dt [s] under constant inputs u (N, 2)."""
        if type(self) is not KinematicBicycle:
            return super().steps_of(x, u, dt)
        after = np.empty(x.shape)
        _core.bicycle_steps(x, u, dt, self.rear, after)
        return after

    def _drifts(self, x: Array) -> Array:
        """Return f (N, 4) at N states."""
        f = np.empty(x.shape)
        _core.bicycle_drifts(x, self.rear, f)
        return f

    def _inputs(self, x: Array) -> Array:
        """Return g (N, 4, 2) at N states."""
        g = np.empty((len(x), 4, 2))
        _core.bicycle_inputs(x, self.rear, g)
        return g


def _unicycle_inputs(x: Array) -> Array:
    """Return g (N, 3, 2) at N states."""
    g = np.empty((len(x), 3, 2))
    _core.unicycle_inputs(x, g)
    return g
