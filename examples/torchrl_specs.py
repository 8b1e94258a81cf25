"""The filtered environment in TorchRL: its specs hold, and infos travel with the data.

pip install torchrl
"""

import gymnasium as gym
import torch
from torchrl.data import Unbounded
from torchrl.envs import GymWrapper, default_info_dict_reader
from torchrl.envs.utils import check_env_specs

import hcbf_gym.envs  # noqa: F401 - registers the environments
from hcbf_gym.wrappers import HoldAction, SafetyFilter

INFOS = ("cost", "is_success")

env = SafetyFilter(gym.make("HCBF-Regions-v0", scenario="random"), program="lex-cbf-qp")
env = GymWrapper(HoldAction(env, 5))
number = Unbounded(shape=(), dtype=torch.float64)
env.set_info_dict_reader(default_info_dict_reader(list(INFOS), spec=[number] * len(INFOS)))
check_env_specs(env)
env.set_seed(0)
data = env.rollout(50)["next"]
print("reward", float(data["reward"].sum()), "cost", float(data["cost"].sum()))
