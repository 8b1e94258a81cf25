"""hcbf-gym: safety filters that know priorities, for any policy, on a walking robot."""

import gymnasium as gym

from hcbf_gym import compilation
from hcbf_gym.drawing.headless import prefer_egl

compilation.prepare()  # before anything compiles
prefer_egl()  # before anything imports MuJoCo

from hcbf_gym import policies, programs, robots, scenarios, wrappers  # noqa: E402
from hcbf_gym.errors import HcbfError  # noqa: E402
from hcbf_gym.filtering.batch_filter import BatchFilter  # noqa: E402
from hcbf_gym.models.plant import Estimate, Plant  # noqa: E402
from hcbf_gym.online import VelocityFilter  # noqa: E402

__version__ = "0.2.0"
__all__ = [
    "BatchFilter",
    "Estimate",
    "HcbfError",
    "Plant",
    "VelocityFilter",
    "__version__",
    "policies",
    "programs",
    "robots",
    "scenarios",
    "wrappers",
]

gym.register(
    id="HCBF-Regions-v0",
    entry_point="hcbf_gym.envs.regions:RegionsEnv",
    vector_entry_point="hcbf_gym.envs.regions_vector:RegionsVectorEnv",
    max_episode_steps=1000,
)
gym.register(
    id="HCBF-A1Regions-v0",
    entry_point="hcbf_gym.envs.a1_regions:A1RegionsEnv",
    max_episode_steps=1000,
)
gym.register(
    id="HCBF-WalkerRegions-v0",
    entry_point="hcbf_gym.envs.walker_regions:WalkerRegionsEnv",
    max_episode_steps=1000,
)
