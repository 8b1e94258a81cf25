"""A point mass with any sensors, behind the filter."""

import warnings

import numpy as np

import hcbf_gym
from hcbf_gym import barriers, models, wrappers
from tests.worlds import World

PERIOD = 0.02
DISC = barriers.Disc("disc", 1, center=(2.0, 0.0), radius=0.5)
AHEAD = np.array([5.0, 0.0])


def point():
    """Return the point p̈ = u."""
    return World(period=PERIOD)


FILTER_ARGUMENTS = ("guidance", "program", "solver")


def filtered(state=lambda x: x, listed=(DISC,), **options):
    """Return the filtered point; `state` makes the sample of the true state."""
    of_filter = {key: options.pop(key) for key in FILTER_ARGUMENTS if key in options}
    plant = hcbf_gym.Plant(
        barriers=lambda env, observation, info: listed() if callable(listed) else listed,
        state=lambda env, observation, info: state(env.x.copy()),
        **{"model": models.DoubleIntegrator(), "period": PERIOD} | options,
    )
    return wrappers.SafetyFilter(point(), plant=plant, **of_filter)


def quietly(env, u=AHEAD):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        *_, info = env.step(u)
    return info["safety_filter"]
