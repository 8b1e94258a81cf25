"""An episode in a plain loop, beside which commands are judged."""

import numpy as np


def by_hand(env, policy, seed, steps):
    """Return the sum of rewards of an episode, and the root mean square of ‖u − u*‖."""
    observation, info = env.reset(seed=seed)
    total, changes = 0.0, []
    for _ in range(steps):
        observation, reward, terminated, truncated, info = env.step(policy(observation, info))
        total += reward
        changes.append(float(info["safety_filter"]["intervention"]))
        if terminated or truncated:
            break
    return total, float(np.sqrt(np.mean(np.square(changes))))
