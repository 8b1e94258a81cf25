"""A time limit that follows the robot's speed."""

import math
from typing import Any, SupportsFloat

import gymnasium as gym
from gymnasium.core import ActType, ObsType
from gymnasium.utils import RecordConstructorArgs

from hcbf_gym.arrays import Info
from hcbf_gym.envs.task import CONTROL_DT, MAX_EPISODE_STEPS

TIMED_PATH = {"track": 24.0, "reach": 40.0}
"""Task of the scene → path for which there is time at the robot's greatest speed [m]: more than
twice the longest one, because guidance alone leads a robot at 0.4 m/s."""


class PacedTimeLimit(gym.Wrapper[ObsType, ActType, ObsType, ActType], RecordConstructorArgs):
    """Truncates a `WalkerRegionsEnv` after the time that `TIMED_PATH` takes, and at least 20 s.

    The `max_episode_steps` of `gym.make` replaces this limit.
    """

    def __init__(self, env: gym.Env[ObsType, ActType]):
        RecordConstructorArgs.__init__(self)
        super().__init__(env)
        walker_env: Any = env.unwrapped
        path = TIMED_PATH[walker_env.scenario.task]
        steps = math.ceil(path / walker_env.fastest / CONTROL_DT)
        has_own_limit = env.spec is not None and env.spec.max_episode_steps is not None
        self._limit = math.inf if has_own_limit else max(MAX_EPISODE_STEPS, steps)
        self._steps = 0

    def reset(self, **options: Any) -> tuple[ObsType, Info]:
        """Start an episode."""
        self._steps = 0
        return self.env.reset(**options)

    def step(self, action: ActType) -> tuple[ObsType, SupportsFloat, bool, bool, Info]:
        """Make a step; it is the last one when the time is over."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._steps += 1
        return observation, reward, terminated, truncated or self._steps >= self._limit, info
