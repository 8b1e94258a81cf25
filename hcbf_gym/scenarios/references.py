"""Reference trajectories: the nominal position of the robot at time t."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from hcbf_gym.arrays import Array, Pair
from hcbf_gym.errors import InvalidInputError, finite_array, finite_float
from hcbf_gym.models.constants import FARTHEST

MAX_DURATION = 1e4  # [s], because environments store a row for every control step


class Reference(Protocol):
    """A position over time that ends at a goal and stays there."""

    @property
    def duration(self) -> float:
        """The time at which the goal is reached [s]."""
        ...

    def __call__(self, t: float) -> tuple[Array, Array]:
        """Return position (2,) [m] and velocity (2,) [m/s]."""
        ...

    def acceleration(self, t: float) -> Array:
        """Return the acceleration (2,) [m/s²]."""
        ...


@dataclass(frozen=True)
class PointReference:
    """A goal (2,) [m] from the first moment on."""

    goal: Pair

    def __post_init__(self) -> None:
        goal = finite_array("goal", self.goal, (2,), largest=FARTHEST)
        object.__setattr__(self, "goal", tuple(goal.tolist()))

    @property
    def duration(self) -> float:
        """Zero, because the goal holds from the first moment on."""
        return 0.0

    def __call__(self, t: float) -> tuple[Array, Array]:
        """Return position and velocity."""
        return np.array(self.goal), np.zeros(2)

    def acceleration(self, t: float) -> Array:
        """Return zero."""
        return np.zeros(2)


@dataclass(frozen=True)
class BezierReference:
    """A Bézier curve run along its length with trapezoidal speed; two points make a line.

    Args:
        points: (k, 2) control points [m], 2 ≤ k; the first is the start, the last the goal.
        duration: time from start to goal [s], positive.
        ramp: time of the constant acceleration at either end [s], 0 < ramp ≤ duration / 2.

    Raises:
        InvalidInputError: if the points are too few or repeated, or the times do not fit.
    """

    points: tuple[Pair, ...]
    duration: float = 20.0
    ramp: float = 2.0

    def __post_init__(self) -> None:
        points = finite_array("reference points", self.points, (None, 2), largest=FARTHEST)
        if len(points) < 2 or (np.diff(points, axis=0) == 0.0).all(axis=1).any():
            raise InvalidInputError(
                f"reference points: got {points.tolist()}, expected two or more, none repeated"
            )
        object.__setattr__(self, "points", tuple(tuple(p) for p in points.tolist()))
        for name in ("duration", "ramp"):
            time = getattr(self, name)
            value = finite_float(name, time, minimum=0.0, maximum=MAX_DURATION, exclusive=True)
            object.__setattr__(self, name, value)
        if self.ramp > self.duration / 2:
            raise InvalidInputError(
                f"ramp: got {self.ramp} s, expected at most half of the duration, {self.duration} s"
            )

    def __call__(self, t: float) -> tuple[Array, Array]:
        """Return position and velocity."""
        length, speed, _ = self._timing(t)
        position, tangent, _ = self._curve(length)
        return position, speed * tangent

    def acceleration(self, t: float) -> Array:
        """Return the curve's tangential and centripetal acceleration."""
        length, speed, change = self._timing(t)
        _, tangent, curvature = self._curve(length)
        return change * tangent + speed**2 * curvature

    def _timing(self, t: float) -> tuple[float, float, float]:
        """Return the length run [m], the speed [m/s] and its change [m/s²]."""
        ramp, total_length = self.ramp, self._arc_length[1][-1]
        top_speed = total_length / (self.duration - ramp)
        change = top_speed / ramp
        remaining = self.duration - t
        if t < 0.0:
            return 0.0, 0.0, 0.0
        if t < ramp:
            return 0.5 * change * t**2, change * t, change
        if t <= self.duration - ramp:
            return top_speed * (t - ramp / 2), top_speed, 0.0
        if remaining > 0.0:
            return total_length - 0.5 * change * remaining**2, change * remaining, -change
        return total_length, 0.0, 0.0

    def _curve(self, length: float) -> tuple[Array, Array, Array]:
        """Return position, unit tangent and curvature vector [1/m] after the given length."""
        parameters, lengths = self._arc_length
        s = float(np.interp(length, lengths, parameters))
        points = np.array(self.points)
        velocity = len(points[1:]) * _bezier(np.diff(points, axis=0), s)
        # the curve's derivatives by its parameter are Bézier curves of the points' differences
        bend = np.diff(points, n=2, axis=0)
        acceleration = len(bend) * (len(bend) + 1) * _bezier(bend, s) if len(bend) else np.zeros(2)
        rate = float(np.linalg.norm(velocity))
        tangent = velocity / rate
        curvature = (acceleration - (acceleration @ tangent) * tangent) / rate**2
        return _bezier(points, s), tangent, curvature

    @cached_property
    def _arc_length(self) -> tuple[Array, Array]:
        """(4001,) values of the curve's parameter, and the length from its start [m] to each."""
        parameters = np.linspace(0.0, 1.0, 4001)
        points = np.array(self.points)
        samples = np.array([_bezier(points, s) for s in parameters])
        steps = np.linalg.norm(np.diff(samples, axis=0), axis=1)
        return parameters, np.concatenate([[0.0], np.cumsum(steps)])


def _bezier(points: Array, s: float) -> Array:
    """Return the curve's point at s by repeated interpolation (de Casteljau)."""
    while len(points) > 1:
        points = (1.0 - s) * points[:-1] + s * points[1:]
    return points[0]


KINDS: dict[str, type] = {"bezier": BezierReference, "point": PointReference}
