"""Gates in a corridor, a user's family of random scenes with its own reward.

`hcbf evaluate --env HCBF-Regions-v0 --scenario own_family.py:gates --episodes 5`
"""

import gymnasium as gym
import numpy as np

import hcbf_gym
from hcbf_gym.scenarios import BOX, DISC, HALF_PLANE, Hooks, Scene

GATES = 3


def draw(generator: np.random.Generator, scene: Scene) -> None:
    for k, side in enumerate((1.0, -1.0)):
        scene.shapes[k, :4] = HALF_PLANE, 0.0, side, -2.0  # unit normal into the corridor, offset
    for k in range(GATES):
        x, middle = 2.5 * (k + 1), generator.uniform(-0.8, 0.8)
        for post, side in ((2 + 2 * k, 1.0), (3 + 2 * k, -1.0)):
            y = middle + side * 1.6  # half of a post is 1 m long: the gate is 1.2 m wide
            scene.shapes[post] = BOX, x, y, 1.0, 0.15, np.pi / 2.0
    scene.shapes[-1, :4] = DISC, *generator.uniform((1.0, -1.0), (8.0, 1.0)), 0.4  # a puddle
    scene.ranks[-1], scene.velocities[-1] = 2, generator.uniform(-0.1, 0.1, 2)
    scene.goal[:] = 2.5 * GATES + 1.5, 0.0


def reward(moment):
    return moment.x[:, 0] - moment.before[:, 0]  # [m] along the corridor


hcbf_gym.scenarios.register("gates", draw, shapes=3 + 2 * GATES, hooks=Hooks(reward=reward))

if __name__ == "__main__":
    envs = gym.make_vec("HCBF-Regions-v0", num_envs=256, scenario="gates")
    envs = hcbf_gym.wrappers.VectorSafetyFilter(envs, guidance="geodesic")
    policy, (observation, info) = hcbf_gym.policies.PDTracker.for_env(envs), envs.reset(seed=0)
    for _ in range(600):
        observation, *_, info = envs.step(policy(observation, info))
    print("environments with an entry into rank 1 in the last step:", int(info["cost"].sum()))
