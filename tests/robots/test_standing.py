"""A cap under which a robot hardly moves is warned of, however it is set."""

import shutil
import warnings
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import pytest

import hcbf_robots
from hcbf_gym.barriers import Disc
from hcbf_gym.errors import SafetyWarning
from hcbf_robots import Command, Response, Robot, VelocityFilter, Walker
from hcbf_robots.walkers.walker_response import assumed

CARTS = Path(hcbf_robots.__file__).parent / "carts"
FAR = Disc("far", 1, center=(500.0, 500.0), radius=1.0)
COMMAND = Command(forward=1.0, turn=1.0, sideways=1.0)
EXACT = replace(assumed(COMMAND), residual=(0.01, 0.02, 0.03), overshoot=0.02)


def by_environment(response, v_max, folder):
    for name in ("holonomic-cart.xml", "holonomic-cart.json"):
        shutil.copy(CARTS / name, folder / name)
    response.save(folder / "holonomic-cart.response.json")
    robot = str(folder / "holonomic-cart.json")
    gym.make("hcbf_robots:HCBF-WalkerRegions-v0", robot=robot, v_max=v_max).close()


def by_velocity_filter(response, v_max, folder):
    command = Walker.load("holonomic-cart").command
    VelocityFilter(Robot(command, response, reach=0.3), [FAR], v_max=v_max)


def by_setting(response, v_max, folder):
    command = Walker.load("holonomic-cart").command
    VelocityFilter(Robot(command, response, reach=0.3), [FAR]).v_max = v_max


@pytest.mark.filterwarnings("ignore::hcbf_gym.errors.CoverageWarning")
@pytest.mark.parametrize("build", [by_environment, by_velocity_filter, by_setting])
def test_a_cap_that_leaves_nothing_at_the_usual_error_is_warned_of(build, tmp_path):
    slow: Response = replace(EXACT, residual=(0.9, 1.0, 1.1))
    with pytest.warns(SafetyWarning, match=r"v_max: 0\.6 m/s .* hardly moves; expected above"):
        build(slow, 0.6, tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error", SafetyWarning)
        build(EXACT, 0.6, tmp_path)
