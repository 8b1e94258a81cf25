"""Wheeled robots: x starts with the position (x, y) and the heading θ."""

from dataclasses import dataclass, field
from typing import Any

from hcbf_gym import _core
from hcbf_gym.errors import finite_float
from hcbf_gym.models.reduced_order import BuiltIn, namespace


@dataclass(frozen=True)
class Unicycle(BuiltIn):
    """A robot that drives along its heading: x = (p, θ) (3,), u = (speed [m/s], turn rate [rad/s]).

    ``ṗ = u₁ (cos θ, sin θ)``, ``θ̇ = u₂``

    A condition on p alone has relative degree 1 in the speed and 2 in the turn rate. Its row, of
    degree 1, leaves the turn rate free: the filter brakes and does not steer. One that reads a
    point ahead of the wheels, p + ℓ (cos θ, sin θ), reaches both.
    """

    n: int = field(init=False, repr=False, default=3)
    n_u: int = field(init=False, repr=False, default=2)
    velocity_at: int | None = field(init=False, repr=False, default=None)

    def _make_core(self) -> _core.Model:
        return _core.Unicycle()

    def _traced(self, x: Any) -> tuple[Any, Any]:
        xp, zero = namespace(x), 0.0 * x[2]
        drive = xp.stack([xp.cos(x[2]), xp.sin(x[2]), zero])
        return 0.0 * x, xp.stack([drive, xp.stack([zero, zero, zero + 1.0])], axis=1)


@dataclass(frozen=True)
class KinematicBicycle(BuiltIn):
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

    def _make_core(self) -> _core.Model:
        return _core.KinematicBicycle(self.rear)

    def _traced(self, x: Any) -> tuple[Any, Any]:
        xp, zero, v = namespace(x), 0.0 * x[3], x[3]
        cos, sin = xp.cos(x[2]), xp.sin(x[2])
        accelerate = xp.stack([zero, zero, zero, zero + 1.0])
        steer = xp.stack([-v * sin, v * cos, v / self.rear, zero])
        return xp.stack([v * cos, v * sin, zero, zero]), xp.stack([accelerate, steer], axis=1)
