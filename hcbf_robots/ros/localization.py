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
from hcbf_robots.ros.watches import Fault, HeldFault, Now, Watch

EXPECTED = f"expected three finite numbers of at most {FARTHEST:g}, and a quaternion of the norm 1"
SWEEP_POSES = 9
"""Poses along the sweep of a scan; between them the robot moves straight."""
TRACK_LENGTH = 3.0
"""For how long poses are stored, to place scans [s]."""
YAW_JUMP = 0.5
"""Greatest difference between a yaw and the integrated twist [rad]."""
JUMPED = "odometry has jumped, expected a pose of after that"


class Located(NamedTuple):
    """The robot's pose in the global frame at one stamp, and the two poses that give it."""

    stamp: float  # [s]
    pose: Array  # (3,) ``placed(frame, local)``: x, y [m] and yaw [rad] in the global frame
    twist: Array  # (3,) v_x, v_y [m/s] and ω [rad/s] in the robot's axes
    local: Array  # (3,) the robot's pose in odometry's frame [m, rad]
    frame: Array  # (3,) the pose of odometry's frame in the global one [m, rad]


class Localization:
    """Locates the robot in the global frame by odometry and its correction, and finds faults.

    The correction is the pose of odometry's frame in the global one. It follows from a pose topic
    or from tf; with `pose_source` "odom" it is the identity.

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
        self._newest_correction = -math.inf  # the newest stamp of tf [s]
        self._outdated_until = -math.inf  # corrections up to this stamp came before a jump [s]
        self._odometry: deque[Odometry] = deque(maxlen=1024)  # since its latest jump
        self._track: deque[Odometry] = deque(maxlen=1024)  # the part of it with a correction
        self._frozen = FrozenPose()
        self._jump = HeldFault()
        self.newest: Located | None = None

    def forget(self) -> None:
        """Drop all that has a stamp, as the node's clock has gone back; a jump's fault remains."""
        self._odometry_watch.forget()
        self._pose_watch.forget()
        self._correction = self._initial_correction
        self._newest_correction = self._outdated_until = -math.inf
        self._odometry.clear()
        self._track.clear()
        self._frozen = FrozenPose()
        self.newest = None

    def at(self, stamp: float) -> Array | None:
        """Return (3,) the robot's pose by odometry at a stamp [s]; None where it is unknown."""
        return pose_at(self._track.copy(), stamp)

    def path(self, stamp: float, seconds: float) -> Array:
        """Return (`SWEEP_POSES`, 3) poses by odometry at equal times, from a stamp [s] on.

        `seconds` is the time from the first to the last.

        Raises:
            InvalidInputError: if one of them is unknown.
        """
        track, delays = self._track.copy(), np.linspace(0.0, seconds, SWEEP_POSES)
        poses = [pose_at(track, stamp + delay) for delay in delays]
        known = [pose for pose in poses if pose is not None]
        if len(known) < len(poses):
            raise InvalidInputError(
                f"time_increment: got beams within {seconds:g} s of the stamp, expected odometry "
                "of that time"
            )
        return np.array(known)

    def hear_odometry(
        self, pose: ArrayLike, twist: ArrayLike, stamp: float, now: Now, frame: str, child: str
    ) -> bool:
        """Take pose (3,) and twist (3,) as in `Odometry`; return whether the robot has jumped.

        `frame` is that of the pose, and `child` that of the twist, or "" for the robot's.
        """
        newest = self._checked_odometry(pose, twist, stamp, child)
        watch, expected = self._odometry_watch, self._settings.odom_frame_id
        if newest is None or not watch.hear(stamp, now, frame, expected):
            return False
        has_jumped = False
        if self._odometry and self._jump_between(self._odometry[-1], newest) is not None:
            has_jumped = True
            self._drop_before_jump(stamp)
        self._odometry.append(newest)
        self._frozen.update(newest)
        if self._correction is None:
            return has_jumped
        global_pose = placed(self._correction, newest.pose)
        located = Located(stamp, global_pose, newest.twist, newest.pose, self._correction)
        return self._append(located, now) or has_jumped

    def hear_pose(self, pose: ArrayLike, stamp: float, now: Now, frame: str) -> None:
        """Take the robot's pose (3,) in the global frame, from which the correction follows."""
        global_pose = _plausible(pose)
        if global_pose is None:
            self._pose_watch.refuse(f"got {shown(pose)}, {EXPECTED}")
        elif self._pose_watch.hear(stamp, now, frame, self._settings.global_frame_id):
            local = pose_at(self._odometry, stamp)
            if local is not None:
                self._correction = _frame_between(local, global_pose)
            elif self._correction is None:  # an earlier correction remains valid
                self._pose_watch.refuse("there is no odometry of that time")

    def hear_correction(self, correction: ArrayLike | None, stamp: float) -> None:
        """Take tf's pose (3,) of odometry's frame in the global one; None if tf has none.

        The stamp [s] of a correction that never changes is 0.
        """
        accepted, refusal = _plausible(correction), ""
        if correction is not None and accepted is None:
            refusal = f"got {shown(correction)} of tf, {EXPECTED}"
        elif accepted is not None and 0.0 < stamp <= self._outdated_until:
            accepted, refusal = None, JUMPED
        else:
            self._newest_correction = max(self._newest_correction, stamp)
        self._correction = accepted
        if accepted is not None:
            self._pose_watch.set_known()
        else:
            self._pose_watch.refuse(refusal or "tf has no transform to the odometry's frame")

    def faults(self, now: Now) -> list[Fault | None]:
        """Return the present faults, the gravest first; None in the place of an absent one."""
        return [
            self._odometry_watch.fault(now),
            self._pose_watch.fault(now) if self._is_corrected else None,
            self._frozen.fault(),
            self._jump.at(now),
        ]

    def _checked_odometry(
        self, pose: object, twist: object, stamp: float, child: str
    ) -> Odometry | None:
        """Return the odometry of a message; refuse numbers that are not plausible, with None."""
        position, velocity = _plausible(pose), _plausible(twist)
        expected = self._settings.base_frame_id
        if child and child != expected:
            self._odometry_watch.refuse(f"child frame {child!r}, expected {expected!r}")
        elif position is None or velocity is None:
            self._odometry_watch.refuse(f"got {shown([pose, twist])}, {EXPECTED}")
        else:
            return Odometry(stamp, position, velocity)
        return None

    def _drop_before_jump(self, stamp: float) -> None:
        """Drop poses and corrections from before a jump of odometry at a stamp [s]."""
        self._odometry.clear()
        self._track.clear()
        self._outdated_until = max(stamp, self._newest_correction)
        self._correction = self._initial_correction
        if self._is_corrected:
            self._pose_watch.refuse(JUMPED)

    def _append(self, newest: Located, now: Now) -> bool:
        """Append a pose to the track; return whether it has jumped in the global frame."""
        jump = None
        if self.newest is not None:
            jump = self._jump_between(Odometry(*self.newest[:3]), Odometry(*newest[:3]))
        if jump is not None:
            message = f"the pose has jumped by {jump[0]:.2f} m and {jump[1]:.2f} rad"
            until = now.steady + self._settings.settle_time
            self._jump = HeldFault(Fault("odometry", message), until)
            self._track.clear()
        self.newest = newest
        self._track.append(Odometry(newest.stamp, newest.local, newest.twist))
        while newest.stamp - self._track[0].stamp > TRACK_LENGTH:
            self._track.popleft()
        return jump is not None

    def _jump_between(self, previous: Odometry, newest: Odometry) -> tuple[float, float] | None:
        """Return how far a pose is from the integrated twists [m, rad]; None within tolerance.

        The distance is ‖Δp − s Δp_twist‖ with s = 1. During a gap longer than the time-out the
        robot was commanded zero, and may have stopped anywhere on its path. So the share s of the
        path is then the best one in 0 ≤ s ≤ 1, and the share of the turn is free in the same range.
        """
        predicted = advanced(previous, newest.stamp, newest.twist) - previous.pose
        measured, step, turn = newest.pose - previous.pose, predicted[:2], predicted[2]
        share_min, turn_min, turn_max = 1.0, turn, turn
        if newest.stamp - previous.stamp > self._settings.odom_timeout:
            share_min, turn_min, turn_max = 0.0, min(0.0, turn), max(0.0, turn)
        share = np.clip(measured[:2] @ step / max(step @ step, 1e-12), share_min, 1.0)
        distance = float(np.hypot(*(measured[:2] - share * step)))
        # a yaw is known up to full turns: the nearest to the prediction counts
        turns = math.remainder(measured[2], math.tau) + math.tau * np.arange(-1, 2)
        angle = float(np.abs(turns - np.clip(turns, turn_min, turn_max)).min())
        has_jumped = distance > self._settings.pose_jump or angle > YAW_JUMP
        return (distance, angle) if has_jumped else None


def _plausible(values: object) -> Array | None:
    """Return values as (3,) numbers; None if they are not three, or one is beyond `FARTHEST`."""
    numbers = real_numbers(values, (3,))
    return None if numbers is None or np.abs(numbers).max() > FARTHEST else numbers


def _frame_between(local: Array, pose: Array) -> Array:
    """Return (3,) the frame F for which ``placed(F, local)`` is `pose`."""
    yaw = pose[2] - local[2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y = local[:2]
    return np.array([pose[0] - cos * x + sin * y, pose[1] - sin * x - cos * y, yaw])
