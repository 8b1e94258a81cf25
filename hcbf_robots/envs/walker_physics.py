"""The simulated scene of a walker."""

import math
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.envs import scene
from hcbf_gym.envs.randomization import Randomization
from hcbf_gym.envs.simulation import SimulatedRobot, Simulation
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.scenarios import BoxObstacle
from hcbf_robots.walkers.walker import Walker
from hcbf_robots.walkers.walker_model import as_slice, indices


class WalkerPhysics(Simulation):
    """A scene with one walker, driven through its own actuators.

    Args:
        walker: the robot's contract.
        obstacles: as `Simulation` takes them, like `terrain` and `disturbances`.
        randomization: plain dict of `Randomization`'s ranges, without sensor noise; the floor's
            friction is the contract's where none is given.

    Attributes:
        parts: names of the robot's parts.
        at: indices of these parts in the scene.
    """

    def __init__(
        self,
        walker: Walker,
        *,
        obstacles: Sequence[BoxObstacle] = (),
        terrain: str = "flat",
        randomization: Mapping[str, object] | None = None,
        disturbances: Mapping[str, object] | None = None,
    ) -> None:
        self.walker = walker
        given = {} if randomization is None else randomization
        defaults = {"floor_friction": walker.physics.friction, "delay": 0.0}
        ranges = Randomization.from_dict({**defaults, **given})
        if ranges.sensor_noise[1] > 0.0:
            raise InvalidInputError(
                "randomization: sensor_noise: got more than 0, expected 0: a walker's controller "
                "reads its sensors as they are"
            )
        spec, self.parts = walker.spec()
        robot = SimulatedRobot(
            spec=spec,
            source=walker.mjcf,
            trunk=self.parts.trunk,
            home_joints=self.parts.home,
            height=walker.body.height,
            inputs=len(self.parts.actuators),
            least_upright=math.cos(walker.fall.tilt),
            least_height=walker.fall.height,
            floor_decides=True,
        )
        super().__init__(robot, ranges, obstacles, terrain, disturbances)
        self.at = indices(self.model, self.parts)
        self._floor = self.model.geom(scene.FLOOR).id
        self._ctrl, self._ctrl_slice = self.data.ctrl, as_slice(self.at.ctrl)
        # of motors of full strength
        self._gain = self.model.actuator_gainprm.copy()
        self._bias = self.model.actuator_biasprm.copy()
        self._force_range = self.model.actuator_forcerange.copy()

    def reset(self, position: Array, yaw: float, rng: np.random.Generator) -> None:
        """Put the robot at rest, and compute what follows from its pose."""
        super().reset(position, yaw, rng)
        mujoco.mj_forward(self.model, self.data)

    def _set_conditions(self) -> None:
        """Write the episode's friction and strength of the motors into the model."""
        model, strength = self.model, self.conditions.motor_strength
        model.geom_friction[self._floor, 0] = self.conditions.floor_friction
        model.actuator_gainprm[:] = strength * self._gain
        model.actuator_biasprm[:] = strength * self._bias
        model.actuator_forcerange[:] = strength * self._force_range

    def step(self, inputs: Array) -> None:
        """Advance the physics by one tick under the actuators' inputs (k,)."""
        if self._delayed or self._pushes:
            inputs = self._disturbed(inputs)
        self._ctrl[self._ctrl_slice] = inputs
        mujoco.mj_step(self.model, self.data)
        if len(self._boxes):
            self._forces = self._measure_forces()

    @property
    def diverged(self) -> bool:
        """Whether the robot's state is not finite any more."""
        return not _core.is_finite(self._qpos, self._qvel)
