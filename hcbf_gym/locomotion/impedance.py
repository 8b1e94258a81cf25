"""Joint impedance: feedback around the torques that the program feeds forward."""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel
from hcbf_gym.locomotion.body_reference import BodyReference
from hcbf_gym.locomotion.feet import FootTargets
from hcbf_gym.locomotion.leg import FootKinematics, LegGeometry, inverse_kinematics
from hcbf_gym.locomotion.matrices import apply, apply_transposed, cross, inverse_3x3
from hcbf_gym.locomotion.state import StateViews

SWING_KP, SWING_KD = 20.0, 1.0  # [N·m/rad], [N·m·s/rad]
STANCE_KD = 1.0  # a standing leg's place is the ground's business


@kernel()
def joint_feedback(
    state: StateViews,
    R: Array,
    legs: LegGeometry,
    feet: FootKinematics,
    targets: FootTargets,
    reference: BodyReference,
) -> Array:
    """Return (12,) ``K_p(q_d − q) + K_d(q̇_d − q̇)`` [N·m].

    A swinging leg follows its foot's target through inverse kinematics; a standing leg moves as
    the trunk's desired velocity over a resting foot asks.

    Args:
        state: as measured.
        R: (3, 3) trunk → world.
        legs: their lengths.
        feet: the feet's kinematics in the trunk's axes.
        targets: of the feet, in the world.
        reference: of the trunk.
    """
    torque = np.empty(12)
    desired_velocity = np.zeros(3)
    desired_velocity[:2] = reference.velocity
    desired_omega = reference.yaw_rate * R[2]
    for foot in range(4):
        k = slice(3 * foot, 3 * foot + 3)
        r = feet.position[foot]
        rate = state.joint_velocity[k]
        to_joints = inverse_3x3(feet.jacobian[foot])
        if targets.stance[foot]:
            slide = -apply_transposed(R, desired_velocity) - cross(desired_omega, r)
            torque[k] = STANCE_KD * (apply(to_joints, slide) - rate)
        else:
            desired = targets.motion[foot]
            joints = inverse_kinematics(
                legs, foot, apply_transposed(R, desired[0] - state.position)
            )
            slide = apply_transposed(R, desired[1] - state.linear_velocity) - cross(
                state.angular_velocity, r
            )
            torque[k] = SWING_KP * (joints - state.joint_position[k])
            torque[k] += SWING_KD * (apply(to_joints, slide) - rate)
    return torque
