"""What comes with a message of a robot's odometry."""

import math
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.filter.samples import real_numbers
from hcbf_gym.models.constants import FARTHEST, ON_EARTH


class Sample(NamedTuple):
    """What was measured at once."""

    stamp: float = -math.inf  # [s]
    place: Array = np.full(3, np.nan)  # (3,) x, y and θ of the robot's centre [m, rad]
    motion: Array = np.full(3, np.nan)  # (3,) v_x, v_y and ω in its own axes [m/s, rad/s]

    @property
    def is_sound(self) -> bool:
        """Whether all of it is finite."""
        return bool(np.isfinite(self.place.sum() + self.motion.sum() + self.stamp))


def moved(place: Array, motion: Array, seconds: float) -> Array:
    """Return (3,) where a twist brings a pose within seconds, by its direction half-way."""
    turned = motion[2] * seconds
    cos, sin = math.cos(place[2] + 0.5 * turned), math.sin(place[2] + 0.5 * turned)
    ahead, aside = seconds * motion[0], seconds * motion[1]
    return place + np.array([cos * ahead - sin * aside, sin * ahead + cos * aside, turned])


def placed(frame: Array, pose: Array) -> Array:
    """Return (3,) a pose of a frame (x, y, θ) in the frame's parent [m, rad]."""
    cos, sin = math.cos(frame[2]), math.sin(frame[2])
    x, y, yaw = pose
    return np.array([frame[0] + cos * x - sin * y, frame[1] + sin * x + cos * y, frame[2] + yaw])


def frame_of(frame: object) -> Array:
    """Return (3,) a frame in its parent [m, rad]: the parent for None, NaN for an invalid one."""
    return np.zeros(3) if frame is None else _numbers(frame, ON_EARTH)


def sample_of(pose: object, twist: object, time: object) -> Sample:
    """Return the sample of a message; NaN for invalid parts."""
    return Sample(number(time), _numbers(pose, ON_EARTH), _numbers(twist, FARTHEST))


def _numbers(values: object, farthest: float) -> Array:
    """Return (3,) numbers of a message; NaN where they are invalid, or two beyond `farthest`."""
    given = None if values is None else real_numbers(values, (3,))
    if given is None or np.abs(given[:2]).max() > farthest or abs(given[2]) > FARTHEST:
        return np.full(3, np.nan)
    return given


def number(value: object) -> float:
    """Return a number of a message; NaN where it is invalid."""
    given = real_numbers(value, ())
    return math.nan if given is None else float(given)
