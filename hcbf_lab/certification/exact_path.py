"""h of the reduced-order robot at every millisecond, on its exact path between two samples."""

from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from gymnasium.core import ActType, ObsType

from hcbf_gym.arrays import Array, Info
from hcbf_gym.envs.task import CONTROL_DT

INSTANTS: Array = np.arange(1, 21) * np.float64(CONTROL_DT / 20)
"""(20,) of one control step, a millisecond apart [s]."""


class EachMillisecond(gym.Wrapper[ObsType, ActType, ObsType, ActType]):
    """Adds to ``info["min_h"]`` of `RegionsEnv` the least of every millisecond.

    Under a held u the robot's path is ``p(s) = p + v s + u s² / 2``, and u is ``(v' − v) / T``.
    """

    def step(self, action: ActType) -> tuple[ObsType, SupportsFloat, bool, bool, Info]:
        """Step, and evaluate h along the path between the two states."""
        inner: Any = self.env.unwrapped
        x, time = inner.truth, inner.time
        observation, reward, terminated, truncated, info = self.env.step(action)
        u = (inner.truth[2:] - x[2:]) / CONTROL_DT
        s = INSTANTS[:, None]
        path = np.hstack([x[:2] + x[2:] * s + 0.5 * u * s * s, x[2:] + u * s])
        h = inner.barrier_set.along(path, time + INSTANTS).min(axis=0)
        info["min_h"] = np.minimum(info["min_h"], h)
        return observation, reward, terminated, truncated, info
