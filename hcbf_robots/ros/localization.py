"""Where the robot is and was: odometry, placed in the global frame, and not believed when it jumps.

A pose topic or tf places the odometry's frame in the global one; between their messages odometry
goes on alone.
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
from hcbf_robots.ros.parameters import Settings
from hcbf_robots.ros.watches import Fault, Now, Watch

EXPECTED = f"expected three finite numbers of at most {FARTHEST:g}, and a quaternion of the norm 1"
KNOTS = 9
"""Poses along the sweep of a scan; between them the robot moves straight."""
REMEMBERED = 3.0
"""How long poses are kept, to place scans [s]."""
EXTRAPOLATED, LOOKED_BACK = 0.3, 0.1
"""By which a stamp may be after the newest pose, or before the oldest [s]."""
TURN_JUMP = 0.5
"""By which a yaw may differ from what the twist says [rad]."""
JUMPED = "odometry has jumped, expected a pose of after that"
FROZEN_PATH, FROZEN_WITHIN = 0.05, 1e-3
"""A pose is frozen that stays within a millimetre while the twist makes 5 cm in about a second."""


class Odometry(NamedTuple):
    """Where the robot was.

    Attributes:
        stamp: when [s].
        pose: (3,) x, y [m] and yaw [rad].
        twist: (3,) v_x, v_y [m/s] and ω [rad/s] in its own axes.
    """

    stamp: float
    pose: Array
    twist: Array


class Located(NamedTuple):
    """Where the robot was in the global frame, and how odometry has it.

    Attributes:
        stamp: when [s].
        pose: (3,) x, y [m] and yaw [rad] in the global frame.
        twist: (3,) v_x, v_y [m/s] and ω [rad/s] in its own axes.
        local: (3,) the pose as odometry has it.
        frame: (3,) odometry's frame in the global one.
    """

    stamp: float
    pose: Array
    twist: Array
    local: Array
    frame: Array


class Localization:
    """Takes odometry and what places it, and says what is wrong with them.

    Args:
        settings: the node's parameters.

    Attributes:
        newest: where the robot was last; None where nobody knows. Other threads may read it.
    """

    def __init__(self, settings: Settings):
        self._settings = settings
        self._odometry = Watch("odometry", settings.odom_timeout, settings.transform_tolerance)
        self._pose = Watch("pose", 0.0, settings.transform_tolerance)
        self.newest: Located | None = None
        self._local: deque[Odometry] = deque(maxlen=1024)
        self._track: deque[Odometry] = deque(maxlen=1024)  # of these, what is believed
        self._needs_pose = settings.pose_source != "odom"
        self._correction: Array | None = None if self._needs_pose else np.zeros(3)
        self._corrected = self._needed = -math.inf  # stamps of tf's: the newest, and what is old
        self._jump: tuple[float, Fault] | None = None  # until when it settles [steady s]
        self._still, self._still_path, self._seen_still = np.full(2, np.inf), 0.0, -math.inf

    def at(self, stamp: float) -> Array | None:
        """Return (3,) where odometry had the robot at a stamp [s]; None where nobody knows."""
        return _at(self._track.copy(), stamp)

    def path(self, stamp: float, seconds: float) -> Array:
        """Return (`KNOTS`, 3) where odometry had the robot within so many seconds of a stamp [s].

        Raises:
            InvalidInputError: if it does not say so.
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
        """Take the odometry; return whether it, or the pose, has jumped.

        Args:
            pose: (3,) x, y [m] and yaw [rad] in its own frame.
            twist: (3,) v_x, v_y [m/s] and ω [rad/s] in the robot's axes.
            stamp: of the message [s].
            now: the present.
            frame: of the pose; "" for odometry's.
            child: of the twist; "" for the robot's.
        """
        place, motion = (_plausible(given) for given in (pose, twist))
        watch, settings = self._odometry, self._settings
        if child and child != settings.base_frame_id:
            watch.refuse(f"child frame {child!r}, expected {settings.base_frame_id!r}")
        elif place is None or motion is None:
            watch.refuse(f"got {shown([pose, twist])}, {EXPECTED}")
        elif watch.hear(stamp, now, frame, settings.odom_frame_id):
            newest = Odometry(stamp, place, motion)
            leaps = bool(self._local) and self._leaps(newest)
            if leaps:  # nothing ties it to the poses of before
                self._local.clear()
                self._track.clear()
                self._needed = max(stamp, self._corrected)
                if self._needs_pose:
                    self._correction = None
                    self._pose.refuse(JUMPED)
            self._local.append(newest)
            self._look_still(newest)
            placing = self._correction
            if placing is not None:
                there = placed(placing, place)
                return self._follow(Located(stamp, there, motion, place, placing), now) or leaps
            return leaps
        return False

    def hear_pose(self, pose: ArrayLike, stamp: float, now: Now, frame: str) -> None:
        """Take where the robot was in the global frame: odometry goes on from there."""
        given = _plausible(pose)
        if given is None:
            self._pose.refuse(f"got {shown(pose)}, {EXPECTED}")
        elif self._pose.hear(stamp, now, frame, self._settings.global_frame_id):
            local = _at(self._local, stamp)
            if local is not None:
                self._correction = _between(local, given)
            elif self._correction is None:  # else the one before is as good as it was
                self._pose.refuse("there is no odometry of that time")

    def hear_correction(self, correction: ArrayLike | None, stamp: float) -> None:
        """Take the odometry's frame in the global one as tf has it.

        Args:
            correction: (3,) x, y [m] and yaw [rad]; None where tf has none.
            stamp: of it; 0 of one that never changes [s].
        """
        given = _plausible(correction)
        if correction is not None and given is None:
            says = f"got {shown(correction)} of tf, {EXPECTED}"
        elif given is not None and stamp > 0.0 and stamp <= self._needed:
            given, says = None, JUMPED
        else:
            says = "tf has no transform to the odometry's frame"
            self._corrected = max(self._corrected, stamp)
        self._correction = given
        if given is not None:
            self._pose.stand()
        else:
            self._pose.refuse(says)

    def faults(self, now: Now) -> list[Fault | None]:
        """Return what is wrong now."""
        if self._jump is not None and now.steady >= self._jump[0]:
            self._jump = None
        return [
            self._odometry.fault(now),
            self._pose.fault(now) if self._needs_pose else None,
            self._frozen(),
            self._jump[1] if self._jump is not None else None,
        ]

    def forget(self) -> None:
        """Begin anew: the clock has gone back, and no stamp from before means anything."""
        for watch in (self._odometry, self._pose):
            watch.forget()
        if self._needs_pose:
            self._correction = None
        self.newest, self._corrected, self._needed = None, -math.inf, -math.inf
        self._track.clear()
        self._local.clear()
        self._still = np.full(2, np.inf)

    def _follow(self, newest: Located, now: Now) -> bool:
        """Remember a pose; if it has jumped, forget the others and return True."""
        jumped, before = False, self.newest
        if before is not None:
            away, turned = _off(before, newest, self._settings.odom_timeout)
            jumped = away > self._settings.pose_jump or turned > TURN_JUMP
            if jumped:
                says = f"the pose has jumped by {away:.2f} m and {turned:.2f} rad"
                self._jump = now.steady + self._settings.settle_time, Fault("odometry", says)
                self._track.clear()
        self.newest = newest
        self._track.append(Odometry(newest.stamp, newest.local, newest.twist))
        while newest.stamp - self._track[0].stamp > REMEMBERED:
            self._track.popleft()
        return jumped

    def _leaps(self, newest: Odometry) -> bool:
        """Return whether odometry itself has jumped, however long it was silent before."""
        away, turned = _off(self._local[-1], newest, self._settings.odom_timeout)
        return away > self._settings.pose_jump or turned > TURN_JUMP

    def _look_still(self, newest: Odometry) -> None:
        """Note how far the twist would have moved the robot while odometry's pose stands."""
        if np.abs(newest.pose[:2] - self._still).max() > FROZEN_WITHIN:
            self._still, self._still_path = newest.pose[:2], 0.0
        else:
            seconds = min(newest.stamp - self._seen_still, 1.0)
            made = seconds * float(np.hypot(*newest.twist[:2]))
            self._still_path += made - seconds * self._still_path
        self._seen_still = newest.stamp

    def _frozen(self) -> Fault | None:
        """Return a fault where the pose stands although the twist says that the robot moves."""
        if self._still_path < FROZEN_PATH:
            return None
        return Fault("odometry", f"the pose stands while the twist makes {self._still_path:.2f} m")


def _plausible(given: object) -> Array | None:
    """Return (3,) what was given; None where it is not three numbers, or farther than anything."""
    numbers = real_numbers(given, (3,))
    return None if numbers is None or np.abs(numbers).max() > FARTHEST else numbers


def _between(local: Array, pose: Array) -> Array:
    """Return the frame in which `local` is the pose `pose`."""
    yaw = pose[2] - local[2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y = local[:2]
    return np.array([pose[0] - cos * x + sin * y, pose[1] - sin * x - cos * y, yaw])


def _advanced(one: Odometry | Located, stamp: float, twist: Array) -> Array:
    """Return (3,) where the mean of two twists brings a pose until a stamp [s]."""
    seconds, motion = stamp - one.stamp, 0.5 * (one.twist + twist)
    middle = np.array([*one.pose[:2], one.pose[2] + 0.5 * seconds * motion[2]])
    moved = placed(middle, np.array([*(seconds * motion[:2]), 0.0]))
    return np.array([*moved[:2], one.pose[2] + seconds * motion[2]])


def _off(
    before: Odometry | Located, newest: Odometry | Located, timeout: float
) -> tuple[float, float]:
    """Return by how much a pose is off what the twists make of the one before [m, rad].

    A robot of which nothing was heard for longer than the time-out [s] was told zero: it may be
    anywhere on the way to there.
    """
    made = _advanced(before, newest.stamp, newest.twist) - before.pose
    moved, way, least = newest.pose - before.pose, made[:2], 1.0
    low = high = made[2]
    if newest.stamp - before.stamp > timeout:
        least, low, high = 0.0, min(0.0, made[2]), max(0.0, made[2])
    share = np.clip(moved[:2] @ way / max(way @ way, 1e-12), least, 1.0)
    turns = math.remainder(moved[2], math.tau) + math.tau * np.arange(-1, 2)
    away = float(np.hypot(*(moved[:2] - share * way)))
    return away, float(np.abs(turns - np.clip(turns, low, high)).min())


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
