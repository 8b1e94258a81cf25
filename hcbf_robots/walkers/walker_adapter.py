r"""From the velocity that the reduced-order model has to what a robot's controller is commanded.

A robot that moves in every direction gets the velocity in its own axes, divided by the gain with
which it follows, and a turning rate from the adapter's own loop. A differential drive with the
heading θ gets what moves the point p + ℓ(cos θ, sin θ) at the velocity,

.. math:: v = \cos θ\, v_x + \sin θ\, v_y, \qquad ω = (\cos θ\, v_y - \sin θ\, v_x) / ℓ.

The heading is the one at which the command will show, ``θ + ω (τ + δ)``: else a long turn would
carry the robot aside. What exceeds the command's limits is scaled down as a whole, so that the
direction stays.

A robot that moves in every direction is commanded to turn no faster than its velocity can follow,

.. math:: |ω| ≤ \min(0.25 / (\max(1, v) (τ + δ + T)), a / (2 v)),

and reaches the first of these no sooner than within τ + δ + T, the time in which a command shows
and is held. v is its greatest speed, and a the acceleration that it has in every direction.
"""

import math

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import LEAST_GAIN, MOST_GAIN, UNKNOWN, Response

TURNING = 2.0  # gain of the heading's loop [1/s]
HEADING_STARTS, HEADING_STOPS = _core.HEADING_STARTS, _core.HEADING_STOPS
"""Speeds [m/s] above which the heading follows the velocity, and below which it is held."""

TURNED = 0.25
"""By how much a robot of 1 m/s that moves in any direction may turn in the time in which a command
shows, and is held [rad]; a faster one by less. Its velocity is off by as much where it begins to
turn, or to turn back: so its rate changes no faster than to that in the same time."""
ROUND = 0.5  # share of the robot's braking that a velocity may need which turns with its body


class Adapter:
    """Turns the model's velocity into commands.

    Args:
        command: limits of the command, and the rule of its heading.
        response: how it follows; None takes commands as exact, but turns to the
            heading as late as is assumed.
        able: the greatest acceleration that it has in every direction [m/s²].
        period: T, for which a command is held at most [s].
        heading: a name of `walker_parts.HEADINGS`; None takes the contract's.

    Attributes:
        turn: the requested rate where the heading is "free" [rad/s].
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
        shows, fastest = self._follows + period, command.fastest
        turns = TURNED / max(1.0, fastest) / shows
        self._turns_at_most = min(self._limits[-1], turns, ROUND * able / fastest)
        self._turns_sooner = turns / shows * period
        self.reset(0.0)

    @property
    def look_ahead(self) -> float:
        """ℓ, how far before the centre the point lies that the velocity is of [m]."""
        return self._look_ahead or 0.0

    def reset(self, yaw: float) -> None:
        """Begin with a heading [rad]."""
        self._target, self._turning = yaw, False
        self.rest()

    def rest(self, turns: float = 0.0) -> None:
        """Continue from the rate that was commanded last [rad/s]."""
        self.turns = turns

    def command(self, vx: float, vy: float, yaw: float, rate: float) -> tuple[float, ...]:
        """Return the command for a velocity in the world [m/s], a heading [rad] and its rate."""
        soon = yaw + rate * self._follows
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
        most, sooner = self._turns_at_most, self._turns_sooner
        turn = min(max(self._requested(vx, vy, yaw), -most), most)
        self.turns += min(max(turn - self.turns, -sooner), sooner)
        return self.turns

    def _requested(self, vx: float, vy: float, yaw: float) -> float:
        """Return the requested turning rate [rad/s]."""
        if self._heading == "free":
            return self.turn
        if self._heading == "velocity":
            speed = math.hypot(vx, vy)
            self._turning = speed > (HEADING_STOPS if self._turning else HEADING_STARTS)
            if self._turning:
                self._target = math.atan2(vy, vx)
        return TURNING * math.remainder(self._target - yaw, math.tau) / self._gains[2]
