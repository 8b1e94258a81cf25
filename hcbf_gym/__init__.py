"""hcbf-gym: safety filters that know priorities, for any policy, on a walking robot."""

import gymnasium as gym

from hcbf_gym import compilation
from hcbf_gym.drawing.headless import prefer_egl

compilation.prepare()  # before anything compiles
prefer_egl()  # before anything imports MuJoCo

from hcbf_gym import policies, programs, scenarios, wrappers  # noqa: E402
from hcbf_gym.errors import HcbfError  # noqa: E402
from hcbf_gym.models.plant import Estimate, Plant  # noqa: E402

__version__ = "0.1.0"
__all__ = [
    "Estimate",
    "HcbfError",
    "Plant",
    "__version__",
    "policies",
    "programs",
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
