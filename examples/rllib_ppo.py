"""RLlib's PPO for a few iterations on the filtered environment; needs the extra `rllib`."""

import sys

import gymnasium as gym
import numpy as np
from ray.rllib.algorithms.ppo import PPOConfig
from ray.tune.registry import register_env

from hcbf_gym.wrappers import HoldAction, SafetyFilter


def make(config: dict[str, str]) -> gym.Env:
    """Return the environment that each of RLlib's workers steps."""
    env = gym.make("HCBF-Regions-v0", scenario=config["scenario"])
    env = SafetyFilter(env, program=config["program"])
    return HoldAction(gym.wrappers.RescaleAction(env, np.float32(-1), np.float32(1)), 5)


register_env("filtered-regions", make)
config = (
    PPOConfig()
    .environment("filtered-regions", env_config={"scenario": "random", "program": "lex-cbf-qp"})
    .env_runners(num_env_runners=0, num_envs_per_env_runner=4)
    .training(train_batch_size=2000, minibatch_size=500, num_epochs=5, gamma=0.99)
    .debugging(seed=0)
)
algorithm = config.build_algo()
for iteration in range(int(sys.argv[1]) if len(sys.argv) > 1 else 20):
    runs = algorithm.train()["env_runners"]
    mean = runs.get("episode_return_mean")  # absent until an episode has ended
    print(iteration, "decisions", runs["num_env_steps_sampled_lifetime"], "mean return", mean)
algorithm.stop()
