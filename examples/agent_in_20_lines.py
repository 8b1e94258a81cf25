"""Your agent under the filter: it learns on the reduced-order robots, then walks the A1."""

import gymnasium as gym
import numpy as np
from stable_baselines3 import PPO

from hcbf_gym.wrappers import SafetyFilter, VectorHoldAction, VectorSafetyFilter
from hcbf_gym.wrappers.sb3 import Sb3VecEnv

robots = gym.make_vec("HCBF-Regions-v0", num_envs=256, scenario="random", autoreset_mode="Disabled")
robots = VectorSafetyFilter(robots, program="lex-cbf-qp")
robots = Sb3VecEnv(VectorHoldAction(robots, 5, "Disabled"))
agent = PPO("MlpPolicy", robots, n_steps=64, batch_size=2048, n_epochs=5, seed=0, device="cpu")
agent.learn(1_000_000)

a1 = SafetyFilter(gym.make("HCBF-A1Regions-v0", scenario="random"), program="lex-cbf-qp")
a1 = gym.wrappers.RescaleAction(a1, np.float32(-1), np.float32(1))  # as the agent acts
observation, info = a1.reset(seed=0)
least, ended = info["min_h"], False
while not ended:
    action, _ = agent.predict(observation, deterministic=True)
    observation, reward, terminated, truncated, info = a1.step(action)
    least, ended = least.clip(max=info["min_h"]), terminated or truncated
print("goal reached:", bool(terminated and not info["fallen"]), "  least h:", least.round(2))
