"""A robot's odometry: its newest sample, propagated to the present and compared with commands."""

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
"""Age up to which commands propagate a sample [s]; an older one is propagated by its twist."""


class Odometry:
    """A robot's newest sample and its last command.

    Args:
        robot: its commands and response.
        follower: the model that the robot follows.
        max_acceleration: the greatest one of the model's point [m/s²].
        period: the time for which a command is valid [s].

    Attributes:
        fault: the alarm that was raised since the last `forget`; `Reason.NONE` without one.
        command: (k,) the robot's present command [m/s, rad/s].
    """

    def __init__(self, robot: Robot, follower: Follower, max_acceleration: float, period: float):
        self._follower, self._max_acceleration, self._period = follower, max_acceleration, period
        self._monitor = MotionMonitor(robot.command, robot.response, 1.0, period, max_acceleration)
        self.forget()

    def forget(self) -> None:
        """Return to the state before the first sample."""
        self.command: Array = np.zeros(len(self._follower.limits))
        self.fault = Reason.NONE
        self._newest, self._stamp = Sample(), -math.inf
        self._age_error = 0.0  # greatest position error so far by the age of a sample [m]
        self.restart_monitor()

    def restart_monitor(self) -> None:
        """Compare later samples only, as the clock has gone back."""
        self._monitor.reset()

    def go_on_from(self, other: "Odometry") -> None:
        """Take the state of another one, which must not be used any more."""
        self.command, self.fault = other.command, other.fault
        self._newest, self._stamp = other._newest, other._stamp
        self._age_error = other._age_error
        self._monitor = other._monitor

    def newest(self, given: Sample, now: float) -> Sample:
        """Return the newest sample up to the present [s]: the given one, or an earlier one.

        A sample that is ahead by at most `clocks.AHEAD` counts as one of the present.
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
        """Set `fault` where a sample is not as predicted; its frame must have smooth poses."""
        state = self._follower.measured_state(sample.pose, sample.twist)
        pose = np.array([state[0], state[1], sample.pose[2]])
        reason = self._monitor.observe(pose, state[2:], sample.stamp)
        self.fault = self.fault or reason

    def note_command(self, command: Array, now: float) -> None:
        """Note the robot's command from the present on [s], which may be unknown (NaN)."""
        self.command = command
        if math.isfinite(now):
            self._monitor.command(command, now, now + self._period)

    def propagated(
        self, pose: Array, twist: Array, since: float, now: float
    ) -> tuple[Array, Array]:
        """Return the present pose and twist by an older sample; note the error of its age.

        The twist propagates the pose, with an error of ``½ a (now − since)²`` by the greatest
        acceleration a. If the robot's response was measured, its commands are more exact.

        Args:
            pose: (3,) then [m, rad].
            twist: (3,) then [m/s, rad/s].
            since: the time of both [s].
            now: the present [s].
        """
        by_twist = moved(pose, twist, now - since)
        error_by_twist = 0.5 * self._max_acceleration * (now - since) ** 2
        if not self._monitor.is_measured or now - since > PROPAGATED_FOR:
            self._age_error = max(self._age_error, error_by_twist)
            return by_twist, twist
        pose, twist, error_by_commands = self._monitor.propagate(pose, twist, since, now)
        state_of = self._follower.measured_state
        distance = float(np.hypot(*(state_of(pose, twist) - state_of(by_twist, twist))[:2]))
        # by the triangle inequality, the second term bounds the error of this pose, too
        self._age_error = max(self._age_error, min(error_by_commands, error_by_twist + distance))
        return pose, twist

    def covariance(self, reserved: Uncertainty) -> Array | None:
        """Return (4, 4) the covariance for which rows reserve the error by age; None without error.

        The position error is divided by the margin that rows reserve for a deviation of 1 m.
        """
        if self._age_error == 0.0:
            return None
        margin_per_metre = margin_of_deviation(np.array(reserved), 1.0)
        deviation = self._age_error / max(margin_per_metre, TINY)
        return np.diag([deviation**2, deviation**2, 0.0, 0.0])
