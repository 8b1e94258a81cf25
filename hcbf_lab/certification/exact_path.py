"""Least h of the reduced-order robot over every millisecond of its exact path in a step."""

from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from gymnasium.core import ActType, ObsType

from hcbf_gym.arrays import Array, Info
from hcbf_gym.envs.task import CONTROL_DT

INSTANTS: Array = np.arange(1, 21) * np.float64(CONTROL_DT / 20)
"""(20,) instants of one control step, a millisecond apart [s]."""


class EachMillisecond(gym.Wrapper[ObsType, ActType, ObsType, ActType]):
    """Lowers ``info["min_h"]`` of `RegionsEnv` to the least h at each of `INSTANTS`.

    Under a held u the path is ``p(s) = p + v s + u s² / 2``. The step ends with the velocity v', so
    that ``u = (v' − v) / T``.
    """

    def step(self, action: ActType) -> tuple[ObsType, SupportsFloat, bool, bool, Info]:
        """Step the environment, and evaluate h along the path between its two states."""
        inner: Any = self.env.unwrapped
        x, time = inner.truth, inner.time
        observation, reward, terminated, truncated, info = self.env.step(action)
        position, velocity = x[:2], x[2:]
        u = (inner.truth[2:] - velocity) / CONTROL_DT
        s = INSTANTS[:, None]
        path = np.hstack([position + velocity * s + 0.5 * u * s * s, velocity + u * s])
        h = inner.barrier_set.along(path, time + INSTANTS).min(axis=0)
        info["min_h"] = np.minimum(info["min_h"], h)
        return observation, reward, terminated, truncated, info
