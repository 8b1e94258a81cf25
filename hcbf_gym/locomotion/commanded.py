"""The package's own A1 as a robot that takes velocities: the controller behind a contract."""

import math
from collections.abc import Callable

import mujoco
import numpy as np

from hcbf_gym.locomotion.controller import LocomotionController
from hcbf_gym.locomotion.state import STATE_SIZE, Array, RobotState
from hcbf_gym.robots import a1

HARDEST = 5.0
"""Of each component of the acceleration that takes up a command [m/s²]."""


def make(model: mujoco.MjModel, period: float) -> Callable[[Array], Array]:
    """Return a controller that turns state, contacts and a command into the joints' torques.

    The observation is MuJoCo's qpos (19,) and qvel (18,), the feet's contacts (4,) and the command
    (v_x, v_y, ω). The trunk heads along its velocity by itself, so that ω is not read.

    Args:
        model: the compiled scene, which the controller does not look at.
        period: of the controller [s].
    """
    return _Commanded(period)


class _Commanded:
    """One episode's controller."""

    def __init__(self, period: float):
        self._controller = LocomotionController(a1.XML_FILE, timestep=period)
        self._period, self._began = period, False

    def __call__(self, observation: Array) -> Array:
        """Return (12,) torques [N·m]."""
        state = RobotState(observation[:STATE_SIZE].copy())
        if not self._began:
            self._controller.reset(state)
            self._began = True
        w, x, y, z = observation[3:7].tolist()
        yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        ahead, aside, _ = observation[STATE_SIZE:].tolist()
        cos, sin = math.cos(yaw), math.sin(yaw)
        told = np.array([cos * ahead - sin * aside, sin * ahead + cos * aside])
        u = (told - self._controller.reference.velocity) / self._period
        return self._controller.step(state, np.clip(u, -HARDEST, HARDEST))
