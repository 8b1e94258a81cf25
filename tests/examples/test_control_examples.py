"""The examples of foreign environments keep what they promise."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("jax")

EXAMPLES = Path(__file__).parents[2] / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_unicycle_that_turns_towards_a_pillar_never_enters_it():
    unicycle = load("unicycle")
    for y in (-0.3, 0.0, 0.2):
        x, moved = np.array([-1.0, y, 0.0]), False
        for _ in range(150):
            aim = np.sin(np.arctan2(-x[1], 1.0 - x[0]) - x[2])
            x, status = unicycle.drive(x, np.array([1.0, 2.0 * np.sign(aim)]))
            moved |= status > 0
            assert np.hypot(x[0] - 1.0, x[1]) > 0.5
        assert moved


def touches(env):
    ground = env.unwrapped.model.geom("ground").id
    return any(c.dist < 0.0 and ground not in c.geom for c in env.unwrapped.data.contact)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["UMaze", "Medium", "Large"])
def test_the_ball_never_touches_a_wall_and_arrives(name):
    pytest.importorskip("gymnasium_robotics")
    point_maze = load("point_maze")
    env = point_maze.make(f"PointMaze_{name}-v3", max_episode_steps=2000)
    touched, arrived = {}, {}
    for which in (env, env.env):
        observation, info = which.reset(seed=3)
        touched[which is env] = 0
        over = False
        while not over:
            to_goal = observation["desired_goal"] - observation["achieved_goal"]
            action = np.clip(4.0 * to_goal, -1.0, 1.0).astype(np.float32)
            observation, _, terminated, truncated, info = which.step(action)
            touched[which is env] += touches(which)
            over = terminated or truncated
        arrived[which is env] = info["success"]
    assert touched[False] > 0
    assert touched[True] == 0
    assert arrived[True]


@pytest.mark.filterwarnings("ignore")
def test_the_filters_model_of_the_ball_is_exact():
    pytest.importorskip("gymnasium_robotics")
    env = load("point_maze").make()
    _, info = env.reset(seed=3)
    env.action_space.seed(3)
    for _ in range(100):
        info = env.step(env.action_space.sample())[-1]
    assert info["safety_filter"]["model_error"] < 1e-6
