"""A robot's odometry: the newest sample, brought to the present, and compared with commands."""

import math

import numpy as np

from hcbf_gym._core import Reason, margin_of_deviation
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.shape import TINY
from hcbf_gym.models import Uncertainty
from hcbf_gym.models.clocks import AHEAD, ROUNDING
from hcbf_robots.online.follower import Follower
from hcbf_robots.online.robot import Robot
from hcbf_robots.online.sample import Sample, moved
from hcbf_robots.walkers.motion_monitor import MotionMonitor

PROPAGATED_FOR = 5.0
"""Older data are propagated by their twist: earlier commands say no more [s]."""


class Odometry:
    """A robot's measurements, and its last command.

    Args:
        robot: its commands and response.
        follower: the point that follows.
        strays: the greatest acceleration of that point [m/s²].
        period: for which a command is good [s].

    Attributes:
        fault: the alarm that was raised, until `forget`.
        command: that the robot has.
    """

    def __init__(self, robot: Robot, follower: Follower, strays: float, period: float):
        self._follower, self._strays, self._period = follower, strays, period
        self._monitor = MotionMonitor(robot.command, robot.response, 1.0, period, strays)
        self.forget()

    def forget(self) -> None:
        """Begin without any sample."""
        self.command: Array = np.zeros(len(self._follower.limits))
        self.fault = Reason.NONE
        self._newest, self._stamp = Sample(), -math.inf
        self._missed_by = 0.0  # position error by its age, at most so far [m]
        self.compare_anew()

    def compare_anew(self) -> None:
        """Forget what was compared: time has gone back."""
        self._monitor.reset()

    def go_on_from(self, other: "Odometry") -> None:
        """Take the state of another; the other is not to be used on."""
        self.command, self.fault = other.command, other.fault
        self._newest, self._stamp = other._newest, other._stamp
        self._missed_by = other._missed_by
        self._monitor = other._monitor

    def newest(self, given: Sample, now: float) -> Sample:
        """Return the newest sample that is not of the future: the given one, or an earlier one.

        One that is ahead by no more than `clocks.AHEAD` is of now [s].
        """
        latest = now + AHEAD + ROUNDING
        if not given.is_sound or not given.stamp <= latest:
            return given
        if given.stamp > self._stamp or self._stamp > latest:
            self._newest, self._stamp = given, given.stamp
            if given.stamp > now:
                self._newest = given._replace(stamp=now)
        return self._newest

    def watch(self, sample: Sample) -> None:
        """Raise an alarm where motion is not as predicted, in a frame of smooth poses."""
        measured = self._follower.measured(sample.place, sample.motion)
        pose = np.array([measured[0], measured[1], sample.place[2]])
        reason = self._monitor.observe(pose, measured[2:], sample.stamp)
        self.fault = self.fault or reason

    def note_command(self, command: Array, now: float) -> None:
        """Note the robot's command from now on [s], where the clocks give that time."""
        self.command = command
        if math.isfinite(now):
            self._monitor.command(command, now, now + self._period)

    def propagated(
        self, place: Array, motion: Array, since: float, now: float
    ) -> tuple[Array, Array]:
        """Return pose and twist now of an older sample; note by how much they may be off.

        The twist propagates it, up to the acceleration meanwhile. Of a robot with a measured
        response the commands since then are more exact.

        Args:
            place: (3,) pose then [m, rad].
            motion: (3,) twist then [m/s, rad/s].
            since: the time of both [s].
            now: the present [s].
        """
        straight = moved(place, motion, now - since)
        missed_by = 0.5 * self._strays * (now - since) ** 2
        if not self._monitor.is_measured or now - since > PROPAGATED_FOR:
            self._missed_by = max(self._missed_by, missed_by)
            return straight, motion
        place, motion = place.copy(), motion.copy()
        off = self._monitor.propagate(place, motion, since, now)
        measured = self._follower.measured
        apart = (measured(place, motion) - measured(straight, motion))[:2]
        self._missed_by = max(self._missed_by, min(off, missed_by + float(np.hypot(*apart))))
        return place, motion

    def covariance(self, reserved: Uncertainty) -> Array | None:
        """Return (4, 4) by which rows reserve the position error by age; None is 0.

        The position error is divided by what rows reserve for a deviation of 1 m.
        """
        if self._missed_by == 0.0:
            return None
        each = margin_of_deviation(np.array(reserved), 1.0)
        deviation = self._missed_by / max(each, TINY)
        return np.diag([deviation**2, deviation**2, 0.0, 0.0])
