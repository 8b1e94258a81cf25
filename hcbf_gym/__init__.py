"""hcbf-gym.

A prioritised control-barrier-function (CBF) safety filter for Gymnasium and for robots: rank 1 is
never violated, lower ranks are relaxed in order; with environments in which a Unitree A1 walks
through ranked regions.
"""

from typing import TYPE_CHECKING

import gymnasium as gym

from hcbf_gym import lazily, sources, version
from hcbf_gym.drawing.headless import prefer_egl

sources.check()  # before anything calls the core
prefer_egl()  # before anything imports MuJoCo

from hcbf_gym.errors import HcbfError  # noqa: E402

if TYPE_CHECKING:
    from hcbf_gym import policies, programs, robots, scenarios, wrappers
    from hcbf_gym.filter.batch_filter import BatchFilter
    from hcbf_gym.models.plant import Estimate, Plant

__version__ = version.VERSION
__all__ = [
    "BatchFilter",
    "Estimate",
    "HcbfError",
    "Plant",
    "__version__",
    "policies",
    "programs",
    "robots",
    "scenarios",
    "wrappers",
]
_PACKAGES = (
    "barriers", "certificates", "drawing", "envs", "estimation", "evaluation", "filter",
    "guidance", "models", "policies", "programs", "robots", "scenarios", "wrappers",
)  # fmt: skip

__getattr__ = lazily.names_of(
    __name__,
    {package: package for package in _PACKAGES}
    | dict.fromkeys(("Estimate", "Plant"), "models.plant")
    | {"BatchFilter": "filter.batch_filter"},
)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_PACKAGES})


gym.register(
    id="HCBF-Regions-v0",
    entry_point="hcbf_gym.envs:RegionsEnv",
    vector_entry_point="hcbf_gym.envs:RegionsVectorEnv",
    max_episode_steps=1000,
)
gym.register(
    id="HCBF-A1Regions-v0",
    entry_point="hcbf_gym.envs:A1RegionsEnv",
    max_episode_steps=1000,
)
