"""Guidance where nothing is around: its row is the only one, from the first step on."""

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import Estimate, Plant, models
from hcbf_gym.barriers import Disc
from hcbf_gym.models import Box
from hcbf_gym.wrappers import SafetyFilter, VectorSafetyFilter
from hcbf_robots import VelocityFilter
from tests.worlds import World

GOAL = (3.0, 1.0)
ASIDE = [Disc("aside", 1, (-2.0, 2.0), 0.5)]


@pytest.mark.parametrize("robot", ["cart", "holonomic-cart"])
def test_a_robot_is_led_through_nothing(robot):
    safe = VelocityFilter(robot, [], goal=GOAL, guidance="geodesic", period=0.05)
    pose, twist = np.zeros(3), np.zeros(3)
    for k in range(120):
        if k in (20, 40):
            safe.barriers = ASIDE if k == 20 else []
        reported, report = safe.step(
            np.zeros(len(safe.robot.command.limits)), pose, twist, 0.05 * k
        )
        assert report["reason"] == 0
        assert report["h"].shape == ((1,) if 20 <= k < 40 else (0,))
        ahead, aside = (reported[0], 0.0) if len(reported) == 2 else reported[:2]
        twist = np.array([ahead, aside, reported[-1]])
        middle = pose[2] + 0.025 * twist[2]
        cos, sin = np.cos(middle), np.sin(middle)
        step = cos * ahead - sin * aside, sin * ahead + cos * aside, twist[2]
        pose = pose + 0.05 * np.array(step)
    assert np.hypot(*(GOAL - pose[:2])) < 1.5


def point():
    return World(period=0.05, limit=3.0)


@pytest.mark.parametrize("count", [None, 2])
@pytest.mark.filterwarnings("ignore::hcbf_gym.errors.CoverageWarning")
def test_wrapped_environments_are_led_through_nothing(count):
    plant = Plant(
        models.DoubleIntegrator(),
        [],
        lambda env, observation, info: Estimate(np.array(observation)),
        Box.symmetric(3.0),
        period=0.05,
        goal=GOAL,
    )
    if count is None:
        env = SafetyFilter(point(), plant=plant, guidance="geodesic")
    else:
        env = VectorSafetyFilter(
            gym.vector.SyncVectorEnv([point] * count), plant=plant, guidance="geodesic"
        )
    env.reset(seed=0)
    for _ in range(40):
        observation, *_ = env.step(np.zeros(env.action_space.shape))
    assert (observation[..., 0] > 0.5).all()
