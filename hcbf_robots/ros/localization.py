"""The robot's pose in the global frame, by odometry that a pose topic or tf corrects."""

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
from hcbf_robots.ros.odometry import FrozenPose, Odometry, advanced, pose_at
from hcbf_robots.ros.settings import Settings
from hcbf_robots.ros.watches import Fault, Now, Watch

EXPECTED = f"expected three finite numbers of at most {FARTHEST:g}, and a quaternion of the norm 1"
KNOTS = 9
"""Poses along the sweep of a scan; between them the robot moves straight."""
REMEMBERED = 3.0
"""How long poses are kept, to place scans [s]."""
TURN_JUMP = 0.5
"""By which a yaw may differ from the integrated twist [rad]."""
JUMPED = "odometry has jumped, expected a pose of after that"


class Located(NamedTuple):
    """An `Odometry` whose pose is in the global frame, with the two poses of which it is made."""

    stamp: float
    pose: Array
    twist: Array
    local: Array  # (3,) the robot's pose in odometry's frame
    frame: Array  # (3,) the pose of odometry's frame in the global one


class Localization:
    """Locates the robot in the global frame by odometry and its correction; reports their faults.

    The correction is the pose of odometry's frame in the global one. It follows from a pose topic
    or tf, and is the identity where odometry is used alone (`pose_source`).

    Args:
        settings: the node's parameters.

    Attributes:
        newest: the robot's latest pose; None where it is unknown. Other threads may read it.
    """

    def __init__(self, settings: Settings):
        self._settings = settings
        tolerance = settings.transform_tolerance
        self._odometry_watch = Watch("odometry", settings.odom_timeout, tolerance)
        self._pose_watch = Watch("pose", 0.0, tolerance)
        self._is_corrected = settings.pose_source != "odom"
        self._initial_correction = None if self._is_corrected else np.zeros(3)
        self._correction: Array | None = self._initial_correction
        self._newest_correction = -math.inf  # stamp of tf's [s]
        self._last_outdated = -math.inf  # tf's corrections up to this stamp are of before a jump
        self._odometry: deque[Odometry] = deque(maxlen=1024)  # since its latest jump
        self._track: deque[Odometry] = deque(maxlen=1024)  # the part of it that was located
        self._frozen = FrozenPose()
        self._jump: tuple[float, Fault] | None = None  # and until when the robot rests [steady s]
        self.newest: Located | None = None

    def forget(self) -> None:
        """Drop stamped values, as the node's clock has gone back; `_jump` is on the steady one."""
        self._odometry_watch.forget()
        self._pose_watch.forget()
        self._correction = self._initial_correction
        self._newest_correction = self._last_outdated = -math.inf
        self._odometry.clear()
        self._track.clear()
        self._frozen = FrozenPose()
        self.newest = None

    def at(self, stamp: float) -> Array | None:
        """Return (3,) the robot's pose by odometry at a stamp [s]; None where it is unknown."""
        return pose_at(self._track.copy(), stamp)

    def path(self, stamp: float, seconds: float) -> Array:
        """Return (`KNOTS`, 3) the robot's poses by odometry within some seconds of a stamp [s].

        Raises:
            InvalidInputError: if one of them is unknown.
        """
        track = self._track.copy()
        poses = [pose_at(track, stamp + after) for after in np.linspace(0.0, seconds, KNOTS)]
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
        """Take a pose (3,) and a twist (3,), see `Odometry`; return whether the robot has jumped.

        `frame` is that of the pose, `child` that of the twist, which "" leaves to be the robot's.
        """
        newest = self._checked(pose, twist, stamp, child)
        watch, expected = self._odometry_watch, self._settings.odom_frame_id
        if newest is None or not watch.hear(stamp, now, frame, expected):
            return False
        previous = self._odometry[-1] if self._odometry else None
        has_jumped = previous is not None and self._jump_between(previous, newest) is not None
        if has_jumped:
            self._begin_anew_at(stamp)
        self._odometry.append(newest)
        self._frozen.update(newest)
        if self._correction is None:
            return has_jumped
        in_global = placed(self._correction, newest.pose)
        located = Located(stamp, in_global, newest.twist, newest.pose, self._correction)
        return self._follow(located, now) or has_jumped

    def hear_pose(self, pose: ArrayLike, stamp: float, now: Now, frame: str) -> None:
        """Take the robot's pose (3,) in the global frame, from which the correction follows."""
        given = _plausible(pose)
        if given is None:
            self._pose_watch.refuse(f"got {shown(pose)}, {EXPECTED}")
        elif self._pose_watch.hear(stamp, now, frame, self._settings.global_frame_id):
            local = pose_at(self._odometry, stamp)
            if local is not None:
                self._correction = _frame_between(local, given)
            elif self._correction is None:  # an earlier correction remains valid
                self._pose_watch.refuse("there is no odometry of that time")

    def hear_correction(self, correction: ArrayLike | None, stamp: float) -> None:
        """Take tf's pose (3,) of odometry's frame in the global one; None where tf has none.

        The stamp [s] of a correction that never changes is 0.
        """
        given = _plausible(correction)
        if correction is not None and given is None:
            wrong = f"got {shown(correction)} of tf, {EXPECTED}"
        elif given is not None and stamp > 0.0 and stamp <= self._last_outdated:
            given, wrong = None, JUMPED
        else:
            wrong = "tf has no transform to the odometry's frame"
            self._newest_correction = max(self._newest_correction, stamp)
        self._correction = given
        if given is not None:
            self._pose_watch.set_known()
        else:
            self._pose_watch.refuse(wrong)

    def faults(self, now: Now) -> list[Fault | None]:
        """Return the present faults, None in place of one that there is not."""
        if self._jump is not None and now.steady >= self._jump[0]:
            self._jump = None
        return [
            self._odometry_watch.fault(now),
            self._pose_watch.fault(now) if self._is_corrected else None,
            self._frozen.fault(),
            self._jump[1] if self._jump is not None else None,
        ]

    def _checked(self, pose: object, twist: object, stamp: float, child: str) -> Odometry | None:
        """Return odometry of plausible numbers in the robot's axes; None, and a fault, of other."""
        position, velocity = _plausible(pose), _plausible(twist)
        expected = self._settings.base_frame_id
        if child and child != expected:
            self._odometry_watch.refuse(f"child frame {child!r}, expected {expected!r}")
        elif position is None or velocity is None:
            self._odometry_watch.refuse(f"got {shown([pose, twist])}, {EXPECTED}")
        else:
            return Odometry(stamp, position, velocity)
        return None

    def _begin_anew_at(self, stamp: float) -> None:
        """Drop what is of before a jump of odometry [s]: its poses and corrections."""
        self._odometry.clear()
        self._track.clear()
        self._last_outdated = max(stamp, self._newest_correction)
        self._correction = self._initial_correction
        if self._is_corrected:
            self._pose_watch.refuse(JUMPED)

    def _follow(self, newest: Located, now: Now) -> bool:
        """Append a pose to the track; return whether the pose or its correction has jumped."""
        jump = None
        if self.newest is not None:
            jump = self._jump_between(Odometry(*self.newest[:3]), Odometry(*newest[:3]))
        if jump is not None:
            message = f"the pose has jumped by {jump[0]:.2f} m and {jump[1]:.2f} rad"
            self._jump = now.steady + self._settings.settle_time, Fault("odometry", message)
            self._track.clear()
        self.newest = newest
        self._track.append(Odometry(newest.stamp, newest.local, newest.twist))
        while newest.stamp - self._track[0].stamp > REMEMBERED:
            self._track.popleft()
        return jump is not None

    def _jump_between(self, previous: Odometry, newest: Odometry) -> tuple[float, float] | None:
        """Return how far a pose is from the integrated twists [m, rad], None within tolerance.

        The distance is ‖Δp − s Δp_twist‖ with s = 1. After a gap longer than the time-out, within
        which the robot was commanded zero, it may be anywhere on its path: 0 ≤ s ≤ 1 is free then,
        and so is the part of the turn.
        """
        predicted = advanced(previous, newest.stamp, newest.twist) - previous.pose
        moved, step, turn = newest.pose - previous.pose, predicted[:2], predicted[2]
        s_min, turn_min, turn_max = 1.0, turn, turn
        if newest.stamp - previous.stamp > self._settings.odom_timeout:
            s_min, turn_min, turn_max = 0.0, min(0.0, turn), max(0.0, turn)
        s = np.clip(moved[:2] @ step / max(step @ step, 1e-12), s_min, 1.0)
        distance = float(np.hypot(*(moved[:2] - s * step)))
        # a yaw is known up to full turns: the nearest to the prediction counts
        turns = math.remainder(moved[2], math.tau) + math.tau * np.arange(-1, 2)
        angle = float(np.abs(turns - np.clip(turns, turn_min, turn_max)).min())
        has_jumped = distance > self._settings.pose_jump or angle > TURN_JUMP
        return (distance, angle) if has_jumped else None


def _plausible(given: object) -> Array | None:
    """Return (3,) the given numbers; None where they are not three, or one is beyond `FARTHEST`."""
    numbers = real_numbers(given, (3,))
    return None if numbers is None or np.abs(numbers).max() > FARTHEST else numbers


def _frame_between(local: Array, pose: Array) -> Array:
    """Return (3,) the frame F for which ``placed(F, local)`` is `pose`."""
    yaw = pose[2] - local[2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y = local[:2]
    return np.array([pose[0] - cos * x + sin * y, pose[1] - sin * x - cos * y, yaw])
