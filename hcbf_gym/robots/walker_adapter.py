r"""From the velocity that the reduced-order model has to what a robot's controller is commanded.

A robot that moves in every direction gets the velocity in its own axes, divided by the gain with
which it follows, and a turning rate from the adapter's own loop. A differential drive with the
heading θ gets what moves the point p + ℓ(cos θ, sin θ) at the velocity,

.. math:: v = \cos θ\, v_x + \sin θ\, v_y, \qquad ω = (\cos θ\, v_y - \sin θ\, v_x) / ℓ.

The heading is the one at which the command will show, ``θ + ω (τ + δ)``: else a long turn would
carry the robot aside. What exceeds the command's limits is scaled down as a whole, so that the
direction stays.
"""

import math

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.robots.walker_parts import Command
from hcbf_gym.robots.walker_response import LEAST_GAIN, MOST_GAIN, Response

TURNING = 2.0
"""Gain of the heading's loop [1/s]."""
HEADING_STARTS, HEADING_STOPS = 0.15, 0.10
"""Speeds [m/s] above which the heading follows the velocity, and below which it is held."""


class Adapter:
    """Turns the model's velocity into commands.

    Args:
        command: limits of the command, and the rule of its heading.
        response: how it follows; None takes it at its word.
        heading: a name of `walker_parts.HEADINGS`; None takes the contract's.

    Attributes:
        turn: the rate that is asked for where the heading is "free" [rad/s].
        follows: how long a velocity takes to show, by which a turn is looked ahead [s].
    """

    def __init__(self, command: Command, response: Response | None, heading: str | None = None):
        self.turn = 0.0
        self._heading = command.heading if heading is None else heading
        self._look_ahead = command.look_ahead
        self._limits: list[float] = command.limits.tolist()
        count = len(self._limits)
        gains = [1.0] * count if response is None else response.gains(count)
        self.follows = 0.0 if response is None else response.follows
        self._gains = [min(max(gain, LEAST_GAIN), MOST_GAIN) for gain in gains]
        self.reset(0.0)

    @property
    def look_ahead(self) -> float:
        """ℓ, how far before the centre the point lies that the velocity is of [m]."""
        return self._look_ahead or 0.0

    def reset(self, yaw: float) -> None:
        """Begin with a heading [rad]."""
        self._target, self._turning = yaw, False

    def command(self, vx: float, vy: float, yaw: float, rate: float) -> tuple[float, ...]:
        """Return the command.

        Args:
            vx: of the model in the world [m/s].
            vy: of the model in the world [m/s].
            yaw: the robot's heading [rad].
            rate: at which it turns [rad/s].
        """
        soon = yaw + rate * self.follows
        cos, sin = math.cos(soon), math.sin(soon)
        ahead, aside = cos * vx + sin * vy, cos * vy - sin * vx
        if self._look_ahead is not None:
            return self._within(ahead, aside / self._look_ahead)
        moving = self._within(ahead / self._gains[0], aside / self._gains[1])
        return (*moving, self._turn(vx, vy, yaw))

    def within(self, speeds: Array) -> Array:
        """Return (2,) v and ω of a differential drive, each within its limit [m/s, rad/s]."""
        return np.clip(speeds, -np.array(self._limits), self._limits)

    def _within(self, one: float, other: float) -> tuple[float, float]:
        """Return both entries, scaled down together to the limits."""
        excess = max(abs(one) / self._limits[0], abs(other) / self._limits[1], 1.0)
        return one / excess, other / excess

    def _turn(self, vx: float, vy: float, yaw: float) -> float:
        """Return the turning rate [rad/s]."""
        most = self._limits[2]
        if self._heading == "free":
            return min(max(self.turn, -most), most)
        if self._heading == "velocity":
            speed = math.hypot(vx, vy)
            self._turning = speed > (HEADING_STOPS if self._turning else HEADING_STARTS)
            if self._turning:
                self._target = math.atan2(vy, vx)
        error = math.remainder(self._target - yaw, math.tau)
        return min(max(TURNING * error / self._gains[2], -most), most)
