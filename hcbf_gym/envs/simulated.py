"""What every simulated robot has: pushes at its trunk, a load on it, boxes that it may touch."""

import math
from typing import NoReturn

import mujoco
import numpy as np
from numpy.typing import NDArray

from hcbf_gym.arrays import Array
from hcbf_gym.envs import scene
from hcbf_gym.envs.disturbances import Push
from hcbf_gym.errors import InvalidInputError


class Simulated:
    """A scene whose first body is the robot's trunk.

    Attributes:
        model: the compiled scene.
        data: its state.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    _trunk: int
    _boxes: NDArray[np.int64]
    _forces: Array
    _pushes: list[Push]
    _qpos: Array

    def __getstate__(self) -> NoReturn:
        """Refuse copies: their views would still show this simulation's data."""
        raise InvalidInputError("simulation: cannot be copied; construct a new one")

    def push(self, force: Array) -> None:
        """Pull at the trunk's centre of mass with a force (3,) [N] from now on; zeros end it."""
        self.data.xfrc_applied[self._trunk, :3] = force

    @property
    def yaw(self) -> float:
        """Heading of the trunk, without noise [rad]."""
        w, x, y, z = self._qpos[3:7].tolist()
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))

    def obstacle_forces(self) -> Array:
        """Return (k,) the normal force between the robot and each obstacle in the last tick [N]."""
        return self._forces

    def _measure_forces(self) -> Array:
        forces, wrench = np.zeros(len(self._boxes)), np.zeros(6)
        pairs = self.data.contact.geom
        for index in np.flatnonzero(np.isin(pairs, self._boxes).any(axis=1)):
            first, second = pairs[index].tolist()
            box, other = (first, second) if first in self._boxes else (second, first)
            if self.model.body_rootid[self.model.geom_bodyid[other]] == self._trunk:
                mujoco.mj_contactForce(self.model, self.data, int(index), wrench)
                forces[self._boxes == box] += wrench[0]
        return forces

    def _scheduled_force(self) -> Array:
        now = self.data.time
        force = np.zeros(3)
        for push in self._pushes:
            if push.time <= now < push.time + push.duration:
                force += push.force
        return force

    def _load(self, payload: float) -> None:
        body = self.model.body(scene.PAYLOAD).id
        x, y, z = (2.0 * half for half in scene.PAYLOAD_HALF_SIZE)
        self.model.body_mass[body] = payload
        self.model.body_inertia[body] = (
            payload / 12 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])
        )
        mujoco.mj_setConst(self.model, self.data)
