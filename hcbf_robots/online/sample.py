"""A sample of a robot's odometry, and poses in the plane."""

import math
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.filter.samples import real_numbers
from hcbf_gym.models.constants import FARTHEST, ON_EARTH


class Sample(NamedTuple):
    """The robot's pose and twist, measured at the same time."""

    stamp: float = -math.inf  # [s]
    pose: Array = np.full(3, np.nan)  # (3,) x, y and θ of the robot's centre [m, rad]
    twist: Array = np.full(3, np.nan)  # (3,) v_x, v_y and ω in its own axes [m/s, rad/s]

    @property
    def is_sound(self) -> bool:
        """Whether pose, twist and stamp are finite."""
        return bool(np.isfinite(self.pose.sum() + self.twist.sum() + self.stamp))


def moved(pose: Array, twist: Array, seconds: float) -> Array:
    """Return (3,) a pose (3,) moved by a twist (3,) for some seconds, along its mean heading."""
    turned = twist[2] * seconds
    mean_yaw = pose[2] + 0.5 * turned
    cos, sin = math.cos(mean_yaw), math.sin(mean_yaw)
    forward, sideways = seconds * twist[0], seconds * twist[1]
    return pose + np.array([cos * forward - sin * sideways, sin * forward + cos * sideways, turned])


def placed(frame: Array, pose: Array) -> Array:
    """Return (3,) a pose of a frame, expressed in the frame's parent; both are x, y, θ [m, rad]."""
    cos, sin = math.cos(frame[2]), math.sin(frame[2])
    x, y, yaw = pose
    return np.array([frame[0] + cos * x - sin * y, frame[1] + sin * x + cos * y, frame[2] + yaw])


def frame_of(frame: object) -> Array:
    """Return (3,) a frame's pose in its parent [m, rad]: zeros for None, NaN if it is invalid."""
    return np.zeros(3) if frame is None else _numbers(frame, ON_EARTH)


def sample_of(pose: object, twist: object, time: object) -> Sample:
    """Return the sample of a user's pose, twist and time; an invalid one of them becomes NaN."""
    return Sample(number(time), _numbers(pose, ON_EARTH), _numbers(twist, FARTHEST))


def _numbers(values: object, farthest: float) -> Array:
    """Return (3,) numbers; NaN if they are invalid, or one of the first two beyond `farthest`."""
    numbers = None if values is None else real_numbers(values, (3,))
    if numbers is None or np.abs(numbers[:2]).max() > farthest or abs(numbers[2]) > FARTHEST:
        return np.full(3, np.nan)
    return numbers


def number(value: object) -> float:
    """Return a user's value as a number; NaN if it is none."""
    checked = real_numbers(value, ())
    return math.nan if checked is None else float(checked)
