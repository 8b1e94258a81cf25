"""A filtered environment under one id, for trainers that are started with an id.

python ppo_continuous_action.py --env-id held_regions:HeldRegions-v0  (CleanRL, from this folder)
python -m rl_zoo3.train --algo ppo --env HeldRegions-v0 --gym-packages held_regions -n 500000
"""

import gymnasium as gym
import numpy as np

import hcbf_gym
from hcbf_gym.wrappers import HoldAction, SafetyFilter


def make(scenario="random", program="lex-cbf-qp", guidance=None, **options):
    """Return the environment: decisions of 0.1 s in [−1, 1], of which the filter sees all steps."""
    env = gym.make("HCBF-Regions-v0", scenario=scenario, **options)
    env = SafetyFilter(env, program, guidance=guidance)
    return HoldAction(gym.wrappers.RescaleAction(env, np.float32(-1), np.float32(1)), 5)


gym.register("HeldRegions-v0", entry_point=make, disable_env_checker=True)

if __name__ == "__main__":
    print(f"hcbf-gym {hcbf_gym.__version__}", gym.spec("HeldRegions-v0"))
