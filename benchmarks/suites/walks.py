"""Walks of the A1 that the locomotion suite takes its figures from."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import _core, scenarios
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.envs.a1_physics import A1Physics
from hcbf_gym.locomotion.controller import BodyReference, LocomotionController
from hcbf_gym.locomotion.gait import GAITS
from hcbf_gym.locomotion.leg import foot_kinematics
from hcbf_gym.locomotion.state import RobotState
from hcbf_gym.policies.pd import pd_law
from hcbf_gym.robots.reader import Quadruped

Input = Callable[[float, BodyReference, RobotState], Array]

DT = 0.002
CONTROL_TICKS = 10  # u is held for 20 ms
SPEED_CAP = 1.2  # [m/s]


class Measure(NamedTuple):
    """One line of the table."""

    section: str  # what is measured
    name: str  # under which circumstances
    value: float  # the figure
    unit: str  # of the value
    bound: float  # what is required
    at_least: bool = False  # whether the bound is a lower one

    @property
    def met(self) -> bool:
        """Whether the bound holds."""
        return bool(self.value >= self.bound if self.at_least else self.value <= self.bound)


class Walk(NamedTuple):
    """What was recorded, a row per tick."""

    state: RobotState  # of the robot, as arrays stacked along time
    reference: Array  # (n, 5) position, velocity and yaw of the body reference
    torque: Array  # (n, 12) what the motors delivered in the tick that follows [N·m]
    saturated: Mask  # (n,) whether a motor delivered all that it can at its speed
    sole: Array  # (n, 4, 2) velocity along the ground of each foot's lowest point [m/s]
    mass: float  # of the robot [kg]
    fell: bool  # whether it did
    failed: int  # task-space QPs without a solution


def walk(
    seconds: float,
    u: Input,
    *,
    seed: int = 0,
    yaw: float = 0.0,
    simulation: Mapping[str, Any] | None = None,
    gait: str = "trot",
    heading: str = "velocity",
) -> Walk:
    """Walk under u, sampled every 20 ms, from rest at the origin."""
    plant = A1Physics(**(simulation or {}))
    plant.reset(np.zeros(2), yaw, np.random.default_rng(seed))
    brain = LocomotionController(gait=gait, heading=heading, max_speed=SPEED_CAP)
    brain.reset(plant.state())
    states, references, torques = [], [], []
    reference, command = brain.reference, np.zeros(2)
    for tick in range(round(seconds / DT)):
        state = plant.state()
        if tick % CONTROL_TICKS == 0:
            reference = brain.reference
            command = np.clip(u(tick * DT, reference, state), -5.0, 5.0)
        plant.step(brain.step(state, command))
        states.append(state)
        torques.append(plant.data.ctrl.copy())
        references.append([*reference.position, *reference.velocity, reference.yaw])
        if plant.fallen:
            break
    stacked = RobotState(np.array([state.vector for state in states]))
    sole = np.array(
        [_sole_velocity(brain.model.legs, plant.robot.foot_radius, state) for state in states]
    )
    torque = np.array(torques)
    saturated = _saturated(plant.robot, stacked, torque)
    return Walk(
        stacked,
        np.array(references),
        torque,
        saturated,
        sole,
        float(brain.model.bodies.mass.sum()),
        plant.fallen,
        brain.failed,
    )


def _saturated(robot: Quadruped, state: RobotState, torque: Array) -> Mask:
    saturated = np.zeros(len(torque), dtype=np.bool_)
    for tick, (rate, delivered) in enumerate(zip(state.joint_velocity, torque, strict=True)):
        limits = _core.torque_limits(robot.stall_torque, robot.no_load_speed, rate)
        at_limit = (delivered <= limits[0] + 1e-9) | (delivered >= limits[1] - 1e-9)
        saturated[tick] = at_limit.any()
    return saturated


def _sole_velocity(legs: Any, foot_radius: float, state: RobotState) -> Array:
    """Return (4, 2) how fast the lowest point of each foot moves along the ground."""
    rotation = _core.rotation_matrix(state.quaternion)
    feet = foot_kinematics(legs, state.joint_position, state.joint_velocity)
    sole = np.empty((4, 2))
    for foot in range(4):
        q, rate = state.joint_position[3 * foot :], state.joint_velocity[3 * foot :]
        swing = rotation @ np.cross(state.angular_velocity, feet.position[foot])
        own = rotation @ feet.jacobian[foot] @ rate[:3]
        # the calf turns with the trunk, the abad joint about x and both pitch joints about y
        abad = np.array([0.0, np.cos(q[0]), np.sin(q[0])])
        spin = rotation @ (
            state.angular_velocity + [rate[0], 0.0, 0.0] + (rate[1] + rate[2]) * abad
        )
        rolling = np.cross(spin, np.array([0.0, 0.0, -foot_radius]))
        sole[foot] = (state.linear_velocity + swing + own + rolling)[:2]
    return sole


def towards(velocity: Array, acceleration: float) -> Input:
    """Return the input that brings the reference to a velocity (2,) and keeps it there."""

    def u(_t: float, reference: BodyReference, _state: RobotState) -> Array:
        change = (velocity - reference.velocity) / (CONTROL_TICKS * DT)
        size = float(np.linalg.norm(change))
        return change * min(1.0, acceleration / size) if size > 0.0 else change

    return u


def stride_average(values: Array) -> Array:
    """Return the means over whole strides of the trot along the first axis."""
    stride = round(GAITS["trot"].period / DT)
    strides = len(values) // stride
    return values[: strides * stride].reshape(strides, stride, *values.shape[1:]).mean(axis=1)


def slip_per_step(walked: Walk, start: int) -> float:
    """Return how far a foot's point of contact moves from touchdown to lift-off, on average [m]."""
    distances = []
    for foot in range(4):
        velocity = walked.sole[start:, foot]
        touching = walked.state.foot_contact[start:, foot]
        ends = np.flatnonzero(touching[:-1] & ~touching[1:]) + 1
        starts = np.flatnonzero(~touching[:-1] & touching[1:]) + 1
        for lift_off in ends[ends > starts[0]]:
            touchdown = starts[starts < lift_off][-1]
            # a tick moves by the velocity at its end
            moved = velocity[touchdown + 1 : lift_off + 1].sum(axis=0) * DT
            distances.append(float(np.linalg.norm(moved)))
    return float(np.mean(distances))


def follow_course(simulation: Mapping[str, Any] | None = None) -> tuple[Walk, Array]:
    """Walk the paper's 20 s course unfiltered; return the walk and (n,) the tracking error [m]."""
    course = scenarios.make("paper-simulation", np.random.default_rng(0)).reference

    def u(t: float, _reference: BodyReference, state: RobotState) -> Array:
        position, velocity = course(t)
        pd = pd_law(position - state.position[:2], velocity - state.linear_velocity[:2])
        return pd + course.acceleration(t)

    direction = course(20.0)[0]
    yaw = float(np.arctan2(direction[1], direction[0]))
    walked = walk(20.0, u, yaw=yaw, simulation=simulation)
    desired = np.array([course(tick * DT)[0] for tick in range(len(walked.reference))])
    return walked, np.linalg.norm(walked.state.position[:, :2] - desired, axis=1)
