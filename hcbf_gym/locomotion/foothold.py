"""Where a swinging foot shall land."""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel
from hcbf_gym.locomotion.body_reference import BodyReference
from hcbf_gym.models.constants import GRAVITY

SIDEWAYS = 0.085  # [m] the nominal foothold lies this far outside the abad joint
VELOCITY_GAIN = 0.08  # [s] below √(h/g) = .166, which sways with the instantaneous velocity
MAX_OFFSET = 0.16  # [m] from below the hip


@kernel()
def nominal_stance(hip: Array) -> Array:
    """Return (4, 2) the footholds at rest in the trunk's axes, from the abad joints (4, 3) [m]."""
    nominal = np.empty((4, 2))
    for foot in range(4):
        nominal[foot, 0] = hip[foot, 0]
        nominal[foot, 1] = hip[foot, 1] + np.sign(hip[foot, 1]) * SIDEWAYS
    return nominal


class Trunk(NamedTuple):
    """The trunk, as the feet's plan reads it.

    Attributes:
        position: (3,) p [m].
        velocity: (3,) v in the world's axes [m/s].
        yaw: ψ [rad].
        height: h that it shall hold above the ground [m].
    """

    position: Array
    velocity: Array
    yaw: float
    height: float


@kernel()
def foothold(
    nominal: Array, trunk: Trunk, reference: BodyReference, remaining: float, stance_time: float
) -> Array:
    """Return (2,) the foothold in the world [m].

    ``p + v t_rem + R_z(ψ + ω t_rem) n + v T_st/2 + k (v − v_d) + ½ (h/g) ω (v_y, −v_x)``: below
    the hip at touchdown, ahead by half a stance, further out when too fast, and leant into a turn.

    Args:
        nominal: (2,) n, this foot's place at rest in the trunk's axes [m].
        trunk: as measured.
        reference: the desired velocity v_d and turning rate ω.
        remaining: t_rem until touchdown [s].
        stance_time: T_st [s].

    Source: M. Raibert, Legged Robots That Balance (1986), as the paper asks for in section II-B;
    the turning term from the MIT Cheetah 3 controller.
    """
    position = trunk.position
    vx, vy = trunk.velocity[0], trunk.velocity[1]
    lean = 0.5 * trunk.height / GRAVITY * reference.yaw_rate
    dx = 0.5 * stance_time * vx + VELOCITY_GAIN * (vx - reference.velocity[0]) + lean * vy
    dy = 0.5 * stance_time * vy + VELOCITY_GAIN * (vy - reference.velocity[1]) - lean * vx
    scale = min(1.0, MAX_OFFSET / max(np.sqrt(dx * dx + dy * dy), 1e-9))
    heading = trunk.yaw + reference.yaw_rate * remaining
    c, s = np.cos(heading), np.sin(heading)
    landing = np.empty(2)
    landing[0] = position[0] + vx * remaining + c * nominal[0] - s * nominal[1] + scale * dx
    landing[1] = position[1] + vy * remaining + s * nominal[0] + c * nominal[1] + scale * dy
    return landing
