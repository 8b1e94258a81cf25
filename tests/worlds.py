"""Environments of the filters' tests: plants that are their model, in a loop or at rest."""

from dataclasses import dataclass

import gymnasium as gym
import numpy as np

from hcbf_gym.barriers import Barrier, Jet, PlanarBarrier
from hcbf_gym.barriers.shapes import SHAPES
from hcbf_gym.models import ControlAffine, DoubleIntegrator


def with_others(*given):
    """Return shapes, and one of each built-in class that is not among them."""
    classes = {type(one) for one in given}
    return [*given, *(cls(cls.kind, 1) for cls in SHAPES if cls not in classes)]


class World(gym.Env):
    """A plant that is its model; observation and infos hold x.

    Args:
        model: None is the planar double integrator.
        period: of a step [s]; None is at rest.
        limit: of each input.
        start: x at a reset; None is 0.
    """

    def __init__(self, model=None, period=None, limit=5.0, start=None):
        self.model, self.period = model or DoubleIntegrator(), period
        n, n_u = self.model.n, self.model.n_u
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (n,), np.float64)
        self.action_space = gym.spaces.Box(-limit, limit, (n_u,), np.float64)
        self.start = np.zeros(n) if start is None else np.array(start, dtype=float)
        self.x, self.applied = self.start.copy(), []

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = self.start.copy()
        return self.x.copy(), {"x": self.x.copy()}

    def step(self, action):
        self.applied.append(np.array(action))
        self.x = self.advance(np.asarray(action, dtype=float))
        return self.x.copy(), 0.0, False, False, {"x": self.x.copy()}

    def advance(self, u):
        return self.x if self.period is None else self.model.step(self.x, u, self.period)


@dataclass(frozen=True)
class OwnDisc(PlanarBarrier):
    """A disc of a user's own, without a core."""

    center: tuple[float, float] = (0.0, 0.0)
    radius: float = 0.5
    velocity: tuple[float, float] = (0.0, 0.0)

    def planar_jet(self, q):
        away = q - np.array(self.center)
        distance = np.linalg.norm(away)
        n = away / distance
        return float(distance - self.radius), n, (np.eye(2) - np.outer(n, n)) / distance


@dataclass(frozen=True)
class OwnLinear(Barrier):
    """h = c + s·x of a user's own, of any states; c or s may be NaN."""

    slope: tuple[float, ...] = ()
    constant: float = 0.0

    def jet(self, x, t=0.0):
        slope = np.array(self.slope)
        zero = np.zeros(len(x))
        h = float(self.constant + slope @ x)
        return Jet(h, slope, np.zeros((len(x), len(x))), 0.0, zero, 0.0)


def boat():
    """Return a user's model in NumPy: a double integrator with two drags."""
    return ControlAffine(
        lambda x: np.array([x[2], x[3], -0.5 * x[2], -0.2 * x[3]]),
        lambda x: np.vstack([np.zeros((2, 2)), np.eye(2)]),
        n=4,
        n_u=2,
        velocity_at=2,
    )
