"""Every core answers alike: a solver by name, and of a body that is faster than a strict limit."""

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import Estimate, Plant, models, wrappers
from hcbf_gym.barriers import Disc, HalfPlane, SpeedLimit
from hcbf_gym.models import Axle, DoubleIntegrator
from hcbf_gym.programs import FilterStatus
from hcbf_gym.wrappers import SafetyFilter, VectorSafetyFilter
from hcbf_robots.maps import MapClass
from tests.maps.floors import cells, on_map, room
from tests.worlds import World, boat

LISTED = [
    HalfPlane("wall", 1, normal=(-1.0, 0.0), offset=-0.4),
    Disc("disc", 2, center=(0.0, 0.6), radius=0.3),
]


def reports(world, program, rows, solver):
    """Return u_safe, slack, margin and status of 60 steps towards a corner."""
    env, plant = world()
    env = wrappers.SafetyFilter(env, program, plant=plant, rows=rows, solver=solver)
    env.reset(seed=3)
    answers = []
    for k in range(60):
        action = np.array([4.0 * np.cos(0.02 * k), 4.0 * np.sin(0.02 * k)], dtype=np.float32)
        *_, info = env.step(action)
        report = info["safety_filter"]
        answers.append(np.hstack([report[key] for key in ("u_safe", "slack", "margin", "status")]))
    return np.array(answers)


def listed():
    """Return an environment with a plant that lists its barriers."""
    return World(period=0.02), Plant(DoubleIntegrator(), LISTED, lambda env, *_: env.x, period=0.02)


def scene():
    """Return an environment of this package, which brings its plant."""
    return gym.make("HCBF-Regions-v0", scenario="random"), None


def mapped():
    """Return an environment of this package on a map with a speed zone."""
    zone = MapClass("zone", 2, "speed", cells(4), limit=0.5)
    return gym.make("HCBF-Regions-v0", scenario=on_map(room(3, zone=zone), (0.5, 1.5))), None


@pytest.mark.parametrize("rows", ["held", "usual"])
@pytest.mark.parametrize("program", ["h-cbf-qp", "lex-cbf-qp"])
@pytest.mark.parametrize("world", [listed, scene, mapped])
@pytest.mark.filterwarnings("ignore:safety filter")
def test_a_solver_by_name_gives_the_compiled_answers(world, program, rows):
    compiled, named = (reports(world, program, rows, solver) for solver in (None, "daqp"))
    np.testing.assert_allclose(named, compiled, rtol=0.0, atol=1e-6)


@pytest.mark.filterwarnings("ignore:safety filter")
def test_held_rows_with_a_solver_by_name_differ_from_usual_ones():
    held, usual = (reports(listed, "lex-cbf-qp", rows, "daqp") for rows in ("held", "usual"))
    assert np.abs(held - usual).max() > 1e-3


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
