"""Robots that accept velocities: the filter around them, walkers, carts, maps, and a ROS 2 node.

The import registers ``HCBF-WalkerRegions-v0``, maps as scenes, and the floor plans as scenes.
"""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
from gymnasium.envs.registration import WrapperSpec

from hcbf_gym import lazily, scenarios
from hcbf_gym.evaluation import environments
from hcbf_gym.evaluation.environments import Known
from hcbf_robots.maps import floor_plans

if TYPE_CHECKING:
    from hcbf_robots.online import Command, Response, Robot, VelocityFilter
    from hcbf_robots.walkers import Walker

__all__ = ["Command", "Response", "Robot", "VelocityFilter", "Walker"]
_PACKAGES = ("carts", "envs", "identification", "maps", "online", "ros", "walkers")

__getattr__ = lazily.names_of(
    __name__,
    {package: package for package in _PACKAGES}
    | dict.fromkeys(("Command", "Response", "Robot", "VelocityFilter"), "online")
    | {"Walker": "walkers"},
)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_PACKAGES})


def _files(options: Mapping[str, Any]) -> list[Path]:
    """Return the files that define the walker of an environment with these options."""
    from hcbf_robots.walkers.walker import Walker  # imports MuJoCo, so not with the package

    return Walker.load(options["robot"]).files


scenarios.register_floors(floor_plans.described, floor_plans.through)
for plan in floor_plans.NAMES:
    draw, load = partial(floor_plans.draw, plan), partial(floor_plans.load, plan)
    scenarios.register(f"map-{plan}", draw, shapes=0, floor=load)
gym.register(
    id="HCBF-WalkerRegions-v0",
    entry_point="hcbf_robots.envs:WalkerRegionsEnv",
    additional_wrappers=(
        WrapperSpec("PacedTimeLimit", "hcbf_robots.envs.time_limit:PacedTimeLimit", {}),
    ),
)
environments.register("HCBF-WalkerRegions-v0", Known(None, ("robot", "body", "v_max"), _files))
