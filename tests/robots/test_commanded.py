"""The Go2 of a wheel walks by its contract alone; the A1 has an environment of its own."""

import sys
import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym.errors import UnknownNameError

sys.path.insert(0, str(Path(__file__).parent))
from walkers import go2


def walked(robot, seconds=3.0):
    """Return the mean velocity of the last second after a ramp to .5 m/s, and whether it fell."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env = gym.make("hcbf_robots:HCBF-WalkerRegions-v0", robot=str(robot), scenario="random")
    env.reset(seed=0)
    seen = []
    for k in range(round(seconds / 0.02)):
        _, _, terminated, _, _ = env.step(np.array([1.0, 0.0]) if k < 25 else np.zeros(2))
        seen.append(env.unwrapped.truth[2:])
        if terminated:
            return np.mean(seen, axis=0), True
    return np.mean(seen[-50:], axis=0), False


@pytest.mark.physics
def test_the_go2_of_the_wheel_walks_by_contract(tmp_path):
    path = go2(tmp_path)
    pytest.importorskip("onnxruntime", reason="needs onnxruntime of the extra walkers")
    velocity, fell = walked(path)
    assert not fell
    np.testing.assert_allclose(velocity, [0.5, 0.0], atol=0.15)


def test_the_a1_is_named_with_its_own_environment():
    with pytest.raises(UnknownNameError, match="HCBF-A1Regions-v0"):
        gym.make("hcbf_robots:HCBF-WalkerRegions-v0", robot="a1", scenario="random")
