"""What an installation needs: nothing heavy before it is used, and a light one without robots."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HEAVY = ("mujoco", "pinocchio", "matplotlib", "PIL", "jax", "torch")
"""What may be missing where a filter runs."""


def run(code, *missing):
    """Run code in a new process in which some modules cannot be imported."""
    blocked = f"import sys; sys.modules.update(dict.fromkeys({missing!r}))\n"
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", blocked + code],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_the_package_alone_loads_nothing_heavy():
    loaded = set(run("import hcbf_gym; print(*sys.modules)"))
    assert not loaded & {*HEAVY, "daqp", "clarabel", "qpsolvers", "joblib", "rich", "tyro"}
    assert "hcbf_gym.wrappers" not in loaded


def test_every_public_name_is_found():
    run("import hcbf_gym as h; [getattr(h, name) for name in dir(h)]; assert h.barriers.Disc")
    run("from hcbf_gym import *; from hcbf_gym.envs import *; from hcbf_gym.robots import *")


@pytest.mark.physics
def test_a_velocity_filter_needs_neither_mujoco_nor_pictures():
    code = """
import hcbf_gym
import hcbf_robots
from hcbf_gym.barriers import Disc
robot = hcbf_robots.Robot(hcbf_robots.Command(forward=1.0, turn=1.0, look_ahead=0.2))
safe = hcbf_robots.VelocityFilter(robot, [Disc("pillar", 1, center=(2.0, 0.0), radius=0.5)])
print(safe.step((0.5, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)[0][0] > 0.0)
"""
    assert run(code, *HEAVY) == ["True"]


@pytest.mark.physics
def test_the_reduced_order_environment_needs_neither_mujoco_nor_pictures():
    code = """
import gymnasium as gym, numpy as np, hcbf_gym
env = gym.make("HCBF-Regions-v0", scenario="random")
env = hcbf_gym.wrappers.SafetyFilter(env, guidance="geodesic")
env.reset(seed=0)
print(env.step(np.zeros(2))[4]["safety_filter"]["status"] < 4)
import hcbf_gym.programs.qp
"""
    assert run(code, *HEAVY) == ["True"]


@pytest.mark.physics
def test_a_cart_needs_no_pinocchio():
    code = """
import gymnasium as gym, numpy as np, hcbf_gym
env = gym.make("hcbf_robots:HCBF-WalkerRegions-v0", robot="cart")
env.reset(seed=0)
env.step(np.zeros(2))
"""
    run(code, "pinocchio")


@pytest.mark.parametrize(
    ("call", "line"),
    [
        ("gym.make('HCBF-A1Regions-v0')", "pip install 'mujoco>=3.11' 'pin>=4.0'"),
        ("gym.make('hcbf_robots:HCBF-WalkerRegions-v0')", "pip install 'mujoco>=3.11'"),
        ("hcbf_robots.VelocityFilter('cart', [])", "pip install 'mujoco>=3.11'"),
        ("hcbf_gym.barriers.Function('f', 1, lambda x, t: x[0])", "-e '.[jax]'"),
    ],
)
def test_what_is_missing_is_named_with_a_line_that_works(call, line):
    code = f"""
import gymnasium as gym, hcbf_gym, hcbf_gym.barriers, hcbf_robots
try:
    {call}
except hcbf_gym.HcbfError as error:
    assert {line!r} in str(error), error
else:
    raise AssertionError("was made")
"""
    run(code, *HEAVY)


def test_the_light_installation_is_the_base_without_robots():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = (ROOT / "requirements-light.txt").read_text(encoding="utf-8").splitlines()
    light = [line for line in lines if line and not line.startswith("#")]
    robots = ("mujoco", "pin>")
    assert light == [one for one in project["dependencies"] if not one.startswith(robots)]
