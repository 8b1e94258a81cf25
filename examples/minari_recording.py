"""Episodes of a policy under the filter as a Minari data set, with everything the infos say.

pip install "minari[hdf5,create]"
"""

import gymnasium as gym
import minari

from hcbf_gym.policies import PDTracker
from hcbf_gym.wrappers import SafetyFilter

EPISODES = 2

env = SafetyFilter(gym.make("HCBF-Regions-v0", scenario="random"), program="lex-cbf-qp")
policy, spec = PDTracker.for_env(env), env.spec
env = minari.DataCollector(env, record_infos=True)
for seed in range(EPISODES):
    observation, info = env.reset(seed=seed)
    ended = False
    while not ended:
        action = policy(observation, info)
        observation, reward, terminated, truncated, info = env.step(action)
        ended = terminated or truncated
dataset = env.create_dataset("hcbf/regions-pd-v0", algorithm_name="PD under lex-cbf-qp")

for episode in dataset.iterate_episodes():
    report = episode.infos["safety_filter"]
    assert len(report["status"]) == len(episode.actions) + 1  # the reset's report comes first
    print(len(episode.actions), "steps, greatest intervention", report["intervention"].max())
assert dataset.recover_environment().spec == spec  # the filter included
