"""The six-value step that safe-RL libraries expect."""

from typing import Any

import gymnasium as gym
from gymnasium.utils import RecordConstructorArgs


class CostStep(gym.Wrapper, RecordConstructorArgs):
    """Returns ``info["cost"]`` between the reward and the ends, as Safety-Gymnasium does.

    ``observation, reward, cost, terminated, truncated, info = env.step(action)``; no longer a
    Gymnasium environment, so it must be the outermost wrapper.

    Args:
        env: an environment of this package, filtered or not.

    Source: Ji et al., Safety-Gymnasium, NeurIPS 2023.
    """

    def __init__(self, env: gym.Env):
        RecordConstructorArgs.__init__(self)
        gym.Wrapper.__init__(self, env)

    def step(self, action: Any) -> Any:
        """Step the environment and return six values."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, info["cost"], terminated, truncated, info
