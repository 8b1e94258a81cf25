"""Odometry: its interpolation between messages, and the detection of a frozen pose."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_robots.online.sample import moved
from hcbf_robots.ros.watches import Fault

MAX_EXTRAPOLATION, MAX_LOOKBACK = 0.3, 0.1
"""Greatest times by which a stamp may be after the newest pose, and before the oldest [s]."""
FROZEN_PATH, FROZEN_RADIUS = 0.05, 1e-3
"""A pose that stays within the radius is frozen when its twist has made a path so long [m]."""


class Odometry(NamedTuple):
    """The robot's pose and velocity at one stamp."""

    stamp: float  # [s]
    pose: Array  # (3,) x, y [m] and yaw [rad]
    twist: Array  # (3,) v_x, v_y [m/s] and ω [rad/s] in the robot's axes


class FrozenPose:
    """Detects odometry that repeats one position while its twist is not zero.

    While the position is constant, the path d of the twist grows by ``ḋ = ‖v‖ − d / (1 s)``. It
    decays within a second, so that the noise of a twist at rest never adds up.
    """

    def __init__(self) -> None:
        self._position = np.full(2, np.inf)  # differs from every first position
        self._stamp, self._path = -math.inf, 0.0  # [s], [m]

    def update(self, newest: Odometry) -> None:
        """Integrate d up to the newest message."""
        if np.abs(newest.pose[:2] - self._position).max() > FROZEN_RADIUS:
            self._position, self._path = newest.pose[:2], 0.0
        else:
            seconds = min(newest.stamp - self._stamp, 1.0)
            distance = seconds * float(np.hypot(*newest.twist[:2]))
            self._path += distance - seconds * self._path
        self._stamp = newest.stamp

    def fault(self) -> Fault | None:
        """Return a fault where the pose is frozen, else None."""
        message = f"the pose stands while the twist makes {self._path:.2f} m"
        return Fault("odometry", message) if self._path >= FROZEN_PATH else None


def advanced(start: Odometry, stamp: float, twist: Array) -> Array:
    """Return (3,) the pose at a later stamp [s], by the mean of the twists (3,) at both ends."""
    return moved(start.pose, 0.5 * (start.twist + twist), stamp - start.stamp)


def pose_at(track: deque[Odometry], stamp: float) -> Array | None:
    """Return (3,) the pose at a stamp [s], inter- or extrapolated; None too far from the track."""
    later: Odometry | None = None
    for sample in reversed(track):
        if sample.stamp <= stamp:
            if later is None:
                is_near = stamp - sample.stamp < MAX_EXTRAPOLATION
                return advanced(sample, stamp, sample.twist) if is_near else None
            fraction = (stamp - sample.stamp) / (later.stamp - sample.stamp)
            turn = math.remainder(later.pose[2] - sample.pose[2], math.tau)
            step = np.array([*(later.pose - sample.pose)[:2], turn])
            return sample.pose + fraction * step
        later = sample
    if later is not None and later.stamp - stamp < MAX_LOOKBACK:
        return advanced(later, stamp, later.twist)
    return None
