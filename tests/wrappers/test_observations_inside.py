"""Wrappers inside a filter that transform the observation which its plant reads."""

import functools

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv
from point_mass import DISC, point

import hcbf_gym
from hcbf_gym import models, wrappers
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.wrappers.checks import INFO, OBSERVATION, reads

pytestmark = pytest.mark.filterwarnings("ignore")  # Gymnasium's, of rounded bounds

WRAPPERS = {
    "NormalizeObservation": gym.wrappers.NormalizeObservation,
    "TransformObservation": lambda env: gym.wrappers.TransformObservation(
        env, lambda seen: 0.1 * seen, None
    ),
    "FlattenObservation": gym.wrappers.FlattenObservation,
    "FrameStackObservation": lambda env: gym.wrappers.FrameStackObservation(env, 2),
    "DelayObservation": lambda env: gym.wrappers.DelayObservation(env, 1),
    "MaxAndSkipObservation": lambda env: gym.wrappers.MaxAndSkipObservation(env, 2),
    "TimeAwareObservation": lambda env: gym.wrappers.TimeAwareObservation(
        gym.wrappers.TimeLimit(env, 100)
    ),
    "DtypeObservation": lambda env: gym.wrappers.DtypeObservation(env, np.float32),
    "RescaleObservation": lambda env: gym.wrappers.RescaleObservation(
        Bounded(env), np.float64(0.0), np.float64(1.0)
    ),
}


class Bounded(gym.Wrapper):
    """A point whose observations have bounds, which some wrappers need."""

    def __init__(self, env):
        super().__init__(env)
        env.unwrapped.observation_space = gym.spaces.Box(-9.0, 9.0, (4,), np.float64)


class Reader:
    def __call__(self, env, observation, info):
        return observation[:4]


class Other:
    def __call__(self, env, observation, info):
        return env.x

    def method(self, env, observation, info):
        return observation

    def of_env(self, env, *_):
        return env.x


def forwards(*given):
    return Reader()(*given)


def named(name, env, *_):
    return getattr(env, name)


def seen_by(name, env, observation, info):
    return observation


READING = {
    "a lambda": lambda env, observation, info: observation[:4],
    "under another name": lambda e, o, i: np.asarray(o)[:4],
    "an inner function": lambda env, observation, info: (lambda: observation)(),
    "a list": lambda env, observation, info: [one + 1.0 for one in observation],
    "all arguments": lambda *given: given[1],
    "what follows": lambda env, *rest: rest[0],
    "forwarded": forwards,
    "an object": Reader(),
    "a method": Other().method,
    "a part": functools.partial(seen_by, "x"),
    "all that is local": lambda env, observation, info: locals()["observation"],
    "code of C": max,
}
NOT_READING = {
    "the environment": lambda env, observation, info: env.x.copy(),
    "the info": lambda env, observation, info: info["x"],
    "no name for it": lambda env, *_: env.x.copy(),
    "an object": Other(),
    "a method": Other().of_env,
    "a part": functools.partial(named, "x"),
    "no reader": [DISC],
    "nothing": None,
}


@pytest.mark.parametrize("reader", READING)
def test_a_reader_of_the_observation_is_known_by_its_code(reader):
    assert reads(READING[reader], OBSERVATION)


@pytest.mark.parametrize("reader", NOT_READING)
def test_a_reader_of_anything_else_is_known_by_its_code(reader):
    assert not reads(NOT_READING[reader], OBSERVATION)


def test_a_reader_of_the_info_is_known_by_its_code():
    reading = [name for name, reader in NOT_READING.items() if reads(reader, INFO)]
    assert reading == ["the info"]
    assert all(
        reads(READING[name], INFO) for name in ("all arguments", "what follows", "forwarded")
    )


def plant(state, listed=(DISC,)):
    return hcbf_gym.Plant(models.DoubleIntegrator(), listed, state, period=0.02)


@pytest.mark.parametrize("name", WRAPPERS)
def test_a_wrapper_inside_that_transforms_what_the_plant_reads_is_named(name):
    inside = gym.wrappers.RecordEpisodeStatistics(WRAPPERS[name](point()))
    with pytest.raises(InvalidInputError, match=rf"got a {name} inside.*{name}\(filtered, …\)"):
        wrappers.SafetyFilter(inside, plant=plant(READING["a lambda"]))
    wrappers.SafetyFilter(inside, plant=plant(NOT_READING["the environment"]))
    outside = WRAPPERS[name](wrappers.SafetyFilter(point(), plant=plant(READING["a lambda"])))
    outside.reset(seed=0)
    outside.step(np.ones(2))


@pytest.mark.parametrize("field", ["barriers", "goal", "extent"])
def test_each_reader_of_the_plant_counts(field):
    reads = plant(lambda env, *_: env.x.copy())
    reads = hcbf_gym.Plant(
        **{name: getattr(reads, name) for name in ("model", "barriers", "state", "period")}
        | {field: lambda env, observation, info: observation}
    )
    with pytest.raises(InvalidInputError, match=f"whose {field} may read"):
        wrappers.SafetyFilter(gym.wrappers.NormalizeObservation(point()), plant=reads)


def test_wrappers_of_and_in_a_vector_environment_are_named():
    reads = hcbf_gym.Plant(
        models.DoubleIntegrator(), [DISC], READING["a lambda"], models.Box.symmetric(5.0),
        period=0.02,
    )  # fmt: skip
    singles = [point, point]
    for env in (
        gym.wrappers.vector.NormalizeObservation(SyncVectorEnv(singles)),
        gym.wrappers.vector.TransformObservation(SyncVectorEnv(singles), lambda seen: 0.1 * seen),
        gym.wrappers.vector.DtypeObservation(SyncVectorEnv(singles), np.float32),
        SyncVectorEnv([lambda: gym.wrappers.NormalizeObservation(point())] * 2),
    ):
        with pytest.raises(InvalidInputError, match=r"got a \w+ inside, which transforms"):
            wrappers.VectorSafetyFilter(env, plant=reads)


def test_what_transforms_observations_may_stand_inside_this_package_s_filter():
    env = gym.make("HCBF-Regions-v0", scenario="random")
    filtered = wrappers.SafetyFilter(gym.wrappers.NormalizeObservation(env))
    filtered.reset(seed=0)
    filtered.step(np.ones(2, dtype=np.float32))
    wrappers.SafetyFilter(wrappers.RankedObservation(env))
