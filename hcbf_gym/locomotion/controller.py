"""The locomotion controller: a planar acceleration in, twelve joint torques out, at 500 Hz."""

from pathlib import Path

import numpy as np

from hcbf_gym.errors import choose, finite_float
from hcbf_gym.locomotion import qp
from hcbf_gym.locomotion.body_reference import BodyReference, BodyReferenceGenerator
from hcbf_gym.locomotion.condensed import condense
from hcbf_gym.locomotion.feet import plan_feet, standing
from hcbf_gym.locomotion.foothold import nominal_stance
from hcbf_gym.locomotion.gait import GAITS, GaitClock
from hcbf_gym.locomotion.impedance import joint_impedance
from hcbf_gym.locomotion.leg import foot_kinematics
from hcbf_gym.locomotion.model import RobotModel
from hcbf_gym.locomotion.rotation import rotation_matrix, yaw_of
from hcbf_gym.locomotion.state import Array, RobotState
from hcbf_gym.locomotion.tasks import task_accelerations
from hcbf_gym.robots import a1

GROUND_GAIN = 0.02  # per tick, by which the ground's estimate follows the standing feet

# a gait that rests stands still while all of these stay below
QUIET_INPUT = 0.02  # [m/s²] asked of the robot, and [m/s] of its reference
QUIET_VELOCITY = 0.08  # [m/s] in any direction
QUIET_ROTATION = 0.4  # [rad/s] about any axis
QUIET_DISTANCE = 0.02  # [m] from the reference


class LocomotionController:
    """Walks a quadruped so that its trunk accelerates by u in the plane.

    Args:
        xml_file: MJCF of the robot alone, from which the controller's own model is read.
        timestep: of the control loop [s].
        friction: µ of the friction pyramid that the contact forces keep to.
        gait: a name from `GAITS`; "stand" stands still until something is asked or disturbs.
        max_speed: cap on the reference's speed [m/s].
        height: of the trunk above the ground [m].
        heading: "velocity" turns the trunk along its velocity, "fixed" keeps it as at reset.

    Raises:
        RobotModelError: if the file is no model of the A1's kind; the message names the joints.
        InvalidInputError: on an unknown gait or heading, or a number out of range.
    """

    def __init__(
        self,
        xml_file: Path = a1.XML_FILE,
        *,
        timestep: float = 0.002,
        friction: float = 0.6,
        gait: str = "trot",
        max_speed: float = 1.2,
        height: float = a1.HOME_HEIGHT,
        heading: str = "velocity",
    ) -> None:
        self.timestep = finite_float("timestep", timestep, minimum=0.0, exclusive=True)
        self.friction = finite_float("friction", friction, minimum=0.0, exclusive=True)
        self.height = finite_float("height", height, minimum=0.0, exclusive=True)
        max_speed = finite_float("max_speed", max_speed, minimum=0.0, exclusive=True)
        follow_velocity = choose("heading", heading, {"velocity": True, "fixed": False})
        self.model = RobotModel(xml_file)
        self.clock = GaitClock(choose("gait", gait, GAITS), timestep)
        self.generator = BodyReferenceGenerator(timestep, max_speed, follow_velocity)
        self._nominal = nominal_stance(self.model.legs.hip)
        self._targets = standing(np.zeros((4, 3)))
        self._ground = 0.0
        self._feedforward = np.zeros(12)
        self.solved = 0
        self.failed = 0

    @property
    def reference(self) -> BodyReference:
        """Where the trunk shall be: the reduced-order model's own state, and the heading."""
        return self.generator.latest

    def reset(self, state: RobotState) -> None:
        """Forget the past and start from rest where the robot is."""
        R = rotation_matrix(state.quaternion)
        feet = state.position + self._feet(state).position @ R.T
        self.clock.reset()
        self.generator.reset(state.position, yaw_of(R))
        self._targets = standing(feet)
        self._ground = float(feet[:, 2].mean()) - a1.FOOT_RADIUS
        self._feedforward = np.zeros(12)
        self.solved = 0
        self.failed = 0

    def step(self, state: RobotState, u: Array) -> Array:
        """Return (12,) joint torques [N·m] for the coming tick.

        Args:
            state: as measured now.
            u: (2,) desired acceleration of the trunk in the world [m/s²].
        """
        position, velocity = state.position, state.linear_velocity
        omega, contact = state.angular_velocity, state.foot_contact
        R = rotation_matrix(state.quaternion)

        reference = self.generator.advance(u, position)
        q, v = self.model.coordinates(state, R)
        M, bias = self.model.dynamics(q, v)
        feet = self._feet(state)
        feet_in_world = position + feet.position @ R.T

        phases = self.clock.advance(self._quiet(state, u), contact)
        standing_feet = phases.stance & contact
        if standing_feet.any():
            ground = feet_in_world[standing_feet, 2].mean() - a1.FOOT_RADIUS
            self._ground += GROUND_GAIN * (float(ground) - self._ground)
        targets = plan_feet(
            self._targets,
            phases,
            self.clock.gait,
            feet_in_world,
            self._nominal,
            position,
            velocity,
            yaw_of(R),
            reference,
            self.height,
            self._ground + a1.FOOT_RADIUS,
            self.timestep,
        )
        self._targets = targets

        tasks = task_accelerations(
            position,
            velocity,
            R,
            omega,
            state.joint_velocity,
            feet,
            reference,
            targets,
            self._ground + self.height,
        )
        program, offset = condense(
            M, bias, v, R, feet, targets.stance, tasks, self.friction, a1.TORQUE_LIMIT
        )
        solution = qp.solve(program)
        if solution.x is None:
            self.failed += 1
        else:
            self.solved += 1
            self._feedforward = program.A[:12] @ solution.x + offset

        return joint_impedance(
            self._feedforward,
            state.joint_position,
            state.joint_velocity,
            self.model.legs,
            feet,
            targets,
            reference,
            position,
            velocity,
            R,
            omega,
            a1.TORQUE_LIMIT,
        )

    def _feet(self, state: RobotState):
        return foot_kinematics(self.model.legs, state.joint_position, state.joint_velocity)

    def _quiet(self, state: RobotState, u: Array) -> bool:
        """Return whether a resting gait may rest; leaving rest takes twice as much as entering."""
        scale = 2.0 if self.clock.resting else 1.0
        reference = self.reference
        return bool(
            np.abs(u).max() < scale * QUIET_INPUT
            and np.abs(reference.velocity).max() < scale * QUIET_INPUT
            and np.abs(state.linear_velocity).max() < scale * QUIET_VELOCITY
            and np.abs(state.angular_velocity).max() < scale * QUIET_ROTATION
            and np.abs(state.position[:2] - reference.position).max() < scale * QUIET_DISTANCE
            and abs(reference.yaw_rate) < QUIET_ROTATION
        )
