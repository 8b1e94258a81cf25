"""The scene with a walker in it, stepped one physics tick at a time under its actuators' inputs."""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from numba import njit

from hcbf_gym.arrays import Array
from hcbf_gym.envs import scene
from hcbf_gym.envs.disturbances import Push, disturbance_from_dict
from hcbf_gym.envs.randomization import Conditions, Randomization
from hcbf_gym.envs.simulated import Simulated
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.robots.reader import compile_spec
from hcbf_gym.robots.walker import Walker, stand
from hcbf_gym.robots.walker_model import as_slice, indices


class WalkerPhysics(Simulated):
    """A scene with one walker, driven through its own actuators.

    Args:
        walker: the robot's contract.
        obstacles: boxes, see `scene.add_boxes`.
        terrain: "flat", or "rough" with blind steps of at most 3 cm.
        randomization: plain dict of `Randomization`'s ranges, without sensor noise; the floor's
            friction is the contract's where none is given.
        disturbances: plain dict of pushes, see `disturbance_from_dict`; None is calm.

    Attributes:
        parts: names of the robot's parts.
        at: where the scene has them.
        diverged: whether the state had left the finite numbers when one looked last.

    Raises:
        RobotModelError: if the robot's file is not what the contract says.
        InvalidInputError: on a number out of range, an unknown name, or boxes named alike or like
            a part of the robot.
    """

    def __init__(
        self,
        walker: Walker,
        *,
        obstacles: Sequence[Any] = (),
        terrain: str = "flat",
        randomization: Mapping[str, Any] | None = None,
        disturbances: Mapping[str, Any] | None = None,
    ) -> None:
        self.walker = walker
        given = {} if randomization is None else randomization
        self._randomization = Randomization.from_dict(
            {"floor_friction": walker.physics.friction, "delay": 0.0, **given}
        )
        if self._randomization.sensor_noise[1] > 0.0:
            raise InvalidInputError(
                "randomization: sensor_noise: got more than 0, expected 0: a walker's controller "
                "reads its sensors as they are"
            )
        self._disturbance = disturbance_from_dict(disturbances)
        spec, self.parts = walker.spec()
        scene.add_ground(spec, terrain)
        floor = spec.geom(scene.FLOOR)
        floor.priority, floor.condim = 1, 3  # its friction decides alone
        scene.add_boxes(spec, obstacles)
        if self._randomization.payload[1] > 0.0:
            place = self._randomization.payload_position
            scene.add_payload(spec, place, self.parts.trunk)
        # a divergence is reported: MuJoCo would put the robot back to where the file has it
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.model = compile_spec(spec, walker.mjcf)
        self.data = mujoco.MjData(self.model)
        self.at = indices(self.model, self.parts)
        self._trunk = self.model.body(self.parts.trunk).id
        self._floor = self.model.geom(scene.FLOOR).id
        self._boxes = np.array([self.model.geom(box.name).id for box in obstacles], dtype=np.int64)
        self._forces = np.zeros(len(self._boxes))
        self._height = walker.body.height + (scene.ROUGH_STEP if terrain == "rough" else 0.0)
        joints = len(self.parts.home)
        self._qpos, self._qvel = self.data.qpos[: 7 + joints], self.data.qvel[: 6 + joints]
        self._pose, self._twist = self.data.qpos[:7], self.data.qvel[:6]
        self._ctrl, self._driven = self.data.ctrl, as_slice(self.at.ctrl)
        self._least_upright = math.cos(walker.fall.tilt)
        model = self.model
        self._strength = model.actuator_gainprm.copy(), model.actuator_biasprm.copy()
        self._strongest = model.actuator_forcerange.copy()
        self._pushes: list[Push] = []
        self._delayed: deque[Array] = deque()
        self.conditions: Conditions = self._randomization.draw(np.random.default_rng(0))
        self.diverged = False

    @property
    def home_joints(self) -> Array:
        """(j,) of the robot at the start [rad]."""
        return self.parts.home

    def reset(self, position: Array, yaw: float, rng: np.random.Generator) -> None:
        """Put the robot at rest on the ground near `position` (2,) [m], facing about `yaw` [rad].

        Args:
            position: (2,) [m].
            yaw: [rad].
            rng: draws what is random about this episode.
        """
        self.conditions = self._randomization.draw(rng)
        self._pushes = self._disturbance.draw(rng)
        offset, turn = self._randomization.draw_start(rng)
        ticks = round(self.conditions.delay / self.model.opt.timestep)
        self._delayed = deque(np.zeros((ticks, len(self.at.ctrl))))
        self.model.geom_friction[self._floor, 0] = self.conditions.floor_friction
        self._weaken(self.conditions.motor_strength)
        self._forces = np.zeros(len(self._boxes))
        mujoco.mj_resetData(self.model, self.data)
        if self._randomization.payload[1] > 0.0:
            self._load(self.conditions.payload)
        stand(self.data, position + offset, self._height, yaw + turn, self.parts.home)
        mujoco.mj_forward(self.model, self.data)
        self.diverged = False

    def step(self, ctrl: Array) -> None:
        """Advance the physics by one tick under the actuators' inputs (k,)."""
        if self._delayed:
            self._delayed.append(ctrl)
            ctrl = self._delayed.popleft()
        if self._pushes:
            self.push(self._scheduled_force())
        self._ctrl[self._driven] = ctrl
        mujoco.mj_step(self.model, self.data)
        if len(self._boxes):
            self._forces = self._measure_forces()

    def look(self) -> None:
        """Note whether the state has left the finite numbers."""
        self.diverged = not _finite(self._qpos, self._qvel)

    def place_geoms(self) -> None:
        """Move every geom to where the present positions have it."""
        mujoco.mj_kinematics(self.model, self.data)

    def base(self, out: Array) -> None:
        """Write position, quaternion, velocity and turning rate of the trunk to (13,)."""
        out[:7] = self._pose
        out[7:] = self._twist

    @property
    def yaw_rate(self) -> float:
        """At which the trunk turns about its own vertical axis [rad/s]."""
        return float(self._twist[5])

    @property
    def fallen(self) -> bool:
        """Whether the trunk has tipped over or lies on the ground, or the physics diverged."""
        z, _, x, y = self._pose[2:6].tolist()
        upright = 1.0 - 2.0 * (x * x + y * y)
        return self.diverged or not (upright > self._least_upright and z > self.walker.fall.height)

    def _weaken(self, share: float) -> None:
        """Let a share of the actuators' forces arrive."""
        gain, bias = self._strength
        self.model.actuator_gainprm[:] = share * gain
        self.model.actuator_biasprm[:] = share * bias
        self.model.actuator_forcerange[:] = share * self._strongest


@njit(cache=True)
def _finite(positions: Array, velocities: Array) -> bool:
    """Tell whether a state holds nothing but finite numbers."""
    return bool(np.isfinite(positions).all() and np.isfinite(velocities).all())
