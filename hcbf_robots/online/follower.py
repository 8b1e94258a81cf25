"""The point that follows commands: its model between two of them, and the next command."""

import math

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.shape import TINY
from hcbf_gym.models.axle import Axle
from hcbf_robots.online.robot import Robot
from hcbf_robots.walkers.walker_adapter import Adapter

PAUSE = 1.5
"""Periods without an input after which the model begins anew, unless the robot follows slower."""


class Follower:
    """The reduced-order model of a robot that takes velocities, from one command to the next.

    The model retains its velocity in the world's axes. That of a cart is the point before its axle
    and retains it in the cart's own, as the command turns with it (`models.axle`).

    Args:
        robot: its commands and response.
        axle: what limits a differential drive; None for all others.
        follows: τ + δ, after which no earlier command is under way [s].
        able: the greatest acceleration that U has in every direction [m/s²].
        period: T, for which an input is held at most [s].

    Attributes:
        limits: of a command [m/s, rad/s].
        fastest: the greatest commanded speed [m/s].
        begins_at: the greatest speed with which the model begins [m/s].
        velocity: (2,) of the model when it was last known, in its axes [m/s].
    """

    def __init__(self, robot: Robot, axle: Axle | None, follows: float, able: float, period: float):
        self.limits: Array = robot.command.limits
        self.fastest = self.begins_at = robot.command.fastest
        self._adapter = Adapter(robot.command, robot.response, able, period, "free")
        self._axle, self._follows, self._able, self._period = axle, follows, able, period
        self.forget()

    def forget(self) -> None:
        """Begin without any command."""
        self.velocity: Array = np.zeros(2)
        self._input: Array = np.zeros(2)
        self._frame_yaw = 0.0  # of the pose's frame in the barriers' [rad]
        self.pause()

    def pause(self) -> None:
        """Let the model begin with the velocity that is measured next."""
        self._moved = -math.inf  # when the model's velocity was last known [s]
        self._adapter.rest()

    def go_on_from(self, other: "Follower") -> None:
        """Take the state of another model of the same robot."""
        self.velocity, self._input, self._moved = other.velocity, other._input, other._moved
        self._frame_yaw = other._frame_yaw
        self._adapter.rest(other._adapter.turns)

    def turn(self, yaw: float) -> None:
        """Let the model's velocity turn with the pose's frame, which has this yaw [rad]."""
        turned, self._frame_yaw = math.remainder(yaw - self._frame_yaw, math.tau), yaw
        if turned != 0.0 and self._axle is None:
            turn = _rotation(turned)
            self.velocity, self._input = turn @ self.velocity, turn @ self._input

    def measured(self, place: Array, motion: Array) -> Array:
        """Return (4,) position and velocity in the world of the point that follows commands.

        Args:
            place: (3,) pose of the robot's centre [m, rad].
            motion: (3,) its twist, in the robot's axes [m/s, rad/s].
        """
        x, y, yaw = place
        cos, sin = math.cos(yaw), math.sin(yaw)
        ahead = self._adapter.look_ahead
        forward, aside = motion[0], motion[1] + motion[2] * ahead
        return np.array(
            [
                x + ahead * cos,
                y + ahead * sin,
                cos * forward - sin * aside,
                sin * forward + cos * aside,
            ]
        )

    def now(self, velocity: Array, yaw: float, present: float) -> Array:
        """Return (2,) the model's velocity at a present [s], in the world [m/s].

        It follows from the last input. After a pause of more than τ + δ no earlier command is under
        way, and the model begins with the measured velocity (2,).
        """
        axes = self._axes(yaw)
        passed = present - self._moved
        if passed > max(self._follows, PAUSE * self._period):
            now = self._capped(velocity @ axes)
        else:
            now = self.velocity + min(max(passed, 0.0), self._period) * self._input
        return now @ axes.T

    def nominal(self, wanted: Array, yaw: float, now: Array) -> Array:
        """Return u* (2,) that brings the model's velocity (2,) to a command's, within U [m/s²].

        Args:
            wanted: a command [m/s, rad/s].
            yaw: the robot's heading [rad].
            now: (2,) the model's velocity in the world [m/s].
        """
        wanted = np.clip(wanted, -self.limits, self.limits)
        own = wanted if len(wanted) == 3 else wanted * np.array([1.0, self._adapter.look_ahead])
        heading = yaw if math.isfinite(yaw) else 0.0
        if self._axle is not None:
            own[0] = min(max(own[0], -self.fastest), self.fastest)
            axes = self._axes(heading)
            change = (own - now @ axes) / self._period
            most = np.array([self._axle.braking, self._axle.across])
            return axes @ np.clip(change, -most, most)
        cos, sin = math.cos(heading), math.sin(heading)
        velocity = np.array([cos * own[0] - sin * own[1], sin * own[0] + cos * own[1]])
        velocity *= min(1.0, self.fastest / max(float(np.hypot(*velocity)), TINY))
        missing = (velocity - now) / self._period
        size = float(np.hypot(*missing))
        return missing * min(1.0, self._able / size) if size > 0.0 else missing

    def follow(self, velocity: Array, u: Array, yaw: float, present: float) -> None:
        """Note the input (2,) of the world that the model follows from a velocity (2,) on."""
        axes = self._axes(yaw)
        self.velocity, self._input, self._moved = velocity @ axes, u @ axes, present

    def command(self, wanted: Array, yaw: float, rate: float) -> Array:
        """Return the command of the chosen input, in the robot's axes [m/s, rad/s].

        Args:
            wanted: the nominal command.
            yaw: the robot's heading [rad].
            rate: at which it turns [rad/s].
        """
        soon = self.velocity + self._period * self._input
        if self._axle is not None:
            return self._adapter.within(soon / np.array([1.0, self._adapter.look_ahead]))
        self._adapter.turn = float(wanted[-1])
        return np.array(self._adapter.command(soon[0], soon[1], yaw, rate))

    def stop(self) -> Array:
        """Return the command where the state is unknown: zero."""
        self._adapter.rest()
        return np.zeros(len(self.limits))

    def _axes(self, yaw: float) -> Array:
        """Return (2, 2) in columns the axes in which the model retains its velocity."""
        return np.eye(2) if self._axle is None or not math.isfinite(yaw) else _rotation(yaw)

    def _capped(self, velocity: Array) -> Array:
        """Return a measured velocity, shortened to what the cap allows: the model begins there."""
        if self._axle is not None:
            beside = self._adapter.look_ahead * float(self.limits[-1])
            sides = np.array([min(self.begins_at, self._axle.forward), beside])
            return np.clip(velocity, -sides, sides)
        speed = float(np.hypot(*velocity))
        return velocity * min(1.0, self.begins_at / speed) if speed > 0.0 else velocity


def _rotation(yaw: float) -> Array:
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, -sin], [sin, cos]])
