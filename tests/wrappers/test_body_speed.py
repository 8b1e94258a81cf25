"""A body that is faster than a strict limit is UNSAFE, whatever its model does, by every way in."""

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import Plant, models
from hcbf_gym.barriers import Disc, SpeedLimit
from hcbf_gym.models.axle import Axle
from hcbf_gym.models.plant import Estimate
from hcbf_gym.programs import FilterStatus
from hcbf_gym.wrappers import SafetyFilter, VectorSafetyFilter
from tests.worlds import boat

BARRIERS = [SpeedLimit("cap", 1, 1.0), Disc("far", 1, (50.0, 0.0), 1.0)]
CART = Axle(look_ahead=0.25, forward=3.0, turn=5.0, braking=3.0)
ASIDE = 0.75
"""How fast the point before a cart's axle goes aside: the cart turns at 3 rad/s."""


MODELS = {
    "planar": models.DoubleIntegrator(),
    "drag": models.DoubleIntegrator(drag=0.5),
    "own": boat(),
    "axle": models.DoubleIntegrator(),
}


class Lagging(gym.Env):
    """A body that is faster than its model by `lag`."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (4,))
    action_space = gym.spaces.Box(-3.0, 3.0, (2,), dtype=np.float64)

    def __init__(self, lag=0.0, rank=1):
        self.lag, self.rank = lag, rank

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.array([0.0, 0.0, 0.5, self.lag], dtype=np.float32), {}

    def step(self, action):
        return self.reset()[0], 0.0, False, False, {}


def seen(env, observation, info):
    x = np.array(observation, dtype=np.float64)
    lag = np.zeros_like(x)
    lag[..., 2], x[..., 3] = x[..., 3], 0.0
    return Estimate(x, None, None, x, lag)


def seen_turning(env, observation, info):
    estimate = seen(env, observation, info)
    estimate.x[..., 3] = ASIDE
    return estimate._replace(heading=np.zeros(estimate.x.shape[:-1]))


def plant(rank, name):
    return Plant(
        MODELS[name],
        [SpeedLimit("cap", rank, 1.0), BARRIERS[1]],
        seen_turning if name == "axle" else seen,
        models.input_sets.Box.symmetric(3.0),
        period=0.05,
        axle=CART if name == "axle" else None,
    )


def alone(lag, rank, name):
    env = SafetyFilter(Lagging(lag), plant=plant(rank, name))
    env.reset(seed=0)
    return env.step(np.zeros(2))[4]["safety_filter"]["status"]


def among_others(lag, rank, name):
    envs = gym.vector.SyncVectorEnv([lambda: Lagging(0.0), lambda: Lagging(lag)])
    envs = VectorSafetyFilter(envs, plant=plant(rank, name))
    envs.reset(seed=0)
    first, second = envs.step(np.zeros((2, 2)))[4]["safety_filter"]["status"]
    assert first != FilterStatus.UNSAFE
    return second


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("way", [alone, among_others])
@pytest.mark.parametrize(
    ("lag", "rank", "unsafe"), [(0.7, 1, True), (0.3, 1, False), (0.7, 2, False)]
)
@pytest.mark.filterwarnings("ignore:.*safety filter", "ignore::hcbf_gym.errors.CoverageWarning")
def test_a_body_that_is_too_fast_is_unsafe(way, lag, rank, unsafe, name):
    assert (way(lag, rank, name) == FilterStatus.UNSAFE) == unsafe
