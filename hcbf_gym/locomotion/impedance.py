"""Joint impedance: the program's torques fed forward, and joint feedback around them."""

import numpy as np
from numba import njit

from hcbf_gym.locomotion.body_reference import BodyReference
from hcbf_gym.locomotion.feet import FootTargets
from hcbf_gym.locomotion.leg import FootKinematics, LegGeometry, inverse_3x3, inverse_kinematics
from hcbf_gym.locomotion.rotation import cross
from hcbf_gym.locomotion.state import Array

SWING_KP, SWING_KD = 20.0, 1.0  # [N·m/rad], [N·m·s/rad]
STANCE_KD = 1.0  # a standing leg's place is the ground's business


@njit(cache=True)
def joint_impedance(
    feedforward: Array,
    joint_position: Array,
    joint_velocity: Array,
    geometry: LegGeometry,
    feet: FootKinematics,
    targets: FootTargets,
    reference: BodyReference,
    position: Array,
    velocity: Array,
    R: Array,
    omega: Array,
    torque_limit: float,
) -> Array:
    """Return (12,) ``τ = τ_ff + K_p(q_d − q) + K_d(q̇_d − q̇)`` within the torque limit [N·m].

    A swinging leg follows its foot's target through inverse kinematics; a standing leg moves as
    the trunk's desired velocity over a resting foot asks.

    Args:
        feedforward: (12,) τ_ff of the task-space program [N·m].
        joint_position: (12,) q [rad].
        joint_velocity: (12,) q̇ [rad/s].
        geometry: of the legs.
        feet: kinematics of the feet in the trunk's axes.
        targets: of the feet, in the world.
        reference: of the trunk.
        position: (3,) of the trunk [m].
        velocity: (3,) of the trunk in the world's axes [m/s].
        R: (3, 3) trunk → world.
        omega: (3,) of the trunk in its own axes [rad/s].
        torque_limit: [N·m].
    """
    torque = feedforward.copy()
    desired_velocity = np.array([reference.velocity[0], reference.velocity[1], 0.0])
    desired_omega = reference.yaw_rate * R[2]
    for foot in range(4):
        k = slice(3 * foot, 3 * foot + 3)
        to_joints = inverse_3x3(feet.jacobian[foot])
        r = feet.position[foot]
        if targets.stance[foot]:
            slide = -(R.T @ desired_velocity) - cross(desired_omega, r)
            torque[k] += STANCE_KD * (to_joints @ slide - joint_velocity[k])
        else:
            place = R.T @ (targets.motion[foot, 0] - position)
            joints = inverse_kinematics(geometry, foot, place)
            slide = R.T @ (targets.motion[foot, 1] - velocity) - cross(omega, r)
            torque[k] += SWING_KP * (joints - joint_position[k])
            torque[k] += SWING_KD * (to_joints @ slide - joint_velocity[k])
    return np.minimum(np.maximum(torque, -torque_limit), torque_limit)
