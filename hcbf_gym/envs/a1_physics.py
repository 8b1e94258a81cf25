"""The simulation of an A1, or of a robot with its joints, under joint torques."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.envs import scene
from hcbf_gym.envs.randomization import Randomization
from hcbf_gym.envs.simulation import SimulatedRobot, Simulation
from hcbf_gym.errors import finite_float
from hcbf_gym.locomotion.state import STATE_SIZE, RobotState
from hcbf_gym.robots import a1
from hcbf_gym.robots.reader import foot_name, read_robot
from hcbf_gym.scenarios import BoxObstacle

MIN_UPRIGHT = 0.5  # cosine of the trunk's tilt below which the robot has fallen
MIN_HEIGHT = 0.12  # height of the trunk below which the robot has fallen [m]

# standard deviations at sensor_noise = 1
VELOCITY_NOISE = np.repeat([0.1, 0.2, 0.6], [3, 3, 12])  # trunk [m/s], [rad/s], joints [rad/s]
JOINT_NOISE = 0.01  # [rad]
TURN_NOISE = 0.005  # rotation of the trunk about every axis [rad]
CONTACT_NOISE = 0.005  # probability that a foot's contact is reported wrongly

SHORTEST_TICK, LONGEST_TICK = 1e-4, 0.02  # [s]

# the entries of a state's vector (41,), see `RobotState`
QUATERNION, JOINTS, VELOCITIES, CONTACTS = slice(3, 7), slice(7, 19), slice(19, 37), slice(37, 41)
BASE = np.array([0, 1, 19, 20])  # planar position and velocity of the trunk


class A1Physics(Simulation):
    """A scene with one robot that has the A1's joints, driven by joint torques.

    Args:
        xml_file: MJCF of the robot alone; None means the package's own A1. Its actuators are
            replaced by torque motors.
        timestep: duration of a physics tick [s].
        obstacles: as `Simulation` takes them, like `terrain` and `disturbances`.
        randomization: plain dict of `Randomization`'s ranges; None is the nominal plant.

    Attributes:
        robot: the robot as read from its file.
        truth: (41,) the vector of the robot's state without noise; every tick makes a new array.
    """

    def __init__(
        self,
        xml_file: str | Path | None = None,
        *,
        timestep: float = 0.002,
        obstacles: Sequence[BoxObstacle] = (),
        terrain: str = "flat",
        randomization: Mapping[str, object] | None = None,
        disturbances: Mapping[str, object] | None = None,
    ) -> None:
        timestep = finite_float("timestep", timestep, minimum=SHORTEST_TICK, maximum=LONGEST_TICK)
        drawn = Randomization.from_dict(randomization)
        self.robot = read_robot(a1.XML_FILE if xml_file is None else xml_file)
        spec = scene.robot_spec(self.robot)
        scene.set_physics(spec, timestep)
        robot = SimulatedRobot(
            spec=spec,
            source=self.robot.xml_file,
            trunk=a1.TRUNK,
            home_joints=self.robot.home_joints,
            height=self.robot.home_height,
            inputs=len(a1.JOINTS),
            least_upright=MIN_UPRIGHT,
            least_height=MIN_HEIGHT,
            floor_decides=False,
        )
        super().__init__(robot, drawn, obstacles, terrain, disturbances)
        self._feet = np.array([self.model.geom(foot_name(leg)).id for leg in a1.LEGS])
        self._motors = _core.Motors(
            self.robot.stall_torque, self.robot.no_load_speed, self.data.qvel[6:18], self.data.ctrl
        )
        contact_forces = self.data.sensordata[:12]  # (3,) for each of the four feet [N]
        self._reader = _core.A1State(self._qpos, self._qvel, contact_forces)
        self._end_tick()

    def reset(self, position: Array, yaw: float, rng: np.random.Generator) -> None:
        """Put the robot at rest near a position (2,) [m], facing about `yaw` [rad]."""
        super().reset(position, yaw, rng)
        self._end_tick()

    def step(self, inputs: Array) -> None:
        """Advance the physics by one tick under the joint torques (12,) [N·m].

        It ends with `mj_step1`, so that the controller reads contacts of the new time.
        """
        self._motors.drive(self.conditions.motor_strength, self._disturbed(inputs))
        mujoco.mj_step2(self.model, self.data)
        if len(self._boxes):
            self._forces = self._measure_forces()  # before mj_step1 replaces the contacts
        self._end_tick()

    def place_geoms(self) -> None:
        """Do nothing, because every tick ends with the geoms at their places."""

    def _set_conditions(self) -> None:
        self.model.geom_friction[self._feet, 0] = self.conditions.floor_friction

    def _end_tick(self) -> None:
        """Compute poses, contacts and sensors from the new joint state, and read the state."""
        mujoco.mj_step1(self.model, self.data)
        self.truth = np.empty(STATE_SIZE)
        self._is_finite = self._reader.read(self.truth)

    @property
    def diverged(self) -> bool:
        """Whether the robot's state is no longer finite."""
        return not self._is_finite

    @property
    def base_state(self) -> Array:
        """(4,) planar position [m] and velocity [m/s] of the trunk, without noise."""
        return self.truth[BASE]

    def state(self, estimate: Array | None = None) -> RobotState:
        """Return the state for the controller, with the sensors' noise.

        It is that of an estimate (41,), or the true one without an estimate.
        """
        vector = self.truth if estimate is None else estimate
        noise = self.conditions.sensor_noise
        if noise == 0.0:
            return RobotState(vector)
        sensed = vector.copy()
        sensed[VELOCITIES] += noise * VELOCITY_NOISE * self._rng.standard_normal(18)
        sensed[JOINTS] += noise * JOINT_NOISE * self._rng.standard_normal(12)
        turn = noise * TURN_NOISE * self._rng.standard_normal(3)
        sensed[QUATERNION] = _core.turned(sensed[QUATERNION], turn)
        is_wrong = self._rng.random(4) < noise * CONTACT_NOISE
        sensed[CONTACTS] = np.where(is_wrong, 1.0 - sensed[CONTACTS], sensed[CONTACTS])
        return RobotState(sensed)
