"""The plant: the robot, the ground and boxes in MuJoCo, stepped one physics tick at a time."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numba import njit

from hcbf_gym.arrays import Array
from hcbf_gym.envs import scene
from hcbf_gym.envs.disturbances import Push, disturbance_from_dict
from hcbf_gym.envs.randomization import Conditions, Randomization
from hcbf_gym.envs.simulated import Simulated
from hcbf_gym.errors import finite_float
from hcbf_gym.locomotion.rotation import turned
from hcbf_gym.locomotion.state import STATE_SIZE, RobotState
from hcbf_gym.robots import a1
from hcbf_gym.robots.motors import drive
from hcbf_gym.robots.reader import compile_spec, foot_name, read_robot

MIN_UPRIGHT = 0.5  # cosine of the trunk's tilt below which it has fallen
MIN_HEIGHT = 0.12  # [m] of the trunk below which it has fallen

CONTACT_FORCE = 5.0  # [N] of the floor on a foot, above which the foot stands on it

# standard deviations at sensor_noise = 1, in the order of qvel and of the joints' positions
VELOCITY_NOISE = np.repeat([0.1, 0.2, 0.6], [3, 3, 12])  # [m/s], [rad/s], [rad/s]
JOINT_NOISE = 0.01  # [rad]
TURN_NOISE = 0.005  # [rad] about every axis
CONTACT_NOISE = 0.005  # probability that a foot's contact is reported wrongly

SHORTEST_TICK, LONGEST_TICK = 1e-4, 0.02  # [s]

BASE = np.array([0, 1, 19, 20])  # planar position and velocity of the trunk in a state's vector


class Physics(Simulated):
    """A scene with one robot, driven by joint torques.

    Attributes:
        truth: (41,) the vector of the robot's state without noise; every tick has its own.
        diverged: whether that has left the finite numbers.

    Args:
        xml_file: MJCF of the robot alone; None means the package's own A1. Its actuators are
            replaced by torque motors.
        timestep: of the physics [s].
        obstacles: boxes, see `scene.add_boxes`.
        terrain: "flat", or "rough" with blind steps of at most 3 cm.
        randomization: plain dict of `Randomization`'s ranges; None is the nominal plant.
        disturbances: plain dict of pushes, see `disturbance_from_dict`; None is calm.
        decorate: called with the MjSpec before it is compiled, to add what is only seen.

    Raises:
        RobotModelError: if the robot has not the A1's trunk, joints and feet.
        InvalidInputError: on a number out of range, an unknown name, or boxes named alike or like
            a part of the robot.
    """

    def __init__(
        self,
        xml_file: str | Path | None = None,
        *,
        timestep: float = 0.002,
        obstacles: Sequence[Any] = (),
        terrain: str = "flat",
        randomization: Mapping[str, Any] | None = None,
        disturbances: Mapping[str, Any] | None = None,
        decorate: Callable[[mujoco.MjSpec], None] | None = None,
    ) -> None:
        timestep = finite_float("timestep", timestep, minimum=SHORTEST_TICK, maximum=LONGEST_TICK)
        self._randomization = Randomization.from_dict(randomization)
        self._disturbance = disturbance_from_dict(disturbances)
        self.robot = read_robot(a1.XML_FILE if xml_file is None else xml_file)
        spec = scene.robot_spec(self.robot)
        scene.set_physics(spec, timestep)
        scene.add_ground(spec, terrain)
        scene.add_boxes(spec, obstacles)
        if self._randomization.payload[1] > 0.0:
            scene.add_payload(spec, self._randomization.payload_position)
        if decorate is not None:
            decorate(spec)
        self.model = compile_spec(spec, self.robot.xml_file)
        self.data = mujoco.MjData(self.model)

        self._trunk = self.model.body(a1.TRUNK).id
        self._feet = np.array([self.model.geom(foot_name(leg)).id for leg in a1.LEGS])
        self._boxes = np.array([self.model.geom(box.name).id for box in obstacles], dtype=np.int64)
        self._forces = np.zeros(len(self._boxes))
        self._start_height = self.robot.home_height + (
            scene.ROUGH_STEP if terrain == "rough" else 0.0
        )
        # the robot comes first in the scene, so these are its own
        self._qpos, self._qvel = self.data.qpos[:19], self.data.qvel[:18]
        self._rate, self._ctrl = self.data.qvel[6:18], self.data.ctrl
        self._foot_forces = self.data.sensordata[:12]  # (3,) of each foot
        self._rng = np.random.default_rng(0)
        self._pushes: list[Push] = []
        self._delayed: deque[Array] = deque()
        self.conditions: Conditions = self._randomization.draw(self._rng)
        self._arrive()

    def reset(self, position: Array, yaw: float, rng: np.random.Generator) -> None:
        """Put the robot at rest on its feet near `position` (2,) [m], facing about `yaw` [rad].

        Args:
            position: (2,) [m].
            yaw: [rad].
            rng: draws what is random about this episode, and its sensor noise.
        """
        self._rng = rng
        self.conditions = self._randomization.draw(rng)
        self._pushes = self._disturbance.draw(rng)
        offset, turn = self._randomization.draw_start(rng)
        yaw += turn
        ticks = round(self.conditions.delay / self.model.opt.timestep)
        self._delayed = deque(np.zeros((ticks, 12)))
        self.model.geom_friction[self._feet, 0] = self.conditions.floor_friction
        self._forces = np.zeros(len(self._boxes))
        mujoco.mj_resetData(self.model, self.data)
        if self._randomization.payload[1] > 0.0:
            self._load(self.conditions.payload)
        self._qpos[:2] = position + offset
        self._qpos[2] = self._start_height
        self._qpos[3:7] = np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)
        self._qpos[7:] = self.robot.home_joints
        self._arrive()

    def state(self, known: Array | None = None) -> RobotState:
        """Return what the robot's sensors and its estimator say now.

        Args:
            known: (41,) the state's vector as estimated, to which the sensors' noise is added; None
                means the truth.
        """
        vector = self.truth if known is None else known
        noise = self.conditions.sensor_noise
        if noise == 0.0:
            return RobotState(vector)
        sensed = vector.copy()
        sensed[19:37] += noise * VELOCITY_NOISE * self._rng.standard_normal(18)
        sensed[7:19] += noise * JOINT_NOISE * self._rng.standard_normal(12)
        sensed[3:7] = turned(sensed[3:7], noise * TURN_NOISE * self._rng.standard_normal(3))
        wrong = self._rng.random(4) < noise * CONTACT_NOISE
        sensed[37:] = np.where(wrong, 1.0 - sensed[37:], sensed[37:])
        return RobotState(sensed)

    def step(self, torque: Array) -> None:
        """Advance the physics by one tick under the joint torques (12,) [N·m].

        The tick ends with `mj_step1`, so that positions, velocities and contacts are those of the
        new time when the controller reads them.
        """
        if self._delayed:
            self._delayed.append(torque)
            torque = self._delayed.popleft()
        if self._pushes:
            self.push(self._scheduled_force())
        drive(
            self.robot.stall_torque,
            self.robot.no_load_speed,
            self._rate,
            self.conditions.motor_strength,
            torque,
            self._ctrl,
        )
        mujoco.mj_step2(self.model, self.data)
        if len(self._boxes):
            self._forces = self._measure_forces()  # mj_step1 replaces the contacts they belong to
        self._arrive()

    def _arrive(self) -> None:
        """Compute what follows from the new positions and velocities, and note them."""
        mujoco.mj_step1(self.model, self.data)
        self.truth = np.empty(STATE_SIZE)
        self.diverged = not read_state(self._qpos, self._qvel, self._foot_forces, self.truth)

    @property
    def base_state(self) -> Array:
        """(4,) planar position [m] and velocity [m/s] of the trunk, without noise."""
        return self.truth[BASE]

    @property
    def fallen(self) -> bool:
        """Whether the trunk has tipped over or lies on the ground, or the physics diverged."""
        z, _, x, y = self._qpos[2:6].tolist()
        upright = 1.0 - 2.0 * (x * x + y * y)
        return self.diverged or not (upright > MIN_UPRIGHT and z > MIN_HEIGHT)


@njit(cache=True)
def read_state(
    qpos: Array,
    qvel: Array,
    foot_forces: Array,
    state: Array,
) -> bool:
    """Fill in the vector of a `RobotState` and return whether it is finite.

    Args:
        qpos: (19,) of the robot.
        qvel: (18,).
        foot_forces: (12,) the ground's force on each foot in the last tick, in the world [N].
        state: (41,) filled in.
    """
    state[:19] = qpos
    state[19:37] = qvel
    for foot in range(4):
        state[37 + foot] = abs(foot_forces[3 * foot + 2]) > CONTACT_FORCE
    return bool(np.isfinite(state).all())
