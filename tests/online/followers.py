"""Robots that follow velocities later, for loops without physics."""

import math
from collections import deque

import numpy as np

from hcbf_gym.barriers import HalfPlane

TICK = 0.005
WALL = HalfPlane("wall", 1, normal=(-1.0, 0.0), offset=-2.0)
FAR = [HalfPlane("far", 1, normal=(-1.0, 0.0), offset=-900.0)]


class Lagged:
    """A robot that follows velocities in its own axes by a delay and a first-order lag.

    Args:
        pose: (3,) at the start [m, rad].
        lag: time constant [s].
        delay: [s].
        hardest: acceleration in the plane [m/s²].
        gain: share of the command that it reaches.
        noise: standard deviation of its forward speed [m/s].
        seed: of the noise.
    """

    def __init__(self, pose, lag, delay, hardest=math.inf, gain=1.0, noise=0.0, seed=0):
        self.pose, self.velocity = np.array(pose), np.zeros(3)
        self._most = TICK * hardest  # change of its velocity in the plane
        self._share = 1.0 if lag == 0.0 else 1.0 - math.exp(-TICK / lag)
        self._gain, self._noise, self._rng = gain, noise, np.random.default_rng(seed)
        self._waiting = deque([np.zeros(3)] * (round(delay / TICK) + 1))

    def drive(self, command, seconds):
        """Yield the positions (2,) on the path."""
        given = np.array([command[0], 0.0, command[1]]) if len(command) == 2 else command
        for _ in range(round(seconds / TICK)):
            self._waiting.append(self._gain * given)
            change = self._share * (self._waiting.popleft() - self.velocity)
            change[:2] *= min(1.0, self._most / max(float(np.hypot(*change[:2])), 1e-12))
            self.velocity = self.velocity + change
            cos, sin = np.cos(self.pose[2]), np.sin(self.pose[2])
            ahead, aside, turn = self.velocity
            ahead += self._noise * self._rng.standard_normal() if self._noise else 0.0
            step = cos * ahead - sin * aside, sin * ahead + cos * aside, turn
            self.pose = self.pose + TICK * np.array(step)
            yield self.pose[:2].copy()
