"""One tick of the controller, from the state to the QP: the compiled half of the paper's Fig. 2.

Entering compiled code costs time per argument, so that what stays and what is remembered from tick
to tick travel as one record each.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Mask, Records
from hcbf_gym.compilation import kernel
from hcbf_gym.locomotion.body_reference import REFERENCE, BodyReference, advance
from hcbf_gym.locomotion.dynamics import BODIES, Dynamics, rigid_body_terms
from hcbf_gym.locomotion.feet import TARGETS, Places, plan_feet
from hcbf_gym.locomotion.foothold import Trunk
from hcbf_gym.locomotion.gait import GAIT, advance_clock, foot_phases
from hcbf_gym.locomotion.impedance import joint_feedback
from hcbf_gym.locomotion.leg import LEGS, foot_kinematics
from hcbf_gym.locomotion.matrices import apply, apply_transposed
from hcbf_gym.locomotion.rotation import rotation_matrix, yaw_of
from hcbf_gym.locomotion.state import StateViews, state_views
from hcbf_gym.locomotion.task_space import condense, free_minimiser, take_solution
from hcbf_gym.locomotion.tasks import TaskAccelerations, task_accelerations
from hcbf_gym.robots.motors import torque_limits

GROUND_GAIN = 0.02  # per tick, by which the ground's estimate follows the standing feet
FULL_GRIP = 0.6  # µ on which the robot turns as fast as it can
# what the model leaves out (impacts, latency) grows with the speed and would lift the trunk
HEIGHT_KI, MAX_LIFT = 300.0, 8.0  # [1/s³], [m/s²]

# a gait that rests may rest while all of these stay below
QUIET_INPUT = 0.02  # [m/s²] asked of the robot, and [m/s] of its reference
QUIET_VELOCITY = 0.08  # [m/s] in any direction
QUIET_ROTATION = 0.4  # [rad/s] about any axis
QUIET_DISTANCE = 0.02  # [m] from the reference

SETTINGS = np.dtype(
    (
        np.record,
        [
            ("timestep", "f8"),  # [s]
            ("friction", "f8"),  # µ of the friction pyramid
            ("stall_torque", "f8", 12),  # of the joints at rest [N·m]
            ("no_load_speed", "f8", 12),  # of the joints [rad/s]
            ("height", "f8"),  # of the trunk above the ground [m]
            ("max_speed", "f8"),  # cap on the reference's speed [m/s]
            ("follow_velocity", "u1"),  # whether the heading does
            ("foot_radius", "f8"),  # [m]
            ("gait", GAIT),
            ("legs", LEGS),
            ("nominal", "f8", (4, 2)),  # footholds at rest in the trunk's axes [m]
            ("bodies", BODIES),
        ],
    )
)

MEMORY = np.dtype(
    (
        np.record,
        [
            ("reference", REFERENCE),
            ("targets", TARGETS),
            ("clock", "f8"),  # of the gait [s]
            ("ground", "f8"),  # estimated height of the ground [m]
            ("lift", "f8"),  # learnt acceleration upwards that holds the trunk's height [m/s²]
        ],
    )
)


class TickPlan(NamedTuple):
    """What a tick has decided when it comes to the QP.

    Attributes:
        robot: at this instant.
        tasks: the accelerations to come close to.
        feedback: (12,) torques of the joint impedance [N·m].
    """

    robot: Dynamics
    tasks: TaskAccelerations
    feedback: Array


@kernel()
def generalised_velocity(state: StateViews, R: Array) -> Array:
    """Return v (18,): trunk linear and angular in the trunk's axes, then the joints."""
    v = np.empty(18)
    v[:3] = apply_transposed(R, state.linear_velocity)
    v[3:6] = state.angular_velocity
    v[6:] = state.joint_velocity
    return v


@kernel()
def is_quiet(state: StateViews, reference: BodyReference, u: Array, resting: bool) -> bool:
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


@kernel()
def ground_height(ground: float, feet: Array, carrying: Mask, radius: float) -> float:
    """Return the ground's height [m], drawn slowly towards the feet (4, 3) that carry (4,)."""
    total, count = 0.0, 0
    for foot in range(4):
        if carrying[foot]:
            total += feet[foot, 2] - radius
            count += 1
    return ground + GROUND_GAIN * (total / count - ground) if count else ground


@kernel()
def plan(settings: np.record, memory: np.record, state: StateViews, u: Array) -> TickPlan:
    """Return what comes before the QP: gait → footholds → swing → tasks, and the impedance.

    Args:
        settings: a `SETTINGS` record.
        memory: a `MEMORY` record, moved on by one tick.
        state: as measured.
        u: (2,) desired acceleration of the trunk in the world [m/s²].
    """
    dt, reference, targets = settings.timestep, memory.reference, memory.targets
    R = rotation_matrix(state.quaternion)
    v = generalised_velocity(state, R)
    M, bias = rigid_body_terms(settings.bodies, settings.legs, R, v, state.joint_position)
    feet = foot_kinematics(settings.legs, state.joint_position, state.joint_velocity)
    feet_in_world = np.empty((4, 3))
    for foot in range(4):
        feet_in_world[foot] = state.position + apply(R, feet.position[foot])

    grip = min(1.0, settings.friction / FULL_GRIP)
    advance(reference, u, state.position, dt, settings.max_speed, settings.follow_velocity, grip)
    phases = foot_phases(settings.gait, memory.clock, state.foot_contact)
    carrying = phases.stance & state.foot_contact
    memory.ground = ground_height(memory.ground, feet_in_world, carrying, settings.foot_radius)
    places = Places(feet_in_world, settings.nominal, memory.ground + settings.foot_radius)
    trunk = Trunk(state.position, state.linear_velocity, yaw_of(R), settings.height)
    plan_feet(targets, phases, settings.gait, places, trunk, reference, dt)
    too_low = memory.ground + settings.height - state.position[2]
    memory.lift += dt * HEIGHT_KI * too_low
    memory.lift = min(max(memory.lift, -MAX_LIFT), MAX_LIFT)
    tasks = task_accelerations(state, R, feet, reference, targets, too_low, settings.max_speed)
    tasks.linear[2] += memory.lift
    feedback = joint_feedback(state, R, settings.legs, feet, targets, reference)
    quiet = is_quiet(state, reference, u, memory.clock < 0.0)
    memory.clock = advance_clock(settings.gait, memory.clock, quiet, dt)
    return TickPlan(Dynamics(M, bias, v, R, feet, targets.stance), tasks, feedback)


@kernel()
def tick(
    settings: Records,
    memory: Records,
    workspace: Records,
    state: Array,
    u: Array,
) -> tuple[int, bool]:
    """Run a tick up to the QP; return how many feet stand and whether no bound binds.

    If none binds, the QP is solved and the torques are set.

    Args:
        settings: (1,) `SETTINGS`.
        memory: (1,) `MEMORY`, moved on by one tick.
        workspace: (1,) `WORKSPACE`, filled in.
        state: (41,) the vector of a `RobotState`.
        u: (2,) desired acceleration of the trunk in the world [m/s²].
    """
    robot = settings[0]
    work = workspace[0]
    now = state_views(state)
    torque_limits(robot.stall_torque, robot.no_load_speed, now.joint_velocity, work.limits)
    p = plan(robot, memory[0], now, u)
    contacts = condense(p.robot, p.tasks, robot.friction, work.limits, work)
    work.feedback[:] = p.feedback
    free = free_minimiser(work, 12 + 4 * contacts)
    if free:
        take_solution(work)
    return contacts, free
