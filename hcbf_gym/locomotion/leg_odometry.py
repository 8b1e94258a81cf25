"""The trunk's planar velocity from the feet that stand."""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel
from hcbf_gym.locomotion.leg import FootKinematics
from hcbf_gym.locomotion.matrices import add_cross, apply
from hcbf_gym.locomotion.state import StateViews


class FootVelocity(NamedTuple):
    """What a foot says of the trunk.

    Attributes:
        velocity: (2,) of the trunk in the world, if the foot neither slips nor lifts [m/s].
        gain: variance of that along an axis, over the variance of a joint's rate [m²].
    """

    velocity: Array
    gain: float


@kernel()
def trunk_velocity(
    feet: FootKinematics, radius: float, leg: int, state: StateViews, R: Array
) -> FootVelocity:
    """Return the trunk's velocity as a foot shows it.

    The foot is a ball that rolls: the point that rests on the ground lies the radius ρ below its
    centre and turns with the calf, so that ``v = −R(J q̇ + ω × r + (ω + ω_leg) × (−ρ Rᵀ e_z))``.

    Args:
        feet: kinematics of all feet.
        radius: ρ of a foot [m].
        leg: which foot.
        state: as measured.
        R: (3, 3) trunk → world.
    """
    abad = state.joint_position[3 * leg]
    rates = state.joint_velocity[3 * leg : 3 * leg + 3]
    pitch = rates[1] + rates[2]
    calf = state.angular_velocity.copy()
    calf[0] += rates[0]
    calf[1] += np.cos(abad) * pitch
    calf[2] += np.sin(abad) * pitch
    jacobian = feet.jacobian[leg]
    moving = apply(jacobian, rates)
    add_cross(moving, state.angular_velocity, feet.position[leg])
    add_cross(moving, calf, -radius * R[2])
    gain = 0.0
    for axis in range(2):
        for joint in range(3):
            gain += 0.5 * jacobian[axis, joint] ** 2
    return FootVelocity(-apply(R, moving)[:2], gain)
