"""The conflict of a filtered step: the same answer as from rows that are made by hand."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest

import hcbf_gym
import hcbf_robots
from hcbf_gym import Estimate, Plant, programs
from hcbf_gym.barriers import BarrierSet, CbfRows, Disc, HalfPlane
from hcbf_gym.barriers.planar_rows import planar_rows
from hcbf_gym.errors import InvalidInputError, SafetyWarning
from hcbf_gym.models import Box, SingleIntegrator
from hcbf_gym.programs import FilterResult, FilterStatus
from tests.worlds import World

U = Box.symmetric(5.0)
SCENE = [
    HalfPlane("wall", 1, (-1.0, 0.0), -1.0),
    HalfPlane("lawn", 2, (1.0, 0.0), 1.2),
    Disc("pond", 3, center=(0.0, 4.0), radius=1.0),
]


def by_hand(filt, x, report):
    settings = filt._core.config.row_settings
    batch = planar_rows(BarrierSet([SCENE]), x[None], np.zeros(1), settings, report["margin"][None])
    rows = CbfRows(batch.a[0], batch.b[0], batch.h[0], batch.priority[0], batch.alpha2_psi[0])
    slack = report["slack"]
    answer = FilterResult(np.zeros(2), slack, slack, FilterStatus.RELAXED, 0)
    return programs.conflict_report(rows, answer, U)


@pytest.mark.parametrize("program", programs.names())
def test_the_report_is_that_of_rows_made_by_hand(program):
    filt = hcbf_gym.BatchFilter(U, 0.02, program=program, alpha2=2.0)
    filt.set_scene(SCENE)
    random = np.random.default_rng(0)
    seen = set()
    for _ in range(40):
        x = np.concatenate([random.uniform((-1, 0), (1.5, 4)), random.uniform(-1, 1, 2)])
        filt.reset(x=x)
        _, report = filt(random.uniform(-5, 5, 2), x)
        found = filt.conflict()
        assert found == by_hand(filt, x, report)
        assert filt.conflict() == found  # asking changes nothing
        seen.add(found is None)
    assert seen == {True, False}


def test_each_plant_of_a_batch_has_its_own():
    filt = hcbf_gym.BatchFilter(U, 0.02, num_envs=3, alpha2=2.0)
    filt.set_scene([SCENE, SCENE[:1], SCENE])
    x = np.tile([0.95, 0.0, 0.0, 0.0], (3, 1))
    x[2, 0] = 3.0
    filt.reset(x=x)
    filt(np.zeros((3, 2)), x)
    assert filt.conflict(0).rows == (0, 1)
    assert filt.conflict(0).paid.keys() == {2}
    assert filt.conflict(1) is None


def test_a_state_that_is_not_accepted_has_none():
    filt = hcbf_gym.BatchFilter(U, 0.02)
    filt.set_scene(SCENE)
    filt.reset(x=np.array([0.95, 0.0, 0.0, 0.0]))
    with pytest.warns(SafetyWarning):
        filt(np.zeros(2), np.full(4, np.nan))
    assert filt.conflict() is None


def test_the_conflict_of_an_episode_names_its_conditions():
    env = hcbf_gym.wrappers.SafetyFilter(gym.make("HCBF-Regions-v0", scenario="random"))
    policy = hcbf_gym.policies.PDTracker.for_env(env)
    for seed in range(20):
        observation, info = env.reset(seed=seed)
        for _ in range(200):
            observation, _, terminated, truncated, info = env.step(policy(observation, info))
            report = info["safety_filter"]
            found = env.conflict()
            assert (found is not None) >= bool(report["slack"].any())
            if found is not None:
                ranks = [env.conditions[row].rank for row in found.rows]
                assert max(found.paid) in ranks
                return
            if terminated or truncated:
                break
    pytest.fail("no episode had a conflict")


def test_the_axle_and_its_own_limits():
    filt = hcbf_robots.VelocityFilter("cart", SCENE)
    _, report = filt.step((0.3, 0.0), (0.6, 0.0, 0.0), (0.3, 0.0, 0.0), 0.0)
    found = filt.conflict()
    assert (found is not None) == bool(report["slack"].any())


def test_a_model_that_is_not_compiled():
    scene = [one for one in SCENE if one.name != "pond"]
    x = np.array([0.95, 0.0])
    plant = Plant(
        SingleIntegrator(), scene, lambda env, observation, info: Estimate(x), period=0.05
    )
    world = World(SingleIntegrator(), limit=1.0)
    env = hcbf_gym.wrappers.SafetyFilter(world, plant=plant, alpha2=2.0)
    env.reset()
    env.step(np.zeros(2))
    found = env.conflict()
    assert found is not None
    assert found.rows == (0, 1)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda filt: pickle.loads(pickle.dumps(filt))])
def test_a_copy_reports_the_conflict_of_the_last_step_and_steps_on_alike(copied):
    filt = hcbf_gym.BatchFilter(Box.symmetric(1.0), 0.05, 2)
    filt.set_scene([Disc("left", 1, (0.6, 0.0), 0.5), Disc("right", 2, (-0.6, 0.0), 0.55)])
    x = np.array([[0.0, 0.0, 0.9, 0.0]] * 2)
    filt.reset(x=x)
    filt(np.ones((2, 2)), x)
    other = copied(filt)
    assert filt.conflict(1) is not None
    assert other.conflict(1) == filt.conflict(1)
    assert np.array_equal(other(np.ones((2, 2)), x)[0], filt(np.ones((2, 2)), x)[0])
    with pytest.raises(InvalidInputError, match="from 0 to 1"):
        other.conflict(2)
