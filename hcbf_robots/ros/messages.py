"""Converts ROS messages to numbers and back; it reads fields only, and does not import ROS."""

import math
from typing import Any

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError
from hcbf_robots.maps.nav2 import Raster
from hcbf_robots.ros.sources import Beams, grid_of

MAX_TILT = 0.1
"""Greatest tilt of a scan's plane [rad]."""
NORM_TOLERANCE = 0.05
"""Greatest difference of a quaternion's norm from 1; within it a quaternion is normalised."""


def seconds(stamp: Any) -> float:
    """Return a `builtin_interfaces/Time` as a number [s]."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def unit_of(orientation: Any) -> Array:
    """Return (4,) x, y, z, w of a quaternion, normalised; NaN where its norm is not about 1."""
    numbers = np.array([orientation.x, orientation.y, orientation.z, orientation.w])
    norm = float(np.linalg.norm(numbers))
    return numbers / norm if abs(norm - 1.0) <= NORM_TOLERANCE else np.full(4, np.nan)


def yaw_of(orientation: Any) -> float:
    """Return the yaw of a quaternion [rad]; NaN where its norm is not about 1."""
    x, y, z, w = unit_of(orientation).tolist()
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _check_norm(name: str, orientation: Any) -> None:
    """Refuse a quaternion whose norm is not about 1; `name` begins the message."""
    if np.isnan(unit_of(orientation)).any():
        raise InvalidInputError(
            f"{name}: got {orientation}, expected a quaternion of the norm 1 within "
            f"{NORM_TOLERANCE:.0%}"
        )


def pose_of(pose: Any) -> Array:
    """Return (3,) x, y [m] and yaw [rad] of a `geometry_msgs/Pose`."""
    return np.array([pose.position.x, pose.position.y, yaw_of(pose.orientation)])


def transform_of(transform: Any) -> Array:
    """Return (3,) x, y [m] and yaw [rad] of a `geometry_msgs/Transform`."""
    translation = transform.translation
    return np.array([translation.x, translation.y, yaw_of(transform.rotation)])


def twist_of(twist: Any) -> Array:
    """Return (3,) v_x, v_y [m/s] and ω [rad/s] of a `geometry_msgs/Twist`."""
    return np.array([twist.linear.x, twist.linear.y, twist.angular.z])


def write_twist(command: Array, twist: Any) -> None:
    """Write a command (v, ω) or (v_x, v_y, ω) into a `geometry_msgs/Twist` of zeros."""
    twist.linear.x, twist.angular.z = float(command[0]), float(command[-1])
    if len(command) == 3:
        twist.linear.y = float(command[1])


def write_pose(pose: Array, message: Any) -> None:
    """Write a pose (3,) x, y [m] and yaw [rad] into a `geometry_msgs/Pose` of zeros."""
    x, y, yaw = pose.tolist()
    message.position.x, message.position.y = x, y
    message.orientation.z, message.orientation.w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)


def mount_of(transform: Any) -> tuple[Array, bool]:
    """Return (3,) the pose of a scanner on the robot [m, rad], and whether it is upside down.

    A tilted scanner is refused, because it sees the floor or looks over obstacles.

    Raises:
        InvalidInputError: if its tilt is above `MAX_TILT`, or the quaternion's norm is not 1.
    """
    _check_norm("tf", transform.rotation)
    x, y, _, _ = unit_of(transform.rotation).tolist()
    up = 1.0 - 2.0 * (x * x + y * y)  # component of the scanner's third axis
    if not abs(up) >= math.cos(MAX_TILT):
        raise InvalidInputError(
            f"tf: the scan's plane has a tilt of {math.acos(min(1.0, abs(up))):.2f} rad, expected "
            f"at most {MAX_TILT:g}: a flat one, either way up"
        )
    return transform_of(transform), up < 0.0


def beams_of(scan: Any) -> Beams:
    """Return the beams of a `sensor_msgs/LaserScan`.

    Raises:
        InvalidInputError: if their number differs by more than one from that of its angles.
    """
    ranges = np.array(scan.ranges, dtype=np.float64)
    expected = float(ranges.size)
    if scan.angle_increment:
        expected = 1.0 + (scan.angle_max - scan.angle_min) / scan.angle_increment
    if not abs(ranges.size - expected) <= 1.5:  # one more or less, after rounding
        raise InvalidInputError(
            f"got {ranges.size} ranges, expected {expected:.0f}: from angle_min {scan.angle_min:g} "
            f"to angle_max {scan.angle_max:g} by angle_increment {scan.angle_increment:g}"
        )
    limits = scan.range_min, scan.range_max
    return Beams(ranges, scan.angle_min, scan.angle_increment, *limits, scan.time_increment)


def raster_of(grid: Any) -> Raster:
    """Return the cells of a `nav_msgs/OccupancyGrid`.

    Raises:
        InvalidInputError: if its numbers make no grid.
        ValueError: if the number of its cells is not that of its rows and columns.
    """
    info = grid.info
    _check_norm("origin", info.origin.orientation)
    cells = np.array(grid.data, dtype=np.int16).reshape(info.height, info.width)
    return Raster(grid_of(info.resolution, pose_of(info.origin), info.height, info.width), cells)


def corners_of(polygon: Any) -> Array:
    """Return (k, 2) the corners of a `geometry_msgs/Polygon` [m]."""
    return np.array([(point.x, point.y) for point in polygon.points]).reshape(-1, 2)
