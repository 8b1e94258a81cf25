import gymnasium as gym
import numpy as np
import pytest

import hcbf_gym  # noqa: F401 - registers the environments
from hcbf_gym.barriers import BarrierSet
from hcbf_gym.errors import InvalidInputError


def make(**arguments):
    return gym.make("HCBF-A1Regions-v0", scenario="random", **arguments)


def walk(env, seed, steps):
    observation, info = env.reset(seed=seed)
    rng = np.random.default_rng(seed)
    seen = [(observation, info, env.unwrapped.estimate)]
    for _ in range(steps):
        observation, _, _, _, info = env.step(rng.uniform(-1.0, 1.0, 2).astype(np.float32))
        seen.append((observation, info, env.unwrapped.estimate))
    return seen


def test_without_estimation_the_loop_sees_the_truth():
    env = make(feedback="measured")
    env.reset(seed=0)
    env.step(np.array([1.0, -0.5], dtype=np.float32))
    inner = env.unwrapped
    np.testing.assert_array_equal(inner.estimate.x, inner.simulation.base_state)
    assert inner.estimate.covariance is None


@pytest.mark.physics
def test_the_loop_sees_the_estimate_and_h_stays_the_truth():
    env = make(estimation={"drift": 0.05}, feedback="measured")
    inner = env.unwrapped
    away = []
    for observation, info, estimate in walk(env, seed=1, steps=25):
        barriers = inner.scenario.barriers
        np.testing.assert_array_equal(observation[4:6], estimate.x[2:])
        assert estimate.covariance.shape == (4, 4)
        assert info["h"].shape == (len(barriers) + 1,)
    truth = inner.simulation.base_state
    h = BarrierSet([inner.barriers]).along(truth[None], np.array([inner.time]))[0]
    np.testing.assert_allclose(info["h"], h, atol=1e-12)
    seen = BarrierSet([inner.barriers]).along(estimate.x[None], np.array([inner.time]))[0]
    away = np.abs(seen - h)
    assert away.max() > 1e-3
    assert inner.estimate.heading != pytest.approx(0.0, abs=1e-6)


@pytest.mark.physics
def test_a_seed_decides_the_estimates_and_leaves_the_plant_alone():
    arguments = {"randomization": {"payload": [0.0, 4.0], "floor_friction": [0.5, 1.0]}}
    env, plain = make(estimation="lidar", **arguments), make(**arguments)
    first, again = walk(env, 3, 10), walk(env, 3, 10)
    for (a, _, known_a), (b, _, known_b) in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(known_a.x, known_b.x)
    assert not np.array_equal(walk(env, 4, 0)[0][2].x, first[0][2].x)
    walk(env, 3, 0)
    walk(plain, 3, 0)
    assert plain.unwrapped.simulation.conditions == env.unwrapped.simulation.conditions
    assert plain.unwrapped.scenario.to_dict() == env.unwrapped.scenario.to_dict()


@pytest.mark.physics
@pytest.mark.parametrize("preset", ["motion-capture", "lidar", "uwb"])
def test_the_robot_walks_on_what_it_knows(preset):
    env = make(estimation=preset, feedback="measured")
    start = env.reset(seed=2)[1]["h"]
    wanted = np.array([0.5, 0.3])
    for _ in range(150):
        velocity = env.unwrapped.estimate.x[2:]
        action = np.clip(4.0 * (wanted - velocity), -3.0, 3.0).astype(np.float32)
        _, _, terminated, _, info = env.step(action)
        assert not info["fallen"]
        if terminated:
            break
    assert info["qp_failures"] == 0.0
    assert not np.array_equal(info["h"], start)
    assert np.linalg.norm(env.unwrapped.simulation.base_state[2:] - wanted) < 0.2


def test_bad_estimation_is_refused():
    with pytest.raises(InvalidInputError, match="rate"):
        make(estimation={"rate": -1.0})
