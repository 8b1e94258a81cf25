"""Where the robot is and was: odometry, placed in the global frame, and refused when it jumps.

A pose topic or tf places the odometry's frame in the global one; between their messages odometry
is used alone.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, shown
from hcbf_gym.filter.samples import real_numbers
from hcbf_gym.models.constants import FARTHEST
from hcbf_robots.online.sample import placed
from hcbf_robots.ros.settings import Settings
from hcbf_robots.ros.watches import Fault, Now, Watch

EXPECTED = f"expected three finite numbers of at most {FARTHEST:g}, and a quaternion of the norm 1"
KNOTS = 9
"""Poses along the sweep of a scan; between them the robot moves straight."""
REMEMBERED = 3.0
"""How long poses are kept, to place scans [s]."""
EXTRAPOLATED, LOOKED_BACK = 0.3, 0.1
"""By which a stamp may be after the newest pose, or before the oldest [s]."""
TURN_JUMP = 0.5
"""By which a yaw may differ from the integrated twist [rad]."""
JUMPED = "odometry has jumped, expected a pose of after that"
FROZEN_PATH, FROZEN_WITHIN = 0.05, 1e-3
"""A pose is frozen that stays within a millimetre while the twist makes 5 cm in about a second."""


class Odometry(NamedTuple):
    """Where the robot was."""

    stamp: float  # [s]
    pose: Array  # (3,) x, y [m] and yaw [rad]
    twist: Array  # (3,) v_x, v_y [m/s] and ω [rad/s] in its own axes


class Located(NamedTuple):
    """An `Odometry` whose pose is in the global frame, and what it follows from."""

    stamp: float
    pose: Array
    twist: Array
    local: Array  # (3,) the pose by odometry
    frame: Array  # (3,) odometry's frame in the global one


class Localization:
    """Takes odometry and what places it, and reports their faults.

    Args:
        settings: the node's parameters.

    Attributes:
        newest: where the robot was last; None where that is unknown. Other threads may read it.
    """

    def __init__(self, settings: Settings):
        self._settings = settings
        self._odometry = Watch("odometry", settings.odom_timeout, settings.transform_tolerance)
        self._pose = Watch("pose", 0.0, settings.transform_tolerance)
        self._local: deque[Odometry] = deque(maxlen=1024)
        self._track: deque[Odometry] = deque(maxlen=1024)  # of these, the accepted ones
        self._needs_pose = settings.pose_source != "odom"
        self._correction: Array | None = None if self._needs_pose else np.zeros(3)
        self._jump: tuple[float, Fault] | None = None  # until when it settles [steady s]
        self._still_path, self._seen_still = 0.0, -math.inf
        self.forget()

    def forget(self) -> None:
        """Begin anew: the clock has gone back, and stamps from before mean nothing."""
        for watch in (self._odometry, self._pose):
            watch.forget()
        if self._needs_pose:
            self._correction = None
        self.newest: Located | None = None
        self._corrected = self._needed = -math.inf  # stamps of tf's: the newest, and what is old
        self._track.clear()
        self._local.clear()
        self._still = np.full(2, np.inf)

    def at(self, stamp: float) -> Array | None:
        """Return (3,) where odometry had the robot at a stamp [s]; None where that is unknown."""
        return _at(self._track.copy(), stamp)

    def path(self, stamp: float, seconds: float) -> Array:
        """Return (`KNOTS`, 3) where odometry had the robot within so many seconds of a stamp [s].

        Raises:
            InvalidInputError: if that is unknown.
        """
        track = self._track.copy()
        poses = [_at(track, stamp + after) for after in np.linspace(0.0, seconds, KNOTS)]
        known = [pose for pose in poses if pose is not None]
        if len(known) < KNOTS:
            raise InvalidInputError(
                f"time_increment: got beams within {seconds:g} s of the stamp, expected odometry "
                "of that time"
            )
        return np.array(known)

    def hear_odometry(
        self, pose: ArrayLike, twist: ArrayLike, stamp: float, now: Now, frame: str, child: str
    ) -> bool:
        """Take pose (3,) and twist (3,), see `Odometry`; return whether the robot has jumped.

        `frame` is the pose's, and `child` the twist's; "" is the robot's.
        """
        place, motion = (_plausible(given) for given in (pose, twist))
        watch, settings = self._odometry, self._settings
        if child and child != settings.base_frame_id:
            return watch.refuse(f"child frame {child!r}, expected {settings.base_frame_id!r}")
        if place is None or motion is None:
            return watch.refuse(f"got {shown([pose, twist])}, {EXPECTED}")
        if not watch.hear(stamp, now, frame, settings.odom_frame_id):
            return False
        newest = Odometry(stamp, place, motion)
        leaps = bool(self._local) and self._off(self._local[-1], newest) is not None
        if leaps:  # nothing ties it to the poses of before
            self._local.clear()
            self._track.clear()
            self._needed = max(stamp, self._corrected)
            if self._needs_pose:
                self._correction = None
                self._pose.refuse(JUMPED)
        self._local.append(newest)
        self._look_still(newest)
        if self._correction is None:
            return leaps
        there = placed(self._correction, place)
        located = Located(stamp, there, motion, place, self._correction)
        return self._follow(located, now) or leaps

    def hear_pose(self, pose: ArrayLike, stamp: float, now: Now, frame: str) -> None:
        """Take where the robot was in the global frame: it places odometry from there on."""
        given = _plausible(pose)
        if given is None:
            self._pose.refuse(f"got {shown(pose)}, {EXPECTED}")
        elif self._pose.hear(stamp, now, frame, self._settings.global_frame_id):
            local = _at(self._local, stamp)
            if local is not None:
                self._correction = _between(local, given)
            elif self._correction is None:  # else the one before remains
                self._pose.refuse("there is no odometry of that time")

    def hear_correction(self, correction: ArrayLike | None, stamp: float) -> None:
        """Take odometry's frame (3,) in the global one as tf has it; None where it has none.

        The stamp [s] of one that never changes is 0.
        """
        given = _plausible(correction)
        if correction is not None and given is None:
            wrong = f"got {shown(correction)} of tf, {EXPECTED}"
        elif given is not None and stamp > 0.0 and stamp <= self._needed:
            given, wrong = None, JUMPED
        else:
            wrong = "tf has no transform to the odometry's frame"
            self._corrected = max(self._corrected, stamp)
        self._correction = given
        if given is not None:
            self._pose.set_known()
        else:
            self._pose.refuse(wrong)

    def faults(self, now: Now) -> list[Fault | None]:
        """Return what is wrong now."""
        if self._jump is not None and now.steady >= self._jump[0]:
            self._jump = None
        still = f"the pose stands while the twist makes {self._still_path:.2f} m"
        return [
            self._odometry.fault(now),
            self._pose.fault(now) if self._needs_pose else None,
            Fault("odometry", still) if self._still_path >= FROZEN_PATH else None,
            self._jump[1] if self._jump is not None else None,
        ]

    def _follow(self, newest: Located, now: Now) -> bool:
        """Remember a pose; if it has jumped, forget the others and return True."""
        off = None if self.newest is None else self._off(self.newest, newest)
        if off is not None:
            message = f"the pose has jumped by {off[0]:.2f} m and {off[1]:.2f} rad"
            self._jump = now.steady + self._settings.settle_time, Fault("odometry", message)
            self._track.clear()
        self.newest = newest
        self._track.append(Odometry(newest.stamp, newest.local, newest.twist))
        while newest.stamp - self._track[0].stamp > REMEMBERED:
            self._track.popleft()
        return off is not None

    def _look_still(self, newest: Odometry) -> None:
        """Note how far the twist would have moved the robot while its pose is constant."""
        if np.abs(newest.pose[:2] - self._still).max() > FROZEN_WITHIN:
            self._still, self._still_path = newest.pose[:2], 0.0
        else:
            seconds = min(newest.stamp - self._seen_still, 1.0)
            made = seconds * float(np.hypot(*newest.twist[:2]))
            self._still_path += made - seconds * self._still_path
        self._seen_still = newest.stamp

    def _off(
        self, before: Odometry | Located, newest: Odometry | Located
    ) -> tuple[float, float] | None:
        """Return by how much a pose has jumped from the integrated twists [m, rad], if it has.

        A robot without messages for longer than the time-out was commanded zero: it may be anywhere
        on the path to there.
        """
        made = _advanced(before, newest.stamp, newest.twist) - before.pose
        moved, way, least = newest.pose - before.pose, made[:2], 1.0
        low = high = made[2]
        if newest.stamp - before.stamp > self._settings.odom_timeout:
            least, low, high = 0.0, min(0.0, made[2]), max(0.0, made[2])
        share = np.clip(moved[:2] @ way / max(way @ way, 1e-12), least, 1.0)
        turns = math.remainder(moved[2], math.tau) + math.tau * np.arange(-1, 2)
        away = float(np.hypot(*(moved[:2] - share * way)))
        turned = float(np.abs(turns - np.clip(turns, low, high)).min())
        jumps = away > self._settings.pose_jump or turned > TURN_JUMP
        return (away, turned) if jumps else None


def _plausible(given: object) -> Array | None:
    """Return (3,) given numbers; None where they are not three, or beyond `FARTHEST`."""
    numbers = real_numbers(given, (3,))
    return None if numbers is None or np.abs(numbers).max() > FARTHEST else numbers


def _between(local: Array, pose: Array) -> Array:
    """Return the frame in which `local` is the pose `pose`."""
    yaw = pose[2] - local[2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y = local[:2]
    return np.array([pose[0] - cos * x + sin * y, pose[1] - sin * x - cos * y, yaw])


def _advanced(one: Odometry | Located, stamp: float, twist: Array) -> Array:
    """Return (3,) a pose moved by the mean of two twists until a stamp [s]."""
    seconds, motion = stamp - one.stamp, 0.5 * (one.twist + twist)
    middle = np.array([*one.pose[:2], one.pose[2] + 0.5 * seconds * motion[2]])
    moved = placed(middle, np.array([*(seconds * motion[:2]), 0.0]))
    return np.array([*moved[:2], one.pose[2] + seconds * motion[2]])


def _at(track: deque[Odometry], stamp: float) -> Array | None:
    """Return (3,) the pose at a stamp [s], None where the track does not reach so far."""
    later: Odometry | None = None
    for one in reversed(track):
        if one.stamp <= stamp:
            if later is None:
                near = stamp - one.stamp < EXTRAPOLATED
                return _advanced(one, stamp, one.twist) if near else None
            share = (stamp - one.stamp) / (later.stamp - one.stamp)
            turn = math.remainder(later.pose[2] - one.pose[2], math.tau)
            step = np.array([*(later.pose - one.pose)[:2], turn])
            return one.pose + share * step
        later = one
    if later is not None and later.stamp - stamp < LOOKED_BACK:
        return _advanced(later, stamp, later.twist)
    return None
