"""A point mass whose sensors may say anything, behind the filter."""

import warnings

import gymnasium as gym
import numpy as np

import hcbf_gym
from hcbf_gym import barriers, models, wrappers

PERIOD = 0.02
DISC = barriers.Disc("disc", 1, center=(2.0, 0.0), radius=0.5)
AHEAD = np.array([5.0, 0.0])


class Point(gym.Env):
    """A point mass of p̈ = u, and what its sensors say of it."""

    action_space = gym.spaces.Box(-5.0, 5.0, (2,), np.float64)
    observation_space = gym.spaces.Box(-np.inf, np.inf, (4,), np.float64)

    def __init__(self):
        self.x, self.said = np.zeros(4), None

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = np.zeros(4)
        return self.x.copy(), {}

    def step(self, u):
        self.x[:2] += PERIOD * self.x[2:] + 0.5 * PERIOD**2 * u
        self.x[2:] += PERIOD * u
        return self.x.copy(), 0.0, False, False, {}


FILTER_ARGUMENTS = ("guidance", "program", "solver")


def filtered(state=lambda x: x, listed=(DISC,), **options):
    """Return the filtered point; `state` makes what the filter is told of the true state."""
    of_filter = {key: options.pop(key) for key in FILTER_ARGUMENTS if key in options}
    plant = hcbf_gym.Plant(
        barriers=lambda env, observation, info: listed() if callable(listed) else listed,
        state=lambda env, observation, info: state(env.x.copy()),
        **{"model": models.DoubleIntegrator(), "period": PERIOD} | options,
    )
    return wrappers.SafetyFilter(Point(), plant=plant, **of_filter)


def quietly(env, u=AHEAD):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        *_, info = env.step(u)
    return info["safety_filter"]
