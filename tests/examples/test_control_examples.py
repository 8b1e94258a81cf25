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


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["PointMaze_UMaze-v3", "PointMaze_Medium-v3"])
def test_the_ball_touches_walls_without_the_filter_and_never_with_it(name):
    pytest.importorskip("gymnasium_robotics")
    point_maze = load("point_maze")
    env = point_maze.make(name)
    counts = {}
    for which in (env, env.env):
        which.reset(seed=3)
        touched = 0
        for k in range(200):
            push = [(1, 1), (-1, 1), (-1, -1), (1, -1)][(k // 50) % 4]
            which.step(np.array(push, dtype=np.float32))
            touched += point_maze.touches(which)
        counts[which is env] = touched
    assert counts[False] > 0
    assert counts[True] == 0
