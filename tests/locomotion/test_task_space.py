"""The task-space program beside the paper's form of it, and what a solution obeys."""

# ruff: noqa: N806 - matrices keep their usual capitals

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from benchmarks.judges.task_space import paper_program
from hcbf_gym.locomotion import qp
from hcbf_gym.locomotion.body_reference import (
    LEASH,
    REFERENCE,
)
from hcbf_gym.locomotion.dynamics import Dynamics, rigid_body_terms
from hcbf_gym.locomotion.feet import TARGETS
from hcbf_gym.locomotion.leg import foot_kinematics
from hcbf_gym.locomotion.model import RobotModel
from hcbf_gym.locomotion.rotation import rotation_matrix, rotation_vector_to_yaw
from hcbf_gym.locomotion.state import StateViews
from hcbf_gym.locomotion.task_space import WORKSPACE, condense, free_minimiser
from hcbf_gym.locomotion.tasks import (
    CATCH_UP,
    PLANE_KD,
    PLANE_KP,
    TaskAccelerations,
    task_accelerations,
)
from hcbf_gym.robots.reader import read_robot

ORIGIN = np.zeros(3)
ROBOT = read_robot()
MODEL = RobotModel(ROBOT)
LIMITS = np.outer([-1.0, 1.0], ROBOT.stall_torque)
examples = settings(deadline=None, max_examples=40)  # the first one may compile
speeds = st.floats(-1.0, 1.0)


def at_rest() -> np.record:
    return np.zeros(1, dtype=REFERENCE)[0]


@examples
@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4), st.floats(-3, 3))
def test_the_orientation_error_is_the_rotation_s_logarithm(quaternion, yaw):
    q = np.array(quaternion)
    q[0] += 1.5
    R = rotation_matrix(q / np.linalg.norm(q))
    goal = pin.rpy.rpyToMatrix(0.0, 0.0, yaw)
    expected = pin.log3(R.T @ goal)
    assume(np.linalg.norm(expected) < 3.0)  # at π the logarithm has two values
    np.testing.assert_allclose(rotation_vector_to_yaw(R, yaw), expected, atol=1e-7)


STANCES = [(1, 0, 0, 1), (0, 1, 1, 0), (1, 1, 1, 1), (1, 1, 0, 1), (0, 0, 0, 0)]


def problem(seed: int, stance: tuple[int, ...], effort: float = 1.0):
    """Return the arguments of both programs at a random state near the stance, and q."""
    rng = np.random.default_rng(seed)
    quaternion = np.array([1.0, *(0.1 * rng.standard_normal(3))])
    state = StateViews(
        np.array([0.0, 0.0, 0.27]),
        quaternion / np.linalg.norm(quaternion),
        0.3 * rng.standard_normal(3),
        0.5 * rng.standard_normal(3),
        ROBOT.home_joints + 0.2 * rng.standard_normal(12),
        rng.standard_normal(12),
        np.array(stance, dtype=bool),
    )
    R = rotation_matrix(state.quaternion)
    v = np.concatenate([R.T @ state.linear_velocity, state.angular_velocity, state.joint_velocity])
    M, bias = rigid_body_terms(MODEL.bodies, MODEL.legs, R, v, state.joint_position)
    feet = foot_kinematics(MODEL.legs, state.joint_position, state.joint_velocity)
    tasks = TaskAccelerations(
        effort * rng.standard_normal(3),
        effort * rng.standard_normal(3),
        10.0 * effort * rng.standard_normal((4, 3)),
    )
    q = np.concatenate(
        [state.position, state.quaternion[1:], state.quaternion[:1], state.joint_position]
    )
    robot = Dynamics(M, bias, v, R, feet, np.array(stance, dtype=np.uint8))
    return (robot, tasks, 0.6, LIMITS), q


def condensed(args) -> tuple[qp.QuadraticProgram, np.record]:
    w = np.zeros(1, dtype=WORKSPACE)[0]
    rows = 12 + 4 * condense(*args, w)
    return qp.QuadraticProgram(
        w.H, w.f, w.A[:rows], w.lower[: 12 + rows], w.upper[: 12 + rows], 0
    ), w


@examples
@given(st.floats(-np.pi, np.pi), st.floats(-np.pi, np.pi), st.floats(0.0, LEASH), speeds)
def test_the_trunk_is_never_asked_to_catch_up_much_above_the_speed_cap(course, side, lag, speed):
    args, _ = problem(0, (1, 1, 1, 1))
    reference, targets = at_rest(), np.zeros(1, dtype=TARGETS)[0]
    targets.stance[:] = 1
    reference.velocity[:] = np.cos(course), np.sin(course)
    reference.position[:] = lag * np.cos(side), lag * np.sin(side)
    velocity = np.array([speed, -speed, 0.0])
    still = np.array([1.0, 0.0, 0.0, 0.0])
    state = StateViews(ORIGIN, still, velocity, ORIGIN, np.zeros(12), np.zeros(12), targets.stance)
    asked = task_accelerations(state, np.eye(3), args[0].feet, reference, targets, 0.0, 1.0).linear[
        :2
    ]
    wanted = asked / PLANE_KD + velocity[:2]  # the velocity at which nothing more is asked
    assert np.linalg.norm(wanted) <= 1.0 + CATCH_UP + 1e-9
    pd = PLANE_KP * reference.position + PLANE_KD * (reference.velocity - velocity[:2])
    free = (
        np.linalg.norm(reference.velocity + PLANE_KP / PLANE_KD * reference.position)
        <= 1.0 + CATCH_UP
    )
    if free:
        np.testing.assert_allclose(asked, pd, atol=1e-9)


@pytest.mark.parametrize("stance", STANCES)
@pytest.mark.parametrize("effort", [1.0, 8.0])  # 8 makes friction and torque limits bind
def test_the_torques_are_those_of_the_paper_s_program(stance, effort):
    for seed in range(5):
        args, _ = problem(seed, stance, effort)
        program, work = condensed(args)
        ours = qp.solve(program)
        reference = qp.solve(paper_program(*args))
        assert ours.x is not None
        assert reference.x is not None
        np.testing.assert_allclose(
            program.A[:12] @ ours.x + work.torque_offset, reference.x[18:30], atol=1e-4
        )


@pytest.mark.parametrize("stance", STANCES)
def test_solutions_meet_the_kkt_conditions(stance):
    complementary = 0
    for effort in (1.0, 8.0):
        program, _ = condensed(problem(1, stance, effort)[0])
        solution = qp.solve(program)
        assert qp.residual(program, solution) < 1e-6
        _, _, A, lower, upper, _ = program
        rows = np.concatenate([solution.x, A @ solution.x])
        multipliers = solution.multipliers
        slack = np.where(multipliers > 0, upper - rows, rows - lower)
        bound = np.abs(multipliers) > 1e-9
        assert (np.abs(slack[bound]) < 1e-6).all()
        complementary += bound.sum()
    assert (complementary > 0) == any(stance)  # in the air nothing is at its bound


def test_without_a_binding_bound_the_free_minimiser_is_the_solver_s_answer():
    counts = {True: 0, False: 0}
    for seed in range(20):
        program, work = condensed(problem(seed, (1, 1, 1, 1), 0.25 * seed)[0])
        free = free_minimiser(work, len(program.A))
        counts[free] += 1
        solution = qp.solve(program)
        if free:
            np.testing.assert_allclose(work.z, solution.x, atol=1e-6)
        else:
            assert np.abs(solution.multipliers).max() > 0.0
    assert min(counts.values()) > 0


@pytest.mark.parametrize("stance", STANCES)
def test_a_solution_of_the_paper_s_form_obeys_newton(stance):
    args, q = problem(2, stance)
    v = args[0].v
    x = qp.solve(paper_program(*args)).x
    assert x is not None
    acceleration, forces = x[:18], x[30:].reshape(-1, 3)
    data = MODEL.pinocchio.createData()
    rate = pin.computeCentroidalMomentumTimeVariation(
        MODEL.pinocchio, data, q, v, acceleration
    ).linear
    weight = np.array([0.0, 0.0, -9.81 * MODEL.bodies.mass.sum()])
    np.testing.assert_allclose(rate, forces.sum(axis=0) + weight, atol=1e-6)
    assert (np.abs(forces[:, :2]) <= 0.6 * forces[:, 2:] + 1e-6).all()
    assert (np.abs(x[18:30]) <= 33.5 + 1e-6).all()


def test_a_program_without_a_solution_is_told_as_such():
    program, _ = condensed(problem(0, (1, 0, 0, 1))[0])
    program.lower[2], program.upper[2] = 1.0, -1.0
    solution = qp.solve(program)
    assert solution.x is None
    assert solution.exitflag < 0
    assert qp.residual(program, solution) == np.inf
