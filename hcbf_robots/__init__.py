"""What upper packages register in the lower one: maps, floor plans, robots that take velocities."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import WrapperSpec

from hcbf_gym import scenarios
from hcbf_gym.errors import require_packages
from hcbf_gym.evaluation import environments
from hcbf_gym.evaluation.environments import Known
from hcbf_robots.maps import floor_plans

scenarios.register_floors(floor_plans.described, floor_plans.through)
for plan in floor_plans.NAMES:
    draw, load = partial(floor_plans.draw, plan), partial(floor_plans.load, plan)
    scenarios.register(f"map-{plan}", draw, shapes=0, floor=load)


def _files(options: Mapping[str, Any]) -> list[Path]:
    """Return the files of a walker's contract."""
    from hcbf_robots.walkers.walker import Walker  # MuJoCo, only where one runs

    return Walker.load(options["robot"]).files


gym.register(
    id="HCBF-WalkerRegions-v0",
    entry_point="hcbf_robots:WalkerRegionsEnv",
    additional_wrappers=(
        WrapperSpec("PacedTimeLimit", "hcbf_robots.envs.time_limit:PacedTimeLimit", {}),
    ),
)
environments.register("HCBF-WalkerRegions-v0", Known(None, ("robot", "body", "v_max"), _files))


def __getattr__(name: str) -> Any:
    if name != "WalkerRegionsEnv":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    require_packages(name, "mujoco")
    from hcbf_robots.envs.walker_regions import WalkerRegionsEnv

    return WalkerRegionsEnv
