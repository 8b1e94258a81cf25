"""The reduced-order model of a robot between two commands, and the command of its next input."""

import math

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.shape import TINY
from hcbf_gym.models.axle import Axle
from hcbf_robots.online.robot import Robot
from hcbf_robots.walkers.walker_adapter import Adapter

PAUSE = 1.5
"""Periods without an input after which the model restarts, unless the robot responds slower."""


class Follower:
    """The double integrator ``p̈ = u`` that a robot follows, from one command to the next.

    Its position p is the robot's centre, or a point before the axle of a differential drive. Its
    velocity is constant while u = 0, in *model axes*: the world's, or those of a differential
    drive, with which its command turns (`models.axle`).

    Args:
        robot: its commands and response.
        axle: the limits of a differential drive; None for other robots.
        delay: τ + δ, after which no earlier command acts any more [s].
        u_max: the largest acceleration that U contains in every direction [m/s²].
        period: T, the longest time for which an input is held [s].

    Attributes:
        limits: (k,) of a command [m/s, rad/s].
        fastest: the greatest commanded speed [m/s].
        begins_at: the greatest speed at which the model restarts [m/s].
        velocity: (2,) of the model at the last input, in model axes [m/s].
    """

    def __init__(self, robot: Robot, axle: Axle | None, delay: float, u_max: float, period: float):
        self.limits: Array = robot.command.limits
        self.fastest = self.begins_at = robot.command.fastest
        self._adapter = Adapter(robot.command, robot.response, u_max, period, "free")
        self._axle, self._delay, self._u_max, self._period = axle, delay, u_max, period
        self.forget()

    def forget(self) -> None:
        """Return to the state before the first command."""
        self.velocity: Array = np.zeros(2)
        self._input: Array = np.zeros(2)  # u since then, in model axes [m/s²]
        self._frame_yaw = 0.0  # yaw of the pose's frame in the barriers' frame [rad]
        self.pause()

    def pause(self) -> None:
        """Let the model restart with the velocity that is measured next."""
        self._input_at = -math.inf  # time of the last input [s]
        self._adapter.rest()

    def go_on_from(self, other: "Follower") -> None:
        """Take the state of another model of the same robot."""
        self.velocity, self._input, self._input_at = other.velocity, other._input, other._input_at
        self._frame_yaw = other._frame_yaw
        self._adapter.rest(other._adapter.turns)

    def set_frame_yaw(self, yaw: float) -> None:
        """Turn velocity and input with the pose's frame, whose yaw [rad] a correction changes."""
        turned, self._frame_yaw = math.remainder(yaw - self._frame_yaw, math.tau), yaw
        if turned != 0.0 and self._axle is None:
            rotation = _rotation(turned)
            self.velocity, self._input = rotation @ self.velocity, rotation @ self._input

    def measured_state(self, pose: Array, twist: Array) -> Array:
        """Return (4,) position and velocity of p in the world, by pose and twist of the centre."""
        x, y, yaw = pose
        cos, sin = math.cos(yaw), math.sin(yaw)
        look_ahead = self._adapter.look_ahead
        forward, sideways = twist[0], twist[1] + twist[2] * look_ahead
        velocity = cos * forward - sin * sideways, sin * forward + cos * sideways
        return np.array([x + look_ahead * cos, y + look_ahead * sin, *velocity])

    def velocity_at(self, present: float, yaw: float, measured: Array) -> Array:
        """Return (2,) the model's velocity at the present [s], in the world [m/s].

        After a pause of more than τ + δ no earlier command acts. The model then restarts with the
        measured velocity (2,), as far as the cap allows.
        """
        axes = self._axes(yaw)
        passed = present - self._input_at
        if passed > max(self._delay, PAUSE * self._period):
            velocity = self._capped(measured @ axes)
        else:
            velocity = self.velocity + min(max(passed, 0.0), self._period) * self._input
        return velocity @ axes.T

    def nominal_input(self, nominal: Array, yaw: float, velocity: Array) -> Array:
        """Return u* (2,) that brings the model to the nominal command in one period, within U.

        Args:
            nominal: (k,) the nominal command [m/s, rad/s].
            yaw: the robot's heading [rad].
            velocity: (2,) the model's, in the world [m/s].
        """
        command = np.clip(nominal, -self.limits, self.limits)
        heading = yaw if math.isfinite(yaw) else 0.0
        if self._axle is not None:
            target = command * np.array([1.0, self._adapter.look_ahead])
            target[0] = min(max(target[0], -self.fastest), self.fastest)
            axes = self._axes(heading)
            u = (target - velocity @ axes) / self._period
            largest = np.array([self._axle.braking, self._axle.across])
            return axes @ np.clip(u, -largest, largest)
        forward, sideways, _ = command
        cos, sin = math.cos(heading), math.sin(heading)
        target = np.array([cos * forward - sin * sideways, sin * forward + cos * sideways])
        target *= min(1.0, self.fastest / max(float(np.hypot(*target)), TINY))
        u = (target - velocity) / self._period
        size = float(np.hypot(*u))
        return u * min(1.0, self._u_max / size) if size > 0.0 else u

    def follow(self, velocity: Array, u: Array, yaw: float, present: float) -> None:
        """Hold an input u (2,) from the present [s] on, at which the model has a velocity (2,).

        Both are in the world [m/s², m/s]; `yaw` is the robot's heading [rad].
        """
        axes = self._axes(yaw)
        self.velocity, self._input, self._input_at = velocity @ axes, u @ axes, present

    def command(self, nominal: Array, yaw: float, turning_rate: float) -> Array:
        """Return (k,) the command of the held input, in the robot's axes [m/s, rad/s].

        Args:
            nominal: (k,) the nominal command, whose turning rate a robot with three takes.
            yaw: the robot's heading [rad].
            turning_rate: the robot's measured rate [rad/s].
        """
        target = self.velocity + self._period * self._input
        if self._axle is not None:
            return self._adapter.within(target / np.array([1.0, self._adapter.look_ahead]))
        self._adapter.turn = float(nominal[-1])
        return np.array(self._adapter.command(target[0], target[1], yaw, turning_rate))

    def stop(self) -> Array:
        """Return (k,) the command zero, for a state that is unknown."""
        self._adapter.rest()
        return np.zeros(len(self.limits))

    def _axes(self, yaw: float) -> Array:
        """Return (2, 2) the model axes in columns."""
        return np.eye(2) if self._axle is None or not math.isfinite(yaw) else _rotation(yaw)

    def _capped(self, velocity: Array) -> Array:
        """Return a measured velocity (2,), reduced to the largest with which the model restarts."""
        if self._axle is not None:
            fastest_across = self._adapter.look_ahead * float(self.limits[-1])
            bounds = np.array([min(self.begins_at, self._axle.forward), fastest_across])
            return np.clip(velocity, -bounds, bounds)
        speed = float(np.hypot(*velocity))
        return velocity * min(1.0, self.begins_at / speed) if speed > 0.0 else velocity


def _rotation(yaw: float) -> Array:
    """Return (2, 2) the rotation by an angle [rad]."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, -sin], [sin, cos]])
