"""The examples of foreign environments keep what they promise."""

import importlib.util
import re
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from needs import needs

from hcbf_gym.programs import FilterStatus

EXAMPLES = Path(__file__).parents[2] / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@needs("jax")
def test_a_unicycle_that_turns_towards_a_pillar_never_enters_it():
    unicycle = load("unicycle")
    env = unicycle.make()
    for y in (-0.3, 0.0, 0.2):
        x, info = env.reset(options={"start": (-1.0, y, 0.0)})
        moved = False
        for _ in range(150):
            aim = np.sin(np.arctan2(-x[1], 1.0 - x[0]) - x[2])
            x, _, _, _, info = env.step(np.array([1.0, 2.0 * np.sign(aim)]))
            moved |= bool(info["safety_filter"]["status"] > 0)
            assert np.hypot(x[0] - 1.0, x[1]) > 0.5
        assert moved


@needs("jax")
@pytest.mark.parametrize("kind", ["sync", "async"])
def test_functions_filter_inside_gymnasiums_vector_environments(kind, monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)
    make = importlib.import_module("unicycle").make  # by its name, which a new process imports
    single = make()
    if kind == "sync":
        env = gym.vector.SyncVectorEnv([make] * 2)
    else:  # JAX has threads, which a forked process would miss
        env = gym.vector.AsyncVectorEnv([make] * 2, context="spawn")
    env.reset()
    x, _ = single.reset()
    for turn in (0.5, -0.5, 0.5, 0.0) * 10:
        u = np.array([1.0, turn])
        many, *_, infos = env.step(np.stack((u, u)))
        x, *_, info = single.step(u)
        for k in range(2):
            np.testing.assert_array_equal(many[k], x)
            for key, value in info["safety_filter"].items():
                np.testing.assert_array_equal(infos["safety_filter"][key][k], value)
    assert info["safety_filter"]["intervention"] > 0.1
    env.close()


@needs("jax")
def test_no_torque_takes_the_pole_beyond_its_limit():
    pendulum = load("pendulum")
    env = pendulum.make()
    for torque in (-2.0, 2.0):
        env.reset(seed=0)
        env.unwrapped.state = np.array([-0.2 * np.sign(torque), 1.5 * np.sign(torque)])
        nearest = 0.0
        for _ in range(100):
            env.step(np.array([torque]))
            nearest = max(nearest, abs(env.unwrapped.state[0]))
        assert pendulum.LIMIT - 0.02 < nearest <= pendulum.LIMIT


def test_the_jet_of_a_links_clearance_is_its_derivative():
    arm = load("arm")
    random, step = np.random.default_rng(0), 1e-6
    for link in arm.LINKS:
        clear = arm.Clear("clear", 1, link, (1.0, -0.7, 0.8), 0.4, 0.4)
        for q in random.uniform(-2.0, 2.0, (20, 6)):
            jet = clear.jet(q, 0.7)
            ahead = [clear.h(q + step * axis, 0.7) for axis in np.eye(6)]
            behind = [clear.h(q - step * axis, 0.7) for axis in np.eye(6)]
            slope = (np.array(ahead) - np.array(behind)) / (2.0 * step)
            assert jet.gradient == pytest.approx(slope, abs=1e-5)
            rate = (clear.h(q, 0.7 + step) - clear.h(q, 0.7 - step)) / (2.0 * step)
            assert jet.rate == pytest.approx(rate, abs=1e-5)


def test_the_arm_stays_out_of_the_sphere_of_rank_1_whatever_it_is_told():
    arm = load("arm")
    env = arm.make()
    strict = [barrier for barrier in env.plant.barriers if barrier.priority == 1]
    least, moved = np.inf, False
    q, _ = env.reset(seed=1)
    assert min(barrier.h(q, 0.0) for barrier in strict) > 0.0
    for k in range(400):
        towards = [barrier.jet(q, k * arm.T) for barrier in strict]
        nearest = min(towards, key=lambda jet: jet.h)
        q, _, _, _, info = env.step(-arm.SPEED * np.sign(nearest.gradient))
        least = min(least, *(barrier.h(q, (k + 1) * arm.T) for barrier in strict))
        moved |= bool(info["safety_filter"]["intervention"] > 0.1)
    assert moved
    assert 0.0 <= least < 0.1


def touches(env):
    ground = env.unwrapped.model.geom("ground").id
    return any(c.dist < 0.0 and ground not in c.geom for c in env.unwrapped.data.contact)


@needs("gymnasium_robotics")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["UMaze", "Medium", "Large"])
def test_the_ball_never_touches_a_wall_and_arrives(name):
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


@needs("gymnasium_robotics")
@pytest.mark.filterwarnings("ignore")
def test_the_filters_model_of_the_ball_is_exact():
    env = load("point_maze").make()
    _, info = env.reset(seed=3)
    env.action_space.seed(3)
    for _ in range(100):
        info = env.step(env.action_space.sample())[-1]
    assert info["safety_filter"]["model_error"] < 1e-6


def test_the_page_of_your_own_robot_runs_step_by_step():
    page = (EXAMPLES.parent / "docs" / "your_robot.md").read_text(encoding="utf-8")
    names: dict = {}
    for block in re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL):
        exec(block, names)
    assert np.hypot(names["x"][0] - 3.0, names["x"][1]) < 0.3


@needs("jax")
def test_the_report_says_where_no_input_matters_to_a_function():
    unicycle = load("unicycle")
    env = unicycle.make()
    _, info = env.reset()
    assert (info["safety_filter"]["conditioning"] > 0.1).all()
    at_the_centre = (1.0 - unicycle.AHEAD, 0.0, 0.0)  # there the distance has no slope
    with pytest.warns(UserWarning, match="its gradient is not at"):
        _, info = env.reset(options={"start": at_the_centre})
    assert info["safety_filter"]["h"][0] < 0.0  # inside: the row of a state beside leads out
    assert info["safety_filter"]["status"] == FilterStatus.UNSAFE
