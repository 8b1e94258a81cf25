"""From the planar input u to where the trunk shall be: the reduced-order model, run at 500 Hz."""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel
from hcbf_gym.locomotion.rotation import wrap_angle

LEASH = 0.15  # [m] the reference never runs further ahead of the robot
# at full grip, and less in proportion to it: turning takes the ground's friction, too
MAX_YAW_RATE = 2.5  # [rad/s]
MAX_YAW_ACCELERATION = 15.0  # [rad/s²]
BRAKING = 0.7  # share of it that a turn plans to brake with
# the heading follows the velocity's direction above the first speed and is held below the second:
# near rest that direction is noise
HEADING_STARTS, HEADING_STOPS = 0.15, 0.10  # [m/s]


class BodyReference(NamedTuple):
    """What the trunk shall do in the plane.

    Attributes:
        position: (2,) [m].
        velocity: (2,) [m/s].
        acceleration: (2,) [m/s²].
        yaw: [rad].
        yaw_rate: [rad/s].
        yaw_acceleration: [rad/s²].
        turning: whether the heading follows the velocity at present.
    """

    position: Array
    velocity: Array
    acceleration: Array
    yaw: float
    yaw_rate: float
    yaw_acceleration: float
    turning: bool


# the same fields as one record, which compiled code updates in place
REFERENCE = np.dtype(
    (
        np.record,
        [
            ("position", "f8", 2),
            ("velocity", "f8", 2),
            ("acceleration", "f8", 2),
            ("yaw", "f8"),
            ("yaw_rate", "f8"),
            ("yaw_acceleration", "f8"),
            ("turning", "u1"),
        ],
    )
)


@kernel()
def advance(
    reference: np.record,
    u: Array,
    robot_position: Array,
    dt: float,
    max_speed: float,
    follow_velocity: bool,
    grip: float,
) -> None:
    """Move the reference on by one tick: ``p̈ = u``, and the heading along the velocity.

    Exact for a constant u below the speed cap; the acceleration handed on is the one that remains
    after the cap, so that the trunk is never pushed against it.

    Args:
        reference: a `REFERENCE` record, changed in place.
        u: (2,) planar input [m/s²].
        robot_position: (3,) of the trunk, from which the reference does not run away [m].
        dt: tick [s].
        max_speed: cap on the speed [m/s].
        follow_velocity: whether the heading follows the velocity; else it is held.
        grip: share of the fastest turn that the ground carries.
    """
    velocity = reference.velocity + dt * u
    speed = np.sqrt(velocity[0] ** 2 + velocity[1] ** 2)
    if speed > max_speed:
        velocity *= max_speed / speed
        speed = max_speed
    position = reference.position + 0.5 * dt * (reference.velocity + velocity)
    ahead = position - robot_position[:2]
    distance = np.sqrt(ahead[0] ** 2 + ahead[1] ** 2)
    if distance > LEASH:
        position -= ahead * (1.0 - LEASH / distance)
    reference.acceleration[:] = (velocity - reference.velocity) / dt
    reference.velocity[:] = velocity
    reference.position[:] = position

    turning = follow_velocity and speed > (HEADING_STOPS if reference.turning else HEADING_STARTS)
    error = 0.0
    if turning:
        error = wrap_angle(np.arctan2(velocity[1], velocity[0]) - reference.yaw)
    # the fastest rate from which the turn can still be braked at the target
    most = grip * MAX_YAW_ACCELERATION
    rate = min(grip * MAX_YAW_RATE, np.sqrt(2.0 * BRAKING * most * abs(error)))
    rate = np.sign(error) * min(rate, abs(error) / dt)
    step = most * dt
    yaw_rate = reference.yaw_rate + min(max(rate - reference.yaw_rate, -step), step)
    reference.turning = turning
    reference.yaw_acceleration = (yaw_rate - reference.yaw_rate) / dt
    reference.yaw_rate = yaw_rate
    reference.yaw = wrap_angle(reference.yaw + dt * yaw_rate)
