"""One tick of the controller, from the state to the QP: the compiled half of the paper's Fig. 2."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.locomotion.body_reference import BodyReference, advance
from hcbf_gym.locomotion.condensed import condense
from hcbf_gym.locomotion.feet import FootTargets, plan_feet
from hcbf_gym.locomotion.gait import Gait, advance_clock, foot_phases
from hcbf_gym.locomotion.impedance import joint_feedback
from hcbf_gym.locomotion.leg import LegGeometry, foot_kinematics
from hcbf_gym.locomotion.model import generalised_velocity, with_joint_losses
from hcbf_gym.locomotion.rotation import rotation_matrix, yaw_of
from hcbf_gym.locomotion.state import Array, RobotState
from hcbf_gym.locomotion.task_space import TaskSpaceProgram, full_form
from hcbf_gym.locomotion.tasks import task_accelerations

GROUND_GAIN = 0.02  # per tick, by which the ground's estimate follows the standing feet

# a gait that rests may rest while all of these stay below
QUIET_INPUT = 0.02  # [m/s²] asked of the robot, and [m/s] of its reference
QUIET_VELOCITY = 0.08  # [m/s] in any direction
QUIET_ROTATION = 0.4  # [rad/s] about any axis
QUIET_DISTANCE = 0.02  # [m] from the reference


class Settings(NamedTuple):
    """What stays the same from tick to tick.

    Attributes:
        timestep: [s].
        friction: µ of the friction pyramid.
        torque_limit: of every joint [N·m].
        height: of the trunk above the ground [m].
        max_speed: cap on the reference's speed [m/s].
        follow_velocity: whether the heading follows the velocity.
        full_form: whether the QP is posed in (q̈, τ, F) instead of condensed.
        gait: in play.
        legs: their lengths.
        nominal: (4, 2) footholds at rest in the trunk's axes [m].
        foot_radius: [m].
        losses: (2, 12) the joints' damping [N·m·s/rad] and dry friction [N·m].
    """

    timestep: float
    friction: float
    torque_limit: float
    height: float
    max_speed: float
    follow_velocity: bool
    full_form: bool
    gait: Gait
    legs: LegGeometry
    nominal: Array
    foot_radius: float
    losses: Array


class Memory(NamedTuple):
    """What the controller carries from one tick to the next.

    Attributes:
        reference: of the trunk in the plane.
        targets: of the feet.
        clock: of the gait [s].
        ground: estimated height of the ground [m].
    """

    reference: BodyReference
    targets: FootTargets
    clock: float
    ground: float


class Tick(NamedTuple):
    """What one tick hands to the solver and to the joints.

    Attributes:
        memory: for the next tick.
        task_space: the task-space QP.
        feedback: (12,) torques of the joint impedance, to be added [N·m].
    """

    memory: Memory
    task_space: TaskSpaceProgram
    feedback: Array


@njit(cache=True)
def is_quiet(state: RobotState, reference: BodyReference, u: Array, resting: bool) -> bool:
    """Return whether nothing is asked and nothing disturbs; at rest twice as much is tolerated."""
    scale = 2.0 if resting else 1.0
    asked = max(np.abs(u).max(), np.abs(reference.velocity).max(), abs(reference.yaw_rate))
    away = np.abs(state.position[:2] - reference.position).max()
    return (
        asked < scale * QUIET_INPUT
        and away < scale * QUIET_DISTANCE
        and np.abs(state.linear_velocity).max() < scale * QUIET_VELOCITY
        and np.abs(state.angular_velocity).max() < scale * QUIET_ROTATION
    )


@njit(cache=True)
def ground_height(ground: float, feet: Array, carrying: NDArray[np.bool_], radius: float) -> float:
    """Return the ground's height [m], drawn slowly towards the feet (4, 3) that carry (4,)."""
    total, count = 0.0, 0
    for foot in range(4):
        if carrying[foot]:
            total += feet[foot, 2] - radius
            count += 1
    return ground + GROUND_GAIN * (total / count - ground) if count else ground


@njit(cache=True)
def plan(
    settings: Settings,
    memory: Memory,
    state: RobotState,
    u: Array,
    M: Array,
    nonlinear_effects: Array,
) -> Tick:
    """Return the task-space QP of this tick: gait → footholds → swing → tasks → QP, impedance.

    Args:
        settings: of the controller.
        memory: of the tick before.
        state: as measured.
        u: (2,) desired acceleration of the trunk in the world [m/s²].
        M: (18, 18) mass matrix, upper triangle.
        nonlinear_effects: (18,) Coriolis, centrifugal and gravity forces.
    """
    gait, dt = settings.gait, settings.timestep
    R = rotation_matrix(state.quaternion)
    v = generalised_velocity(state, R)
    bias = with_joint_losses(nonlinear_effects, v, settings.losses)
    feet = foot_kinematics(settings.legs, state.joint_position, state.joint_velocity)
    feet_in_world = np.empty((4, 3))
    for foot in range(4):
        feet_in_world[foot] = state.position + R @ feet.position[foot]

    reference = advance(
        memory.reference, u, state.position, dt, settings.max_speed, settings.follow_velocity
    )
    phases = foot_phases(gait, memory.clock, state.foot_contact)
    ground = ground_height(
        memory.ground, feet_in_world, phases.stance & state.foot_contact, settings.foot_radius
    )
    targets = plan_feet(
        memory.targets,
        phases,
        gait,
        feet_in_world,
        settings.nominal,
        state.position,
        state.linear_velocity,
        yaw_of(R),
        reference,
        settings.height,
        ground + settings.foot_radius,
        dt,
    )
    tasks = task_accelerations(state, R, feet, reference, targets, ground + settings.height)
    if settings.full_form:
        task_space = full_form(
            M, bias, v, R, feet, targets.stance, tasks, settings.friction, settings.torque_limit
        )
    else:
        task_space = condense(
            M, bias, v, R, feet, targets.stance, tasks, settings.friction, settings.torque_limit
        )
    feedback = joint_feedback(state, R, settings.legs, feet, targets, reference)
    quiet = is_quiet(state, reference, u, memory.clock < 0.0)
    following = Memory(reference, targets, advance_clock(gait, memory.clock, quiet, dt), ground)
    return Tick(following, task_space, feedback)
