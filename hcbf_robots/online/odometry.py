"""A robot's odometry: the newest of it, brought to the present, and compared with what was told."""

import math

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.shape import TINY
from hcbf_gym.models.clocks import AHEAD, ROUNDING
from hcbf_gym.models.plant import Reason
from hcbf_robots.online.follower import Follower
from hcbf_robots.online.motion_monitor import MotionMonitor
from hcbf_robots.online.robot import Robot
from hcbf_robots.online.sample import Sample, moved
from hcbf_robots.walkers.response_monitor import ResponseMonitor

CARRIED_FOR = 5.0
"""A twist tells as much of older data as what the robot was told since [s]."""


class Odometry:
    """What a robot measures, and what that says of it.

    Args:
        robot: what it is told, and how it follows.
        follower: the point that follows.
        strays: the greatest acceleration of that point [m/s²].
        period: for which a command is good [s].

    Attributes:
        fault: the alarm that was raised, until `forget`.
        told: the command that the robot has.
    """

    def __init__(self, robot: Robot, follower: Follower, strays: float, period: float):
        self._follower, self._strays, self._period = follower, strays, period
        self._response = ResponseMonitor(robot.command, robot.response)
        self._motion = MotionMonitor(period, strays)
        self.forget()

    def forget(self) -> None:
        """Know nothing."""
        self.told: Array = np.zeros(len(self._follower.limits))
        self.fault = Reason.NONE
        self._newest, self._stamp = Sample(), -math.inf
        self._missed_by = 0.0  # what position may be off by its age, at most so far [m]
        self.compare_anew()

    def compare_anew(self) -> None:
        """Forget what was compared: time has gone back."""
        self._response.forget()
        self._motion.forget()

    def go_on_from(self, other: "Odometry") -> None:
        """Take over what is known; the other is not to be used on."""
        self.told, self.fault = other.told, other.fault
        self._newest, self._stamp = other._newest, other._stamp
        self._missed_by = other._missed_by
        self._response, self._motion = other._response, other._motion

    def newest(self, given: Sample, now: float) -> Sample:
        """Return the newest data that were not from the future: what was given, or what was kept.

        What is ahead by no more than `clocks.AHEAD` is of now.

        Args:
            given: with this call.
            now: the present [s].
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
        """Raise an alarm where what was measured is not what the robot was told.

        Args:
            sample: in a frame in which the pose goes on smoothly.
        """
        measured = self._follower.measured(sample.place, sample.motion)
        drifts = self._motion.observe(measured, sample.stamp)
        at = np.array([*self._motion.place, sample.place[2]])
        strays = self._response.observe(at, measured[2:], sample.stamp, self._motion.noise)
        if self.fault == Reason.NONE and (strays or drifts):
            self.fault = Reason.RESPONSE if strays else Reason.MOTION

    def tell(self, told: Array, now: float) -> None:
        """Note what the robot is told from now on [s], where the clocks say when that is."""
        self.told = told
        if math.isfinite(now):
            self._response.tell(told, now, now + self._period)

    def carried(self, place: Array, motion: Array, since: float, now: float) -> tuple[Array, Array]:
        """Return pose and twist now of a robot that was measured before; note what they may miss.

        Its twist says it, up to what the robot accelerates meanwhile; of a robot that was measured
        what it was told since says more.

        Args:
            place: (3,) pose then [m, rad].
            motion: (3,) twist then [m/s, rad/s].
            since: the time of both [s].
            now: the present [s].
        """
        straight = moved(place, motion, now - since)
        missed_by = 0.5 * self._strays * (now - since) ** 2
        if not self._response.is_measured or now - since > CARRIED_FOR:
            self._missed_by = max(self._missed_by, missed_by)
            return straight, motion
        place, motion = place.copy(), motion.copy()
        off = self._response.carry(place, motion, since, now)
        measured = self._follower.measured
        apart = (measured(place, motion) - measured(straight, motion))[:2]
        self._missed_by = max(self._missed_by, min(off, missed_by + float(np.hypot(*apart))))
        return place, motion

    def covariance(self, confidence: float) -> Array | None:
        """Return (4, 4) by which rows reserve what position may be off by its age; None is 0.

        Args:
            confidence: standard deviations that are reserved.
        """
        if self._missed_by == 0.0:
            return None
        deviation = self._missed_by / max(confidence, TINY)
        return np.diag([deviation**2, deviation**2, 0.0, 0.0])
