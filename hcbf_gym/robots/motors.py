"""What a motor can give: less torque, the faster it turns."""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel


@kernel()
def torque_limits(stall: Array, no_load_speed: Array, rate: Array, limits: Array) -> None:
    """Fill in the least and the largest torque (2, 12) that the motors give at `rate` [N·m].

    ``τ_max = clip(τ_s (1 − q̇/ω₀), 0, τ_s)`` and ``τ_min = −clip(τ_s (1 + q̇/ω₀), 0, τ_s)``: a motor
    pulls fully at rest and while it brakes, and not at all beyond its no-load speed.

    Args:
        stall: (12,) τ_s of each joint [N·m].
        no_load_speed: (12,) ω₀ [rad/s].
        rate: (12,) q̇ of the joints [rad/s].
        limits: (2, 12), filled in.

    Source: the DC motor of Isaac Lab, whose A1 has 33.5 N·m and 21 rad/s as in Unitree's a1.urdf
    (isaaclab.actuators.DCMotor, isaaclab_assets.robots.unitree.UNITREE_A1_CFG).
    """
    for joint in range(12):
        share = rate[joint] / no_load_speed[joint]
        limits[0, joint] = -stall[joint] * min(max(1.0 + share, 0.0), 1.0)
        limits[1, joint] = stall[joint] * min(max(1.0 - share, 0.0), 1.0)


@kernel()
def drive(
    stall: Array,
    no_load_speed: Array,
    rate: Array,
    strength: float,
    command: Array,
    delivered: Array,
) -> None:
    """Fill in what the motors deliver (12,) of `strength` times the commanded torque (12,) [N·m].

    Args:
        stall: (12,) torque of each joint at rest [N·m].
        no_load_speed: (12,) [rad/s].
        rate: (12,) of the joints [rad/s].
        strength: share of the command that arrives.
        command: (12,) [N·m].
        delivered: (12,), filled in [N·m].
    """
    limits = np.empty((2, 12))
    torque_limits(stall, no_load_speed, rate, limits)
    for joint in range(12):
        torque = strength * command[joint]
        delivered[joint] = min(max(torque, limits[0, joint]), limits[1, joint])
