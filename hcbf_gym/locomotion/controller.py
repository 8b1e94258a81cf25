"""The locomotion controller: a planar acceleration in, twelve joint torques out, at 500 Hz."""

import math
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask, Records, attributes, words_of
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


class WorkspaceViews(NamedTuple):
    """Views of the core's workspace, whose numbers every tick overwrites."""

    unknowns: Array  # (12,) of the QP: Python writes DAQP's solution here, for the core to read
    feedforward: Array  # (12,) the torques that follow from the unknowns [N·m]
    torque: Array  # (12,) feedforward and feedback within the limits [N·m]
    programs: list[qp.QuadraticProgram]  # by the number of feet in stance, 0 to 4
    unbounded_solutions: list[qp.Solution]  # of these programs, where no bound is active

    @classmethod
    def of(cls, workspace: Records) -> "WorkspaceViews":
        """Return the views of a workspace (1,)."""
        work = attributes(workspace)
        programs = [_program_in(work, contacts) for contacts in range(5)]
        # the core solves a program without active bounds, and then all multipliers are zero
        unbounded_solutions = [
            qp.Solution(work.z, qp.OPTIMAL, multipliers=np.zeros(len(program.lower)))
            for program in programs
        ]
        return cls(work.z, work.feedforward, work.torque, programs, unbounded_solutions)


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
        self._settings = np.zeros(1, dtype=SETTINGS)
        settings: Any = attributes(self._settings)
        settings.timestep = finite_float("timestep", timestep, minimum=0.0, exclusive=True)
        settings.friction = check_friction(friction)
        settings.stall_torque = self.robot.stall_torque
        settings.no_load_speed = self.robot.no_load_speed
        settings.height = self.robot.home_height
        settings.max_speed = _speed_cap(chosen_gait, max_speed)
        settings.follow_velocity = choose("heading", heading, {"velocity": True, "fixed": False})
        settings.foot_radius = self.robot.foot_radius
        settings.gait = chosen_gait
        settings.legs = self.model.legs
        settings.nominal = _core.nominal_stance(self.model.legs.hip)
        settings.bodies = self.model.bodies

        # The compiled tick has no state. It reads the settings, and writes to the memory
        # (what one tick leaves for the next) and the workspace (the QP and its torques).
        self._memory = np.zeros(1, dtype=MEMORY)
        workspace = np.zeros(1, dtype=WORKSPACE)
        self._compiled = _core.LocomotionTick(
            words_of(self._settings), words_of(self._memory), words_of(workspace)
        )
        self.stance: Mask = self._memory["targets"]["stance"][0]
        self._views = WorkspaceViews.of(workspace)

        # of the latest tick
        self._program = self._views.programs[0]
        self._solution: qp.Solution | None = None  # None until the first tick after a reset
        self._torque = np.zeros(12)
        self._is_reset = False
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
        self._views.feedforward[:] = 0.0
        self._torque = np.zeros(12)
        self._solution = None
        self._is_reset = True
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
        views = self._views
        contacts, no_bound_is_active = self._compiled.tick(state.vector, u)
        self._program = views.programs[contacts]
        if no_bound_is_active:
            solution = views.unbounded_solutions[contacts]
        else:
            solution = qp.solve(self._program)
            if solution.x is not None:
                views.unknowns[:] = solution.x
            self._compiled.finish(solution.x is not None)
        is_solved = solution.x is not None
        self.solved += is_solved
        self.failed += not is_solved
        self._solution = solution
        self._torque = views.torque.copy()
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
            feedforward=self._views.feedforward.copy(),
            qp_exitflag=0 if solution is None else solution.exitflag,
            qp_residual=0.0 if solution is None else qp.residual(self._program, solution),
            qp_solved=self.solved,
            qp_failed=self.failed,
        )


def _program_in(work: Any, contacts: int) -> qp.QuadraticProgram:
    """Return the program of a number of feet in stance, as views of the core's workspace."""
    rows = 12 + 4 * contacts  # the joints' torques, then a friction pyramid for each foot
    bounds = 12 + rows  # those of the 12 unknowns come first
    A, lower, upper = work.A[:rows], work.lower[:bounds], work.upper[:bounds]
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
