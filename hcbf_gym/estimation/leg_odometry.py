"""The trunk's planar velocity from the feet that stand."""

from typing import NamedTuple

import numpy as np
from numba import njit

from hcbf_gym.locomotion.leg import FootKinematics, LegGeometry, foot_kinematics
from hcbf_gym.locomotion.matrices import apply, apply_transposed, cross
from hcbf_gym.locomotion.state import Array, StateViews


class FootVelocities(NamedTuple):
    """What each foot says of the trunk.

    Attributes:
        velocity: (4, 2) of the trunk in the world, if the foot neither slips nor lifts [m/s].
        gain: (4,) variance of that along an axis, over the variance of a joint's rate [m²].
    """

    velocity: Array
    gain: Array


@njit(cache=True)
def trunk_velocities(
    legs: LegGeometry, radius: float, state: StateViews, R: Array
) -> FootVelocities:
    """Return the trunk's velocity as each foot shows it.

    The foot is a ball that rolls: the point that rests on the ground lies the radius ρ below its
    centre and turns with the calf, so that ``v = −R(J q̇ + ω × r + (ω + ω_leg) × (−ρ Rᵀ e_z))``.

    Args:
        legs: lengths of the legs.
        radius: ρ of a foot [m].
        state: as measured.
        R: (3, 3) trunk → world.
    """
    feet = foot_kinematics(legs, state.joint_position, state.joint_velocity)
    below = apply_transposed(R, np.array([0.0, 0.0, -radius]))
    velocity = np.empty((4, 2))
    gain = np.zeros(4)
    for leg in range(4):
        velocity[leg] = -apply(R, _point_velocity(feet, leg, state, below))[:2]
        for axis in range(2):
            for joint in range(3):
                gain[leg] += 0.5 * feet.jacobian[leg, axis, joint] ** 2
    return FootVelocities(velocity, gain)


@njit(cache=True)
def _point_velocity(feet: FootKinematics, leg: int, state: StateViews, below: Array) -> Array:
    """Return (3,) the velocity of a foot's lowest point, without the trunk's own [m/s]."""
    abad, rate = state.joint_position[3 * leg], state.joint_velocity[3 * leg]
    pitch = state.joint_velocity[3 * leg + 1] + state.joint_velocity[3 * leg + 2]
    turning = state.angular_velocity
    calf = turning + np.array([rate, np.cos(abad) * pitch, np.sin(abad) * pitch])
    joints = apply(feet.jacobian[leg], state.joint_velocity[3 * leg : 3 * leg + 3])
    return joints + cross(turning, feet.position[leg]) + cross(calf, below)
