r"""Caps on the speed: everywhere, or inside zones, before which the robot brakes.

The h of a zone is

.. math:: h = (L² + 2 β d^+ - ‖v‖²) / (2 L),

with d⁺ the distance to its nearest cell, 0 inside, L the limit there, and β a deceleration that
every robot here can do. Its unit is m/s, as that of a speed limit. h is 0 at the speed from which
braking by β reaches L at the edge. `docs/rows.md` derives the row of an input that is held.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier, Jet
from hcbf_gym.barriers.shape import set_positive
from hcbf_gym.errors import InvalidInputError, finite_float

BRAKING = _core.ZONE_BRAKING
"""β, the deceleration with which a robot slows down before a zone [m/s²]."""


def least_limit(period: float, u_max: float, margin: float, turn: float = 0.0) -> float:
    """Return the lowest limit of a zone [m/s] that held inputs can satisfy with a margin.

    It solves ``L² − 2 m L = (β² (1 + ΩT/2)² + β u (1 + ΩT) + u²) T²``; see `docs/rows.md`.

    Args:
        period: T [s].
        u_max: u, the greatest change of the speed [m/s²].
        margin: m [m/s].
        turn: Ω, the greatest turning rate of a differential drive [rad/s]; 0 for all others.
    """
    angle = turn * period
    squared = (BRAKING * (1.0 + 0.5 * angle)) ** 2 + BRAKING * u_max * (1.0 + angle) + u_max**2
    return float(margin + np.hypot(margin, period * np.sqrt(squared)))


def leaves_speed(v_max: float, margin: float) -> bool:
    """Return whether a cap leaves a speed after its margin [m/s]; at rest its h is v_max/2."""
    return v_max > 2.0 * margin


def check_leaves_speed(what: str, v_max: float, margin: float) -> None:
    """Raise an InvalidInputError if a cap, which it calls `what`, leaves no speed."""
    if not leaves_speed(v_max, margin):
        raise InvalidInputError(
            f"{what}: got {v_max:g} m/s, expected above {2.0 * margin:g} m/s: the row of the speed "
            f"limit reserves {margin:g} m/s, so that no speed is left"
        )


@dataclass(frozen=True)
class SpeedLimit(Barrier):
    """A cap on the speed of a second-order model, ``h = (v_max² − ‖v‖²) / (2 v_max)``.

    Smooth everywhere, and equal to v_max − ‖v‖ [m/s] to first order at the limit.

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        v_max: the cap [m/s], positive.
        margin: what the row reserves of h [m/s], as a body's speed oscillates around its model's.

    Raises:
        InvalidInputError: if v_max is not positive or the margin is not in [0, v_max).
    """

    v_max: float = 1.0
    margin: float = 0.0
    kind: ClassVar[str] = "speed-limit"
    reads_position: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        set_positive(self, "v_max")
        margin = finite_float(f"{self.name}: margin", self.margin, minimum=0.0)
        if margin >= self.v_max:
            text = f"{self.name}: margin: got {margin}, expected below {self.v_max}"
            raise InvalidInputError(text)
        object.__setattr__(self, "margin", margin)

    def write(self, c: Array) -> int:
        """Write the block c (WIDTH,) and return the kind."""
        c[:] = 0.0
        c[layout.V_MAX] = self.v_max
        return layout.SPEED_LIMIT

    def jet(self, x: Array, t: float = 0.0) -> Jet:
        """Return h and its derivatives."""
        gradient, hessian = np.zeros(len(x)), np.zeros((len(x),) * 2)
        gradient[2:4] = -x[2:4] / self.v_max
        hessian[2:4, 2:4] = -np.eye(2) / self.v_max
        h = _core.speed_limit_value(self.v_max, float(x[2]), float(x[3]))
        return Jet(h, gradient, hessian, 0.0, np.zeros(len(x)), 0.0)
