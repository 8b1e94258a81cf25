"""The task-space program beside the paper's form of it, and what a solution obeys."""

# ruff: noqa: N806 - matrices keep their usual capitals

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from benchmarks.judges.task_space import DYNAMICS, TASKS, paper_program
from hcbf_gym import _core
from hcbf_gym._core import CATCH_UP, LEASH, PLANE_KD, PLANE_KP, rotation_matrix
from hcbf_gym.arrays import attributes, packed, words_of
from hcbf_gym.locomotion import qp
from hcbf_gym.locomotion.leg import foot_kinematics
from hcbf_gym.locomotion.model import RobotModel
from hcbf_gym.locomotion.records import BODIES, LEGS, REFERENCE, TARGETS, WORKSPACE
from hcbf_gym.locomotion.state import STATE_SIZE, RobotState
from hcbf_gym.robots.reader import read_robot

ROBOT = read_robot()
MODEL = RobotModel(ROBOT)
LIMITS = np.outer([-1.0, 1.0], ROBOT.stall_torque)
examples = settings(deadline=None, max_examples=40)
speeds = st.floats(-1.0, 1.0)


@examples
@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4), st.floats(-3, 3))
def test_the_orientation_error_is_the_rotation_s_logarithm(quaternion, yaw):
    q = np.array(quaternion)
    q[0] += 1.5
    R = rotation_matrix(q / np.linalg.norm(q))
    goal = pin.rpy.rpyToMatrix(0.0, 0.0, yaw)
    expected = pin.log3(R.T @ goal)
    assume(np.linalg.norm(expected) < 3.0)  # at π the logarithm has two values
    np.testing.assert_allclose(_core.rotation_vector_to_yaw(R, yaw), expected, atol=1e-7)


STANCES = [(1, 0, 0, 1), (0, 1, 1, 0), (1, 1, 1, 1), (1, 1, 0, 1), (0, 0, 0, 0)]


def problem(seed: int, stance: tuple[int, ...], effort: float = 1.0):
    """Return robot (1,) and tasks (1,) at a random state near the stance, and q."""
    rng = np.random.default_rng(seed)
    quaternion = np.array([1.0, *(0.1 * rng.standard_normal(3))])
    state = RobotState(np.zeros(STATE_SIZE))
    state.position[2] = 0.27
    state.quaternion[:] = quaternion / np.linalg.norm(quaternion)
    state.linear_velocity[:] = 0.3 * rng.standard_normal(3)
    state.angular_velocity[:] = 0.5 * rng.standard_normal(3)
    state.joint_position[:] = ROBOT.home_joints + 0.2 * rng.standard_normal(12)
    state.joint_velocity[:] = rng.standard_normal(12)
    R = rotation_matrix(state.quaternion)
    v = np.concatenate([R.T @ state.linear_velocity, state.angular_velocity, state.joint_velocity])
    model = packed(MODEL.bodies, BODIES), packed(MODEL.legs, LEGS)
    M, bias = _core.rigid_body_terms(*model, R, v, state.joint_position)
    feet = foot_kinematics(MODEL.legs, state.joint_position, state.joint_velocity)
    tasks = (
        effort * rng.standard_normal(3),
        effort * rng.standard_normal(3),
        10.0 * effort * rng.standard_normal((4, 3)),
    )
    q = np.concatenate(
        [state.position, state.quaternion[1:], state.quaternion[:1], state.joint_position]
    )
    robot = np.array([(M, bias, v, R, feet, np.array(stance, dtype=bool))], dtype=DYNAMICS)
    return robot, np.array([tasks], dtype=TASKS), q


def paper(robot: np.ndarray, tasks: np.ndarray) -> qp.QuadraticProgram:
    return paper_program(attributes(robot), attributes(tasks), 0.6, LIMITS)


def condensed(robot: np.ndarray, tasks: np.ndarray) -> tuple[qp.QuadraticProgram, np.ndarray]:
    """Return the program that runs, and its workspace (1,)."""
    workspace = np.zeros(1, dtype=WORKSPACE)
    packed = map(words_of, (robot, tasks))
    contacts = _core.condense_task_space(*packed, 0.6, LIMITS, words_of(workspace))
    w, rows = attributes(workspace), 12 + 4 * contacts
    program = qp.QuadraticProgram(
        w.H, w.f, w.A[:rows], w.lower[: 12 + rows], w.upper[: 12 + rows], 0
    )
    return program, workspace


@examples
@given(st.floats(-np.pi, np.pi), st.floats(-np.pi, np.pi), st.floats(0.0, LEASH), speeds)
def test_the_trunk_is_never_asked_to_catch_up_much_above_the_speed_cap(course, side, lag, speed):
    robot, tasks, _ = problem(0, (1, 1, 1, 1))
    references, targets = np.zeros(1, dtype=REFERENCE), np.zeros(1, dtype=TARGETS)
    reference = attributes(references)
    targets["stance"] = True
    reference.velocity[:] = np.cos(course), np.sin(course)
    reference.position[:] = lag * np.cos(side), lag * np.sin(side)
    velocity = np.array([speed, -speed, 0.0])
    state = RobotState(np.zeros(STATE_SIZE))
    state.quaternion[0] = 1.0
    state.linear_velocity[:] = velocity
    records = map(words_of, (robot["feet"].copy(), references, targets))
    _core.task_accelerations(state.vector, np.eye(3), *records, 0.0, 1.0, words_of(tasks))
    asked = tasks["linear"][0, :2]
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
        robot, tasks, _ = problem(seed, stance, effort)
        program, work = condensed(robot, tasks)
        ours = qp.solve(program)
        reference = qp.solve(paper(robot, tasks))
        assert ours.x is not None
        assert reference.x is not None
        np.testing.assert_allclose(
            program.A[:12] @ ours.x + work["torque_offset"][0], reference.x[18:30], atol=1e-4
        )


@pytest.mark.parametrize("stance", STANCES)
def test_solutions_meet_the_kkt_conditions(stance):
    complementary = 0
    for effort in (1.0, 8.0):
        program, _ = condensed(*problem(1, stance, effort)[:2])
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
        program, work = condensed(*problem(seed, (1, 1, 1, 1), 0.25 * seed)[:2])
        free = _core.free_minimiser(words_of(work), len(program.A))
        counts[free] += 1
        solution = qp.solve(program)
        if free:
            np.testing.assert_allclose(work["z"][0], solution.x, atol=1e-6)
        else:
            assert np.abs(solution.multipliers).max() > 0.0
    assert min(counts.values()) > 0


@pytest.mark.parametrize("stance", STANCES)
def test_a_solution_of_the_paper_s_form_obeys_newton(stance):
    robot, tasks, q = problem(2, stance)
    v = robot["v"][0]
    x = qp.solve(paper(robot, tasks)).x
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


def test_a_program_without_a_solution_is_reported_as_such():
    program, _ = condensed(*problem(0, (1, 0, 0, 1))[:2])
    program.lower[2], program.upper[2] = 1.0, -1.0
    solution = qp.solve(program)
    assert solution.x is None
    assert solution.exitflag < 0
    assert qp.residual(program, solution) == np.inf
