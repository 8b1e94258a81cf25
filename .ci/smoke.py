"""What an installation can do, in seconds: a filter beside wheels, and every robot it has.

    python .ci/smoke.py [--light]

With --light, MuJoCo and Pinocchio are missing, and what needs them names the line that installs it.
"""

import importlib.metadata
import platform
import sys

import gymnasium as gym
import numpy as np

import hcbf_gym
import hcbf_robots
from hcbf_gym.barriers import Disc

SHOWN = ("numpy", "scipy", "gymnasium", "mujoco", "pin")
STEPS = 25


def version(package: str) -> str:
    """Return which version is installed, or that there is none."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "-"


def drive() -> None:
    """Filter a typed cart that heads for a pillar: it slows down, and stays outside."""
    robot = hcbf_robots.Robot(hcbf_robots.Command(forward=1.0, turn=1.0, look_ahead=0.2))
    pillar = Disc("pillar", 1, center=(3.0, 0.0), radius=0.5)
    velocity_filter = hcbf_robots.VelocityFilter(robot, [pillar])
    x, chosen = 0.0, np.zeros(2)
    for k in range(300):
        twist = (chosen[0], 0.0, 0.0)
        chosen, report = velocity_filter.step((1.0, 0.0), (x, 0.0, 0.0), twist, 0.05 * k)
        x += 0.05 * chosen[0]
    assert 1.0 < x < 2.5, (x, report)  # of its axle, before the edge


def walk(name: str, **options: str) -> None:
    """Step an environment behind the filter."""
    env = hcbf_gym.wrappers.SafetyFilter(gym.make(name, disable_env_checker=True, **options))
    policy = hcbf_gym.policies.PDTracker.for_env(env)
    observation, info = env.reset(seed=0)
    for _ in range(STEPS):
        observation, _, _, _, info = env.step(policy(observation, info))
    assert info["safety_filter"]["status"] < hcbf_gym.programs.FilterStatus.BACKUP, info


def refused(name: str, package: str) -> None:
    """Check that what is missing is named with the line that installs it."""
    message = ""
    try:
        gym.make(name)
    except hcbf_gym.HcbfError as error:
        message = str(error)
    assert f"pip install '{package}" in message, f"{name}: {message!r}"


light = sys.argv[1:] == ["--light"]
drive()
walk("HCBF-Regions-v0", scenario="random")
if light or version("mujoco") == "-":
    refused("HCBF-WalkerRegions-v0", "mujoco")
    done = "filter, reduced order"
else:
    walk("HCBF-WalkerRegions-v0", robot="cart")
    done = "filter, reduced order, cart"
if light or version("pin") == "-":
    refused("HCBF-A1Regions-v0", "mujoco" if version("mujoco") == "-" else "pin")
else:
    walk("HCBF-A1Regions-v0", scenario="random")
    done += ", A1"
shown = " | ".join(version(package) for package in SHOWN)
print(f"| {platform.python_version()} | {shown} | {done} |")
