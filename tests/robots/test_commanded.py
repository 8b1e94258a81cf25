"""Walkers that come by a contract alone: the A1 with its own controller, and the wheel's Go2."""

import sys
import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import wrappers
from hcbf_gym.robots import Walker

sys.path.insert(0, str(Path(__file__).parent))
from walkers import go2


def walked(robot, seconds=3.0):
    """Return the mean velocity of the last second after a ramp to .5 m/s, and whether it fell."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env = gym.make("HCBF-WalkerRegions-v0", robot=str(robot), scenario="random")
    env.reset(seed=0)
    seen = []
    for k in range(round(seconds / 0.02)):
        _, _, terminated, _, _ = env.step(np.array([1.0, 0.0]) if k < 25 else np.zeros(2))
        seen.append(env.unwrapped.truth[2:])
        if terminated:
            return np.mean(seen, axis=0), True
    return np.mean(seen[-50:], axis=0), False


@pytest.mark.physics
def test_the_a1_with_its_own_controller_walks_by_contract():
    velocity, fell = walked("a1")
    assert not fell
    np.testing.assert_allclose(velocity, [0.5, 0.0], atol=0.06)


@pytest.mark.physics
def test_the_go2_of_the_wheel_walks_by_contract(tmp_path):
    path = go2(tmp_path)
    pytest.importorskip("onnxruntime", reason="needs onnxruntime of the extra walkers")
    velocity, fell = walked(path)
    assert not fell
    np.testing.assert_allclose(velocity, [0.5, 0.0], atol=0.15)


@pytest.mark.physics
def test_a_filtered_a1_stays_where_it_may_be():
    assert Walker.load("a1").name == "a1"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env = wrappers.SafetyFilter(
            gym.make("HCBF-WalkerRegions-v0", robot="a1", scenario="random", v_max=1.0)
        )
    _, info = env.reset(seed=1)
    strict = [k for k, b in enumerate(env.unwrapped.barriers) if b.priority == 1]
    for _ in range(100):
        _, _, terminated, _, info = env.step(np.array([5.0, 3.0]))
        assert not terminated
        assert info["min_h"][strict].min() > 0.0
