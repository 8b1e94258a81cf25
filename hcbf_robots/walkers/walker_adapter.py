r"""Turns the velocity of the reduced-order model into the command of a robot's controller.

A robot that moves in every direction gets the velocity in its own axes, divided by the gains with
which it follows, and a turning rate from the adapter's own loop. A differential drive with the
heading θ gets the command that moves the point p + ℓ(cos θ, sin θ) at the velocity,

.. math:: v = \cos θ\, v_x + \sin θ\, v_y, \qquad ω = (\cos θ\, v_y - \sin θ\, v_x) / ℓ.

The heading is predicted for the time at which the command takes effect, ``θ + ω (τ + δ)``. Without
the prediction, a long turn would carry the robot aside. A command beyond the limits is scaled down
as a whole, so that its direction stays.

The turning rate of a robot that moves in every direction is limited, so that its velocity can
follow:

.. math:: |ω| ≤ \min(0.25 / (\max(1, v) (τ + δ + T)), a / (2 v)).

v is the robot's greatest speed, and a its acceleration in every direction. Within τ + δ + T, in
which a command takes effect and is held, the rate changes by no more than the first limit.
"""

import math

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import LEAST_GAIN, MOST_GAIN, UNKNOWN, Response

HEADING_GAIN = 2.0  # of the heading's loop [1/s]
HEADING_STARTS, HEADING_STOPS = _core.HEADING_STARTS, _core.HEADING_STOPS
"""Speeds [m/s] above which the heading follows the velocity, and below which it is held."""

TURN_OF_COMMAND = 0.25
"""Turn of a robot of 1 m/s within τ + δ + T [rad]; a faster robot turns less. The velocity's
direction is off by as much where a turn begins or ends."""
TURNING_SHARE = 0.5  # share of the acceleration that a velocity may need which turns with the robot


class Adapter:
    """Turns the model's velocity into commands.

    Args:
        command: limits of the command, and the rule of its heading.
        response: how the robot follows; None assumes exact gains, and for a robot that moves in
            every direction half of the time that an unmeasured one takes to follow.
        able: a, the greatest acceleration that the robot has in every direction [m/s²].
        period: T, the longest time for which a command is held [s].
        heading: a name of `walker_parts.HEADINGS`; None takes the contract's.

    Attributes:
        turn: the requested turning rate where the heading is "free" [rad/s].
        turns: the turning rate that was commanded last [rad/s].
    """

    def __init__(
        self,
        command: Command,
        response: Response | None,
        able: float,
        period: float,
        heading: str | None = None,
    ):
        self.turn = 0.0
        self._heading = command.heading if heading is None else heading
        self._look_ahead = command.look_ahead
        self._limits: list[float] = command.limits.tolist()
        count = len(self._limits)
        gains = [1.0] * count if response is None else response.gains(count)
        self._gains = [min(max(gain, LEAST_GAIN), MOST_GAIN) for gain in gains]
        if response is not None:
            self._follows = response.follows
        else:
            self._follows = 0.5 * UNKNOWN.follows if self._look_ahead is None else 0.0
        takes_effect, fastest = self._follows + period, command.fastest
        rate = TURN_OF_COMMAND / max(1.0, fastest) / takes_effect
        self._greatest_rate = min(self._limits[-1], rate, TURNING_SHARE * able / fastest)
        self._greatest_change = rate / takes_effect * period  # of the rate, from call to call
        self.reset(0.0)

    @property
    def look_ahead(self) -> float:
        """ℓ, how far before the centre the point lies that has the velocity [m]; 0 for none."""
        return self._look_ahead or 0.0

    def reset(self, yaw: float) -> None:
        """Begin at rest with a heading [rad]."""
        self._target_yaw, self._is_turning = yaw, False
        self.rest()

    def rest(self, turns: float = 0.0) -> None:
        """Continue from the turning rate that was commanded last [rad/s]."""
        self.turns = turns

    def command(self, vx: float, vy: float, yaw: float, rate: float) -> tuple[float, ...]:
        """Return the command, (v, ω) or (v_x, v_y, ω), for a velocity in the world [m/s, rad/s].

        `yaw` and `rate` are the robot's measured heading [rad] and turning rate [rad/s].
        """
        predicted_yaw = yaw + rate * self._follows
        cos, sin = math.cos(predicted_yaw), math.sin(predicted_yaw)
        ahead, aside = cos * vx + sin * vy, cos * vy - sin * vx
        if self._look_ahead is not None:
            return self._scaled_down(ahead, aside / self._look_ahead)
        velocity = self._scaled_down(ahead / self._gains[0], aside / self._gains[1])
        return (*velocity, self._limited_rate(vx, vy, yaw))

    def within(self, speeds: Array) -> Array:
        """Return (2,) v and ω of a differential drive, each within its limit [m/s, rad/s]."""
        return np.clip(speeds, -np.array(self._limits), self._limits)

    def _scaled_down(self, first: float, second: float) -> tuple[float, float]:
        """Return the command's first two entries, scaled down together to their limits."""
        excess = max(abs(first) / self._limits[0], abs(second) / self._limits[1], 1.0)
        return first / excess, second / excess

    def _limited_rate(self, vx: float, vy: float, yaw: float) -> float:
        """Return the turning rate [rad/s] within its limits, for a velocity in the world [m/s]."""
        rate = self._requested_rate(vx, vy, yaw)
        rate = min(max(rate, -self._greatest_rate), self._greatest_rate)
        change = min(max(rate - self.turns, -self._greatest_change), self._greatest_change)
        self.turns += change
        return self.turns

    def _requested_rate(self, vx: float, vy: float, yaw: float) -> float:
        """Return the turning rate [rad/s] by the rule of the heading."""
        if self._heading == "free":
            return self.turn
        if self._heading == "velocity":
            speed = math.hypot(vx, vy)
            self._is_turning = speed > (HEADING_STOPS if self._is_turning else HEADING_STARTS)
            if self._is_turning:
                self._target_yaw = math.atan2(vy, vx)
        return HEADING_GAIN * math.remainder(self._target_yaw - yaw, math.tau) / self._gains[2]
