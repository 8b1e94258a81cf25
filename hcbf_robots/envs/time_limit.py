"""A time limit that follows the robot's speed."""

import math
from typing import Any, SupportsFloat

import gymnasium as gym
from gymnasium.core import ActType, ObsType
from gymnasium.utils import RecordConstructorArgs

from hcbf_gym.arrays import Info
from hcbf_gym.envs.task import CONTROL_DT, MAX_EPISODE_STEPS

PATH = {"track": 24.0, "reach": 40.0}
"""The length for which there is time at the robot's greatest speed, by the scene's task [m]: more
than twice the longest path, as guidance alone leads a robot at 0.4 m/s."""


class PacedTimeLimit(gym.Wrapper[ObsType, ActType, ObsType, ActType], RecordConstructorArgs):
    """Truncates a `WalkerRegionsEnv` after the time that the robot takes for `PATH`, 20 s or more.

    The `max_episode_steps` of `gym.make` replaces this limit.
    """

    def __init__(self, env: gym.Env[ObsType, ActType]):
        RecordConstructorArgs.__init__(self)
        super().__init__(env)
        inner: Any = env.unwrapped
        steps = math.ceil(PATH[inner.scenario.task] / inner.fastest / CONTROL_DT)
        given = env.spec is not None and env.spec.max_episode_steps is not None
        self._limit = math.inf if given else max(MAX_EPISODE_STEPS, steps)
        self._done = 0

    def reset(self, **options: Any) -> tuple[ObsType, Info]:
        """Start an episode."""
        self._done = 0
        return self.env.reset(**options)

    def step(self, action: ActType) -> tuple[ObsType, SupportsFloat, bool, bool, Info]:
        """Make a step, the last one where the time is over."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._done += 1
        return observation, reward, terminated, truncated or self._done >= self._limit, info
