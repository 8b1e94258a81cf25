"""The tasks y of the task-space controller: which accelerations would mend the errors."""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel
from hcbf_gym.locomotion.body_reference import BodyReference
from hcbf_gym.locomotion.feet import FootTargets
from hcbf_gym.locomotion.leg import FootKinematics
from hcbf_gym.locomotion.matrices import apply, cross
from hcbf_gym.locomotion.rotation import rotation_vector_to_yaw
from hcbf_gym.locomotion.state import StateViews

# Stiffness K_p [1/s²] and damping K_d [1/s]. The paper leaves them open; all are ours, about
# critically damped, K_d ≈ 2 √K_p, and held to the bounds of docs/locomotion.md.
PLANE_KP, PLANE_KD = 80.0, 15.0  # a third of the lag behind the reference that 30 and 10 leave
HEIGHT_KP, HEIGHT_KD = 150.0, 25.0  # 12 rad/s: what remains is learnt, see `tick.HEIGHT_KI`
TILT_KP, TILT_KD = 300.0, 30.0  # the fastest of the trunk, 17 rad/s: a tilt moves every foot
YAW_KP, YAW_KD = 100.0, 20.0  # 10 rad/s: the reference turns at 2.5 rad/s at most
SWING_KP, SWING_KD = 400.0, 40.0  # 20 rad/s: an error shrinks by e^-2.6 in a swing of .13 s
CATCH_UP = 0.1  # [m/s] above the speed cap at most, to make up for a lag: it halved the overspeed

# the other tasks weigh 1: of what two feet cannot do at once, the height goes first
HEIGHT_WEIGHT = 3.0
FORCE_WEIGHT = 1e-4  # on ‖F‖², which decides between forces that do the same


class TaskAccelerations(NamedTuple):
    """``ÿ_d + K_d(ẏ_d − ẏ) + K_p(y_d − y)`` of every task; in the plane within a cap on the speed.

    Attributes:
        linear: (3,) of the trunk's origin, in the world's axes [m/s²].
        angular: (3,) of the trunk, in its own axes [rad/s²].
        feet: (4, 3) in the world's axes, read for swinging feet only [m/s²].
    """

    linear: Array
    angular: Array
    feet: Array


@kernel()
def task_accelerations(
    state: StateViews,
    R: Array,
    feet: FootKinematics,
    reference: BodyReference,
    targets: FootTargets,
    too_low: float,
    max_speed: float,
) -> TaskAccelerations:
    """Return the accelerations that the task-space QP shall come close to.

    In the plane the law reads ``ÿ_d + K_d(w − ẏ)``, and the speed ``w = ẏ_d + K_p/K_d (y_d − y)``
    that would make up for a lag is bounded.

    Args:
        state: as measured.
        R: (3, 3) trunk → world.
        feet: the feet's kinematics in the trunk's axes.
        reference: of the trunk in the plane.
        targets: of the feet.
        too_low: desired height of the trunk less the measured one [m].
        max_speed: cap on the reference's speed [m/s].
    """
    position, velocity, omega = state.position, state.linear_velocity, state.angular_velocity
    linear = np.empty(3)
    for i in range(2):
        lag = reference.position[i] - position[i]
        linear[i] = reference.velocity[i] + PLANE_KP / PLANE_KD * lag
    speed = np.sqrt(linear[0] ** 2 + linear[1] ** 2)
    scale = min(1.0, (max_speed + CATCH_UP) / max(speed, 1e-9))
    for i in range(2):
        linear[i] = reference.acceleration[i] + PLANE_KD * (scale * linear[i] - velocity[i])
    linear[2] = HEIGHT_KP * too_low - HEIGHT_KD * velocity[2]

    turn = rotation_vector_to_yaw(R, reference.yaw)
    up = R[2]  # the world's vertical in the trunk's axes
    angular = np.empty(3)
    for i in range(3):
        kp, kd = (YAW_KP, YAW_KD) if i == 2 else (TILT_KP, TILT_KD)
        angular[i] = (
            reference.yaw_acceleration * up[i]
            + kd * (reference.yaw_rate * up[i] - omega[i])
            + kp * turn[i]
        )

    swing = np.zeros((4, 3))
    for foot in range(4):
        if targets.stance[foot]:
            continue
        r = feet.position[foot]
        own = apply(feet.jacobian[foot], state.joint_velocity[3 * foot : 3 * foot + 3])
        foot_position = position + apply(R, r)
        foot_velocity = velocity + apply(R, cross(omega, r) + own)
        desired = targets.motion[foot]
        swing[foot] = (
            desired[2]
            + SWING_KD * (desired[1] - foot_velocity)
            + SWING_KP * (desired[0] - foot_position)
        )
    return TaskAccelerations(linear, angular, swing)
