"""The locomotion controller: a planar acceleration in, twelve joint torques out, at 500 Hz."""

import math
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask, attributes, words_of
from hcbf_gym.errors import InvalidInputError, choose, finite_float
from hcbf_gym.locomotion import qp
from hcbf_gym.locomotion.gait import GAITS, Gait
from hcbf_gym.locomotion.leg import foot_kinematics
from hcbf_gym.locomotion.model import RobotModel
from hcbf_gym.locomotion.records import MEMORY, SETTINGS, WORKSPACE
from hcbf_gym.locomotion.state import RobotState
from hcbf_gym.robots import a1
from hcbf_gym.robots.reader import read_robot

LEAST_FRICTION, LARGEST_FRICTION = 0.05, 10.0
"""The range of the ground's friction. Below it no gait walks, above it no force is limited."""


class BodyReference(NamedTuple):
    """The trunk's reference in the plane."""

    position: Array  # (2,) [m]
    velocity: Array  # (2,) [m/s]
    acceleration: Array  # (2,) [m/s²]
    yaw: float  # [rad]
    yaw_rate: float  # [rad/s]
    yaw_acceleration: float  # [rad/s²]
    turning: bool  # whether the heading follows the velocity at present


class Diagnostics(NamedTuple):
    """The results of the controller's latest tick."""

    stance: Mask  # (4,) feet that carry load by the gait's plan
    foot_position: Array  # (4, 3) targets of the feet in the world [m]
    foothold: Array  # (4, 2) where swing feet land and stance feet are [m]
    torque: Array  # (12,) the commanded torques [N·m]
    feedforward: Array  # (12,) the part of them that the QP computed [N·m]
    qp_exitflag: int  # DAQP's; 1 means optimal, 0 that there was no program yet
    qp_residual: float  # largest violation of the KKT conditions; 0 if there was no program yet
    qp_solved: int  # programs solved since reset
    qp_failed: int  # programs without a solution since reset; the torques before were held


class LocomotionController:
    """Walks a quadruped so that its trunk accelerates by u in the plane.

    Args:
        xml_file: MJCF of the robot alone, from which the controller's model is read.
        timestep: period of the control loop [s].
        friction: µ of the friction pyramid that bounds the contact forces; below 0.6 the
            robot turns more slowly in proportion.
        gait: a name from `GAITS`; "stand" stands still until a command or a disturbance.
        heading: "velocity" turns the trunk along its velocity, "fixed" holds it as at reset.
        max_speed: cap on the reference's speed [m/s]; None takes the gait's greatest speed.

    Attributes:
        stance: (4,) feet that carry load in the latest tick; a view, which every tick changes.
        solved: the number of programs solved since reset.
        failed: the number of programs without a solution since reset.

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
        workspace = np.zeros(1, dtype=WORKSPACE)
        records = self._settings, self._memory, workspace
        self._compiled = _core.LocomotionTick(*map(words_of, records))
        work = attributes(workspace)
        self._tick_torque, self._feedforward, self._z = work.torque, work.feedforward, work.z
        self._programs = [_program_in(work, contacts) for contacts in range(5)]
        # where no bound is active, the solution is in the workspace and the multipliers are zero
        self._unbounded_solutions = [
            qp.Solution(work.z, qp.OPTIMAL, np.zeros(len(program.lower)))
            for program in self._programs
        ]
        self._program = self._programs[0]
        self._is_reset = False
        self._solution: qp.Solution | None = None
        self._torque = np.zeros(12)
        self.solved = 0
        self.failed = 0

    def __getstate__(self) -> NoReturn:
        """Refuse copies, whose views would still show this controller's workspace."""
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
        self._feedforward[:] = 0.0
        self._torque = np.zeros(12)
        self._is_reset, self._solution = True, None
        self.solved = 0
        self.failed = 0

    def step(self, state: RobotState, u: Array) -> Array:
        """Return (12,) joint torques [N·m] for the coming tick.

        Where no bound is active, this is one compiled call. DAQP solves the other programs. Without
        a solution the torques before are held.

        Args:
            state: the state as measured now.
            u: (2,) desired acceleration of the trunk in the world [m/s²].
        """
        contacts, no_bound_is_active = self._compiled.tick(state.vector, u)
        self._program = self._programs[contacts]
        if no_bound_is_active:
            solution = self._unbounded_solutions[contacts]
        else:
            solution = qp.solve(self._program)
            if solution.x is not None:
                self._z[:] = solution.x
            self._compiled.finish(solution.x is not None)
        is_solved = solution.x is not None
        self.solved += is_solved
        self.failed += not is_solved
        self._torque, self._solution = self._tick_torque.copy(), solution
        return self._torque

    @property
    def lift(self) -> float:
        """The learnt upward acceleration that holds the trunk's height [m/s²]."""
        return float(self._memory["lift"][0])

    @property
    def reference(self) -> BodyReference:
        """The references of the trunk: the state of the reduced-order model, and the heading."""
        # one copy of the record: reading it field by field takes six times as long
        fields = self._memory["reference"].copy().item()
        return BodyReference._make(fields)

    @property
    def diagnostics(self) -> Diagnostics:
        """The results of the latest tick; the residual takes longer to compute than the QP."""
        if not self._is_reset:
            raise InvalidInputError("diagnostics: there was no reset yet, expected one first")
        targets = attributes(self._memory).targets
        solution = self._solution
        return Diagnostics(
            stance=targets.stance.copy(),
            foot_position=targets.motion[:, 0].copy(),
            foothold=targets.foothold.copy(),
            torque=self._torque.copy(),
            feedforward=self._feedforward.copy(),
            qp_exitflag=0 if solution is None else solution.exitflag,
            qp_residual=0.0 if solution is None else qp.residual(self._program, solution),
            qp_solved=self.solved,
            qp_failed=self.failed,
        )


def _program_in(work: Any, contacts: int) -> qp.QuadraticProgram:
    """Return the program of a number of feet in stance, as views of the core's workspace."""
    rows = 12 + 4 * contacts  # torques of the joints, then friction pyramids; 12 unknowns
    A, lower, upper = work.A[:rows], work.lower[: 12 + rows], work.upper[: 12 + rows]
    return qp.QuadraticProgram(work.H, work.f, A, lower, upper, equalities=0)


def check_friction(friction: float) -> float:
    """Return the friction coefficient µ, if a controller can plan with it."""
    return finite_float("friction", friction, minimum=LEAST_FRICTION, maximum=LARGEST_FRICTION)


def _speed_cap(gait: Gait, max_speed: float | None) -> float:
    """Return the cap on the reference's speed [m/s]; refuse one above the gait's greatest speed."""
    if max_speed is None:
        return gait.max_speed
    speed = finite_float("max_speed", max_speed, minimum=0.0, exclusive=True)
    if speed > gait.max_speed:
        raise InvalidInputError(
            f"max_speed: got {speed} m/s, expected at most {gait.max_speed} m/s for this gait"
        )
    return speed
