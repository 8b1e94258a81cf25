"""A time limit that follows the robot's speed."""

import math
from typing import Any, SupportsFloat

import gymnasium as gym
from gymnasium.core import ActType, ObsType
from gymnasium.utils import RecordConstructorArgs

from hcbf_gym.arrays import Info
from hcbf_gym.envs.task import CONTROL_DT, MAX_EPISODE_STEPS

WAY = {"track": 24.0, "reach": 40.0}
"""For which there is time at the robot's greatest speed, by the scene's task [m]: more than twice
the longest way, as guidance leads a robot that does not reach for the goal itself at .4 m/s."""


class PacedTimeLimit(gym.Wrapper[ObsType, ActType, ObsType, ActType], RecordConstructorArgs):
    """Truncates after `steps(fastest, task)`, so many as leave the robot time for its way.

    Where `gym.make` was given `max_episode_steps`, its limit alone
    counts.

    Args:
        env: of `WalkerRegionsEnv`.
    """

    def __init__(self, env: gym.Env[ObsType, ActType]):
        RecordConstructorArgs.__init__(self)
        super().__init__(env)
        given = env.spec is not None and env.spec.max_episode_steps is not None
        inner: Any = env.unwrapped
        self._limit = math.inf if given else steps(inner.fastest, inner.scenario.task)
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


def steps(fastest: float, task: str) -> int:
    """Return the time limit of a robot of some speed [steps].

    Args:
        fastest: the greatest speed that its rows leave it [m/s].
        task: of the scene, "track" or "reach".
    """
    return max(MAX_EPISODE_STEPS, math.ceil(WAY[task] / fastest / CONTROL_DT))
