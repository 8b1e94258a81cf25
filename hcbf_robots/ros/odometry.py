"""Odometry: its interpolation between messages, and the detection of a frozen pose."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_robots.online.sample import moved
from hcbf_robots.ros.watches import Fault

EXTRAPOLATED, LOOKED_BACK = 0.3, 0.1
"""By which a stamp may be after the newest pose, or before the oldest [s]."""
FROZEN_PATH, FROZEN_WITHIN = 0.05, 1e-3
"""A pose is frozen that stays within a millimetre while the twist makes 5 cm in about a second."""


class Odometry(NamedTuple):
    """The robot's pose and velocity at one stamp."""

    stamp: float  # [s]
    pose: Array  # (3,) x, y [m] and yaw [rad]
    twist: Array  # (3,) v_x, v_y [m/s] and ω [rad/s] in the robot's axes


class FrozenPose:
    """Detects odometry that repeats one position while its twist is not zero.

    The path d is what the twist makes while the position is constant, and it decays within a
    second, so that the noise of a twist at rest never adds up: ``ḋ = ‖v‖ − d / (1 s)``.
    """

    def __init__(self) -> None:
        self._position = np.full(2, np.inf)  # from which every first position differs
        self._stamp, self._path = -math.inf, 0.0  # [s], [m]

    def update(self, newest: Odometry) -> None:
        """Integrate d up to the newest message."""
        if np.abs(newest.pose[:2] - self._position).max() > FROZEN_WITHIN:
            self._position, self._path = newest.pose[:2], 0.0
        else:
            seconds = min(newest.stamp - self._stamp, 1.0)
            distance = seconds * float(np.hypot(*newest.twist[:2]))
            self._path += distance - seconds * self._path
        self._stamp = newest.stamp

    def fault(self) -> Fault | None:
        """Return a fault where the pose is frozen."""
        message = f"the pose stands while the twist makes {self._path:.2f} m"
        return Fault("odometry", message) if self._path >= FROZEN_PATH else None


def advanced(start: Odometry, stamp: float, twist: Array) -> Array:
    """Return (3,) the pose at a later stamp [s], at which the robot has a twist (3,).

    It moves by the mean of both twists.
    """
    return moved(start.pose, 0.5 * (start.twist + twist), stamp - start.stamp)


def pose_at(track: deque[Odometry], stamp: float) -> Array | None:
    """Return (3,) the pose at a stamp [s], interpolated; None where the track does not reach."""
    later: Odometry | None = None
    for sample in reversed(track):
        if sample.stamp <= stamp:
            if later is None:
                is_near = stamp - sample.stamp < EXTRAPOLATED
                return advanced(sample, stamp, sample.twist) if is_near else None
            fraction = (stamp - sample.stamp) / (later.stamp - sample.stamp)
            turn = math.remainder(later.pose[2] - sample.pose[2], math.tau)
            step = np.array([*(later.pose - sample.pose)[:2], turn])
            return sample.pose + fraction * step
        later = sample
    if later is not None and later.stamp - stamp < LOOKED_BACK:
        return advanced(later, stamp, later.twist)
    return None
