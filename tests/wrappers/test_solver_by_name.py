"""A solver by name answers the rows that the compiled programs have: held ones, where held."""

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import wrappers
from hcbf_gym.barriers import Disc, HalfPlane
from hcbf_gym.models.plant import Plant
from hcbf_gym.models.reduced_order import DoubleIntegrator
from hcbf_robots.maps import MapClass
from tests.maps.floors import cells, on_map, room
from tests.worlds import World

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
