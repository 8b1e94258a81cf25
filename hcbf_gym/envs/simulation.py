"""A MuJoCo scene with one robot: its random conditions, pushes, delays and contacts."""

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, NoReturn

import mujoco
import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.envs import scene
from hcbf_gym.envs.disturbances import Push, disturbance_from_dict
from hcbf_gym.envs.randomization import PlantConditions, Randomization
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.robots.body_points import stand
from hcbf_gym.robots.reader import compile_spec
from hcbf_gym.scenarios import BoxObstacle

BASE_SIZE = 13  # a trunk's position (3), quaternion (4), velocity (3) and turning rate (3)


class SimulatedRobot(NamedTuple):
    """The robot that a simulation puts into its scene."""

    spec: mujoco.MjSpec  # the robot alone, whose first body is the trunk, with its options
    source: str | Path  # the robot's file, for messages
    trunk: str  # name of the robot's first body
    home_joints: Array  # (j,) joint angles at the start [rad]
    height: float  # height of the trunk above flat ground at the start [m]
    inputs: int  # number of inputs that a step takes
    least_upright: float  # cosine of the trunk's tilt below which the robot has fallen
    least_height: float  # height of the trunk below which the robot has fallen [m]
    floor_decides: bool  # whether contacts have the floor's friction alone


class Simulation(ABC):
    """A scene with one robot, stepped one physics tick at a time.

    Args:
        robot: the robot in the scene.
        randomization: the ranges from which the conditions of every episode are drawn.
        obstacles: boxes on the ground, see `scene.add_boxes`.
        terrain: "flat", or "rough" with blind steps of at most 3 cm.
        disturbances: plain dict of pushes, see `disturbance_from_dict`; None is calm.

    Attributes:
        model: the compiled scene.
        data: the state of the scene.
        trunk: name of the robot's first body.
        home_joints: (j,) joint angles of the robot at the start [rad].
        conditions: the plant's conditions in this episode.
    """

    def __init__(
        self,
        robot: SimulatedRobot,
        randomization: Randomization,
        obstacles: Sequence[BoxObstacle],
        terrain: str,
        disturbances: Mapping[str, object] | None,
    ) -> None:
        self._disturbance = disturbance_from_dict(disturbances)
        self._randomization = randomization
        self._has_payload = randomization.payload[1] > 0.0
        spec = robot.spec
        scene.add_ground(spec, terrain, robot.floor_decides)
        scene.add_boxes(spec, obstacles)
        if self._has_payload:
            scene.add_payload(spec, randomization.payload_position, robot.trunk)
        # by default MuJoCo resets a diverged state silently; here `diverged` has to report it
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.model = compile_spec(spec, robot.source)
        self.data = mujoco.MjData(self.model)
        self.trunk, self.home_joints = robot.trunk, robot.home_joints
        self._trunk_id = self.model.body(robot.trunk).id
        self._boxes = np.array([self.model.geom(box.name).id for box in obstacles], dtype=np.int64)
        self._forces = np.zeros(len(self._boxes))  # with each box, in the last tick [N]
        self._height = robot.height + (scene.ROUGH_STEP if terrain == "rough" else 0.0)
        self._inputs = robot.inputs
        self._least_upright, self._least_height = robot.least_upright, robot.least_height
        # the robot comes first in the scene, so these are its own
        joints = len(robot.home_joints)
        self._qpos, self._qvel = self.data.qpos[: 7 + joints], self.data.qvel[: 6 + joints]
        self._pose, self._twist = self.data.qpos[:7], self.data.qvel[:6]
        self._rng = np.random.default_rng(0)
        self._pushes: list[Push] = []
        self._delayed: deque[Array] = deque()  # inputs that have not arrived yet
        self.conditions: PlantConditions = randomization.draw(self._rng)

    def __getstate__(self) -> NoReturn:
        """Refuse copies: their views would still show this simulation's data."""
        raise InvalidInputError("simulation: cannot be copied; construct a new one")

    def reset(self, position: Array, yaw: float, rng: np.random.Generator) -> None:
        """Put the robot at rest on the ground near `position` (2,) [m], facing about `yaw` [rad].

        The generator draws the conditions of this episode, and its sensor noise.
        """
        self._rng = rng
        self.conditions = self._randomization.draw(rng)
        self._pushes = self._disturbance.draw(rng)
        offset, turn = self._randomization.draw_start(rng)
        ticks = round(self.conditions.delay / self.model.opt.timestep)
        self._delayed = deque(np.zeros((ticks, self._inputs)))
        self._set_conditions()
        self._forces = np.zeros(len(self._boxes))
        mujoco.mj_resetData(self.model, self.data)
        if self._has_payload:
            self._load(self.conditions.payload)
        stand(self.data, position + offset, self._height, yaw + turn, self.home_joints)

    @abstractmethod
    def step(self, inputs: Array) -> None:
        """Advance the physics by one tick under the robot's inputs (k,)."""

    def _disturbed(self, inputs: Array) -> Array:
        """Apply the scheduled pushes; return the inputs (k,) that arrive after their delay."""
        if self._delayed:
            self._delayed.append(inputs)
            inputs = self._delayed.popleft()
        if self._pushes:
            now, force = self.data.time, np.zeros(3)
            for push in self._pushes:
                if push.time <= now < push.time + push.duration:
                    force += push.force
            self.push(force)
        return inputs

    @abstractmethod
    def _set_conditions(self) -> None:
        """Set the friction of the floor and the strength of the motors to `conditions`."""

    @property
    @abstractmethod
    def diverged(self) -> bool:
        """Whether the robot's state is no longer finite."""

    def place_geoms(self) -> None:
        """Compute the position of every geom from the present joint angles."""
        mujoco.mj_kinematics(self.model, self.data)

    def base(self, out: Array) -> None:
        """Write position, quaternion, velocity and turning rate of the trunk to (13,)."""
        out[:7] = self._pose
        out[7:] = self._twist

    def push(self, force: Array) -> None:
        """Apply a force (3,) [N] at the trunk's centre of mass until the next call."""
        self.data.xfrc_applied[self._trunk_id, :3] = force

    @property
    def yaw(self) -> float:
        """Heading of the trunk, without noise [rad]."""
        w, x, y, z = self._pose[3:].tolist()
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))

    @property
    def yaw_rate(self) -> float:
        """Turning rate of the trunk about its own vertical axis [rad/s]."""
        return float(self._twist[5])

    @property
    def fallen(self) -> bool:
        """Whether the trunk has tipped over or is on the ground, or the physics diverged."""
        z, _, x, y = self._pose[2:6].tolist()  # height, then the quaternion's w, x and y
        upright = 1.0 - 2.0 * (x * x + y * y)
        return self.diverged or not (upright > self._least_upright and z > self._least_height)

    def obstacle_forces(self) -> Array:
        """Return (k,) the normal force between the robot and each obstacle in the last tick [N]."""
        return self._forces

    def _measure_forces(self) -> Array:
        """Return (k,) the normal force between the robot and each box now [N]."""
        forces, wrench = np.zeros(len(self._boxes)), np.zeros(6)
        geoms = self.data.contact.geom  # (contacts, 2)
        for contact in np.flatnonzero(np.isin(geoms, self._boxes).any(axis=1)).tolist():
            box, other = geoms[contact].tolist()
            if box not in self._boxes:
                box, other = other, box
            if self.model.body_rootid[self.model.geom_bodyid[other]] == self._trunk_id:
                mujoco.mj_contactForce(self.model, self.data, contact, wrench)
                forces[self._boxes == box] += wrench[0]  # of the contact's frame: the normal
        return forces

    def _load(self, payload: float) -> None:
        """Set the payload's mass [kg] and the inertia of its box."""
        body = self.model.body(scene.PAYLOAD).id
        x, y, z = (2.0 * half for half in scene.PAYLOAD_HALF_SIZE)
        diagonal = np.array([y * y + z * z, x * x + z * z, x * x + y * y])
        self.model.body_mass[body] = payload
        self.model.body_inertia[body] = payload / 12 * diagonal
        mujoco.mj_setConst(self.model, self.data)
