"""The locomotion controller: a planar acceleration in, twelve joint torques out, at 500 Hz."""

import math
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask, attributes
from hcbf_gym.errors import InvalidInputError, choose, finite_float
from hcbf_gym.locomotion import qp
from hcbf_gym.locomotion.gait import GAITS, Gait
from hcbf_gym.locomotion.leg import foot_kinematics
from hcbf_gym.locomotion.model import RobotModel
from hcbf_gym.locomotion.records import MEMORY, SETTINGS
from hcbf_gym.locomotion.state import RobotState
from hcbf_gym.locomotion.task_space_qp import TaskSpaceQp
from hcbf_gym.robots import a1
from hcbf_gym.robots.reader import read_robot

LEAST_FRICTION, LARGEST_FRICTION = 0.05, 10.0
"""Of the ground's friction: below, no gait walks; above, it bounds nothing."""


class BodyReference(NamedTuple):
    """The trunk's reference in the plane.

    Attributes:
        position: (2,) [m].
        velocity: (2,) [m/s].
        acceleration: (2,) [m/s²].
        yaw: [rad].
        yaw_rate: [rad/s].
        yaw_acceleration: [rad/s²].
        turning: whether the heading follows the velocity at present.
    """

    position: Array
    velocity: Array
    acceleration: Array
    yaw: float
    yaw_rate: float
    yaw_acceleration: float
    turning: bool


class Diagnostics(NamedTuple):
    """The controller's latest tick.

    Attributes:
        stance: (4,) bool, feet that the gait lets carry.
        foot_position: (4, 3) targets of the feet in the world [m].
        foothold: (4, 2) where they land, or are [m].
        torque: (12,) as commanded [N·m].
        feedforward: (12,) the QP's share of it [N·m].
        qp_exitflag: DAQP's; 1 means optimal, 0 that there was no program yet.
        qp_residual: largest violation of the KKT conditions; 0 where there was no program yet.
        qp_solved: programs solved since reset.
        qp_failed: programs without a solution since reset; the last torques were held there.
    """

    stance: Mask
    foot_position: Array
    foothold: Array
    torque: Array
    feedforward: Array
    qp_exitflag: int
    qp_residual: float
    qp_solved: int
    qp_failed: int


class LocomotionController:
    """Walks a quadruped so that its trunk accelerates by u in the plane.

    Args:
        xml_file: MJCF of the robot alone, from which the controller's model is read.
        timestep: of the control loop [s].
        friction: µ of the friction pyramid that bounds the contact forces; below 0.6 the
            robot turns more slowly in proportion.
        gait: a name from `GAITS`; "stand" stands still until a command or a disturbance.
        heading: "velocity" turns the trunk along its velocity, "fixed" holds it as at reset.
        max_speed: cap on the reference's speed [m/s]; None is as fast as the gait walks well.

    Attributes:
        stance: (4,) feet that the latest tick lets carry; a view, which every tick changes.
        solved: programs solved since reset.
        failed: programs without a solution since reset.

    Raises:
        RobotModelError: if the file is no model of the A1's kind; the message names the joints.
        InvalidInputError: on an unknown name, or a number out of range.
    """

    def __init__(
        self,
        xml_file: str | Path = a1.XML_FILE,
        *,
        timestep: float = 0.002,
        friction: float = 0.6,
        gait: str = "trot",
        heading: str = "velocity",
        max_speed: float | None = None,
    ) -> None:
        self.robot = read_robot(xml_file)
        self.model = RobotModel(self.robot)
        chosen_gait = choose("gait", gait, GAITS)
        settings = (
            finite_float("timestep", timestep, minimum=0.0, exclusive=True),
            check_friction(friction),
            self.robot.stall_torque,
            self.robot.no_load_speed,
            self.robot.home_height,
            _speed_cap(chosen_gait, max_speed),
            choose("heading", heading, {"velocity": True, "fixed": False}),
            self.robot.foot_radius,
            chosen_gait,
            self.model.legs,
            _core.nominal_stance(self.model.legs.hip),
            self.model.bodies,
        )
        self._settings = np.array([settings], dtype=SETTINGS)
        self._memory = np.zeros(1, dtype=MEMORY)
        self.stance: Mask = self._memory["targets"]["stance"][0]
        self._qp = TaskSpaceQp(self._settings, self._memory)
        self._begun = False
        self._solution: qp.Solution | None = None
        self._torque = np.zeros(12)
        self.solved = 0
        self.failed = 0

    def __getstate__(self) -> NoReturn:
        """Refuse copies: their views would still show this controller's workspace."""
        raise InvalidInputError("controller: cannot be copied; construct a new one")

    def reset(self, state: RobotState) -> None:
        """Forget the past and start from rest where the robot is."""
        R = _core.rotation_matrix(state.quaternion)
        kinematics = foot_kinematics(self.model.legs, state.joint_position, state.joint_velocity)
        feet = state.position + kinematics.position @ R.T
        self._memory[:] = 0
        memory = attributes(self._memory)
        memory.reference.position[:] = state.position[:2]
        memory.reference.yaw = math.atan2(R[1, 0], R[0, 0])
        memory.clock = _core.RESTING if self._settings["gait"]["rests"][0] else 0.0
        memory.ground = feet[:, 2].mean() - self.robot.foot_radius
        memory.targets.stance[:] = True
        memory.targets.motion[:, 0] = feet
        memory.targets.foothold[:] = feet[:, :2]
        self._qp.feedforward[:] = 0.0
        self._torque = np.zeros(12)
        self._begun, self._solution = True, None
        self.solved = 0
        self.failed = 0

    def step(self, state: RobotState, u: Array) -> Array:
        """Return (12,) joint torques [N·m] for the coming tick.

        Args:
            state: as measured now.
            u: (2,) desired acceleration of the trunk in the world [m/s²].
        """
        self._torque, self._solution = self._qp.step(state, u)
        if self._solution.x is None:
            self.failed += 1
        else:
            self.solved += 1
        return self._torque

    @property
    def lift(self) -> float:
        """The upward acceleration that it has learnt to hold the trunk's height [m/s²]."""
        return float(self._memory["lift"][0])

    @property
    def reference(self) -> BodyReference:
        """The state of the reduced-order model, and the heading's."""
        # in one piece: field by field takes six times as long
        fields = self._memory["reference"].copy().item()
        return BodyReference._make(fields)

    @property
    def diagnostics(self) -> Diagnostics:
        """The latest tick, or the pose at the reset; the residual takes longer than the QP."""
        if not self._begun:
            raise InvalidInputError("diagnostics: there was no reset yet, expected one first")
        targets = attributes(self._memory).targets
        solved = self._solution
        return Diagnostics(
            stance=targets.stance.copy(),
            foot_position=targets.motion[:, 0].copy(),
            foothold=targets.foothold.copy(),
            torque=self._torque.copy(),
            feedforward=self._qp.feedforward.copy(),
            qp_exitflag=0 if solved is None else solved.exitflag,
            qp_residual=0.0 if solved is None else qp.residual(self._qp.program, solved),
            qp_solved=self.solved,
            qp_failed=self.failed,
        )


def check_friction(friction: float) -> float:
    """Return µ of the contact forces, if a controller can plan with it."""
    return finite_float("friction", friction, minimum=LEAST_FRICTION, maximum=LARGEST_FRICTION)


def _speed_cap(gait: Gait, max_speed: float | None) -> float:
    if max_speed is None:
        return gait.max_speed
    speed = finite_float("max_speed", max_speed, minimum=0.0, exclusive=True)
    if speed > gait.max_speed:
        raise InvalidInputError(
            f"max_speed: got {speed} m/s, expected at most {gait.max_speed} m/s for this gait"
        )
    return speed
