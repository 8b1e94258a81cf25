"""Stable-Baselines3's EvalCallback counts how many evaluations reach the goal.

pip install -c constraints.txt -e ".[rl]"
"""

import gymnasium as gym
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.monitor import Monitor

from hcbf_gym.wrappers import HoldAction, SafetyFilter, VectorHoldAction, VectorSafetyFilter
from hcbf_gym.wrappers.sb3 import Sb3VecEnv


def single():
    """Return one environment that decides every 0.1 s, in [−1, 1]."""
    env = SafetyFilter(gym.make("HCBF-Regions-v0", scenario="random"), "lex-cbf-qp")
    return Monitor(HoldAction(gym.wrappers.RescaleAction(env, np.float32(-1), np.float32(1)), 5))


def native(n):
    """Return n of them in one."""
    env = gym.make_vec("HCBF-Regions-v0", num_envs=n, scenario="random", autoreset_mode="Disabled")
    return Sb3VecEnv(VectorHoldAction(VectorSafetyFilter(env, "lex-cbf-qp"), 5, "Disabled"))


def train(decisions=500_000, n=64, every=100_000, episodes=20):
    """Return the callback after training: its successes are booleans, one for each episode."""
    agent = PPO("MlpPolicy", native(n), n_steps=64, batch_size=n * 16, seed=0, device="cpu")
    evaluation = EvalCallback(
        single(), eval_freq=every // n, n_eval_episodes=episodes, log_path="results/sb3", verbose=0
    )
    agent.learn(decisions, evaluation)
    return evaluation


if __name__ == "__main__":
    train()
    log = np.load("results/sb3/evaluations.npz")
    for steps, successes in zip(log["timesteps"], log["successes"], strict=True):
        print(steps, "decisions:", f"{100.0 * np.mean(successes):.0f} % reach the goal")
