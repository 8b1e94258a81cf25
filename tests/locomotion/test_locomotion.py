"""The way from a planar acceleration to joint torques, stage by stage."""

# ruff: noqa: N806 - matrices keep their usual capitals

import json
import os
import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hcbf_gym.envs.physics import Physics
from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_gym.locomotion import qp
from hcbf_gym.locomotion.body_reference import (
    LEASH,
    MAX_YAW_ACCELERATION,
    MAX_YAW_RATE,
    REFERENCE,
    advance,
)
from hcbf_gym.locomotion.condensed import WORKSPACE, condense, free_minimiser
from hcbf_gym.locomotion.controller import LocomotionController
from hcbf_gym.locomotion.dynamics import rigid_body_terms
from hcbf_gym.locomotion.feet import TARGETS, plan_feet, stand
from hcbf_gym.locomotion.foothold import MAX_OFFSET, foothold, nominal_stance
from hcbf_gym.locomotion.gait import GAITS, RESTING, advance_clock, foot_phases
from hcbf_gym.locomotion.leg import foot_kinematics
from hcbf_gym.locomotion.model import RobotModel
from hcbf_gym.locomotion.rotation import rotation_matrix, rotation_vector_to_yaw
from hcbf_gym.locomotion.state import StateViews
from hcbf_gym.locomotion.swing import SWING_HEIGHT, minimum_jerk_step, swing_step
from hcbf_gym.locomotion.task_space import (
    FULL_WORKSPACE,
    QuadraticProgram,
    full_form,
    program_views,
)
from hcbf_gym.locomotion.tasks import (
    CATCH_UP,
    PLANE_KD,
    PLANE_KP,
    TaskAccelerations,
    task_accelerations,
)
from hcbf_gym.robots.reader import read_robot
from hcbf_gym.studies.benchmarks import walks

DT = 0.002
ORIGIN = np.zeros(3)
ROBOT = read_robot()
MODEL = RobotModel(ROBOT)
LIMITS = np.outer([-1.0, 1.0], ROBOT.stall_torque)
examples = settings(deadline=None, max_examples=40)  # the first one may compile
speeds = st.floats(-1.0, 1.0)


def at_rest() -> np.record:
    return np.zeros(1, dtype=REFERENCE)[0]


# the reduced-order model


@examples
@given(speeds, speeds, st.floats(0.1, 0.5))
def test_the_reference_is_the_exact_double_integrator_below_its_cap(ux, uy, duration):
    reference, u = at_rest(), np.array([ux, uy])
    ticks = round(duration / DT)
    for _ in range(ticks):
        place = np.array([*reference.position, 0.27])  # a robot that keeps up
        advance(reference, u, place, DT, 2.0, False)
    t = ticks * DT
    np.testing.assert_allclose(reference.velocity, u * t, atol=1e-12)
    np.testing.assert_allclose(reference.position, 0.5 * u * t**2, atol=1e-12)
    np.testing.assert_allclose(reference.acceleration, u, atol=1e-9)


@examples
@given(st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=1, max_size=8))
def test_the_reference_keeps_to_speed_leash_and_yaw_limits(inputs):
    reference = at_rest()
    for u in inputs:
        for _ in range(50):
            rate = reference.yaw_rate
            advance(reference, np.array(u), ORIGIN, DT, 1.2, True)
            assert np.linalg.norm(reference.velocity) <= 1.2 + 1e-12
            assert np.linalg.norm(reference.position) <= LEASH + 1e-12
            assert abs(reference.yaw_rate) <= MAX_YAW_RATE + 1e-12
            assert abs(reference.yaw_rate - rate) <= MAX_YAW_ACCELERATION * DT + 1e-12


@examples
@given(st.floats(-np.pi, np.pi))
def test_the_heading_turns_to_the_velocity_without_overshoot(direction):
    reference = at_rest()
    u = np.array([np.cos(direction), np.sin(direction)])
    errors = []
    for _ in range(1500):
        place = np.array([*reference.position, 0.27])
        advance(reference, u, place, DT, 0.8, True)
        errors.append((direction - reference.yaw + np.pi) % (2 * np.pi) - np.pi)
    assert abs(errors[-1]) < 1e-3
    overshoot = -np.min(np.sign(errors[200]) * np.array(errors[200:]))
    assert overshoot < np.radians(0.5)


def test_the_heading_is_held_while_the_velocity_is_noise():
    reference, rng = at_rest(), np.random.default_rng(0)
    reference.yaw = 1.0
    for _ in range(500):
        reference.velocity[:] = rng.uniform(-0.1, 0.1, 2)
        advance(reference, np.zeros(2), ORIGIN, DT, 1.2, True)
    assert reference.yaw == 1.0


# gait, footholds, swing


@pytest.mark.parametrize("name", ["trot", "walk"])
def test_each_foot_stands_for_the_gait_s_share_of_the_time(name):
    gait = GAITS[name]
    clocks = (np.arange(2000) + 0.5) * gait.period / 2000
    stance = np.array([foot_phases(gait, c, np.zeros(4, bool)).stance for c in clocks])
    np.testing.assert_allclose(stance.mean(axis=0), gait.duty, atol=1e-3)
    least = 2 if name == "trot" else 3
    assert stance.sum(axis=1).min() == least


@pytest.mark.parametrize("name", ["trot", "walk"])
def test_every_swing_lasts_the_same_number_of_ticks_for_minutes(name):
    gait, clock, stance = GAITS[name], 0.0, []
    for _ in range(60_000):
        stance.append(foot_phases(gait, clock, np.zeros(4, bool)).stance)
        clock = advance_clock(gait, clock, False, DT)
    for foot in np.array(stance).T:
        lift_offs = np.flatnonzero(foot[:-1] & ~foot[1:])
        touchdowns = np.flatnonzero(~foot[:-1] & foot[1:])
        assert (np.diff(lift_offs) == round(gait.period / DT)).all()
        assert (np.diff(touchdowns) == round(gait.period / DT)).all()


def test_a_foot_that_lands_late_in_its_swing_becomes_stance_and_an_early_touch_does_not():
    gait, touching = GAITS["trot"], np.ones(4, dtype=bool)
    early, late = 0.3 * 0.13, 0.7 * 0.13
    assert foot_phases(gait, early, touching).stance.tolist() == [True, False, False, True]
    assert foot_phases(gait, late, touching).stance.all()


def test_standing_rests_while_quiet_and_steps_at_once_when_disturbed():
    gait = GAITS["stand"]
    assert advance_clock(gait, RESTING, True, DT) == RESTING
    clock = advance_clock(gait, RESTING, False, DT)
    assert clock == 0.0
    assert not foot_phases(gait, clock, np.zeros(4, bool)).stance.all()
    while clock >= 0.0:
        before, clock = clock, advance_clock(gait, clock, True, DT)
    half = 0.5 * gait.period
    assert (before + DT) // half > before // half  # it stopped as feet landed


@examples
@given(speeds, speeds, st.floats(-2.0, 2.0), st.floats(0.0, 0.13))
def test_footholds_stay_within_reach_of_the_hip(vx, vy, yaw_rate, remaining):
    nominal = nominal_stance(MODEL.legs.hip)
    reference = at_rest()
    reference.yaw_rate = yaw_rate
    velocity = np.array([vx, vy, 0.0])
    for foot in range(4):
        landing = foothold(nominal[foot], ORIGIN, velocity, 0.0, reference, remaining, 0.13, 0.27)
        turned = yaw_rate * remaining
        turn = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
        hip = velocity[:2] * remaining + turn @ nominal[foot]
        assert np.linalg.norm(landing - hip) <= MAX_OFFSET + 1e-9


@examples
@given(st.floats(-0.2, 0.2), speeds, st.floats(-5, 5), st.floats(-0.2, 0.2))
def test_minimum_jerk_is_the_quintic_to_rest_at_the_target(p, v, a, target):
    T = 0.13
    powers = np.array([[1, T, T**2], [3, 4 * T, 5 * T**2], [6, 12 * T, 20 * T**2]])
    powers[0] *= T**3
    powers[1] *= T**2
    powers[2] *= T
    rest = np.array([target - p - v * T - a * T**2 / 2, -v - a * T, -a])
    c = np.polynomial.Polynomial([p, v, a / 2, *np.linalg.solve(powers, rest)])
    step = minimum_jerk_step(p, v, a, target, T, DT)
    np.testing.assert_allclose(step, [c(DT), c.deriv()(DT), c.deriv(2)(DT)], atol=1e-9)


def test_a_swing_is_smooth_clears_the_ground_and_lands_on_its_foothold():
    duration, ground, landing = 0.13, 0.02, np.array([0.1, -0.03])
    ticks = round(duration / DT)
    motion = np.zeros((3, 3))
    motion[0, 2] = ground
    path = [motion]
    for tick in range(ticks):
        motion = swing_step(motion, landing, ground, duration - tick * DT, duration, DT)
        path.append(motion)
    positions, velocities = np.array(path)[:, 0], np.array(path)[:, 1]
    np.testing.assert_allclose(positions[-1, :2], landing, atol=1e-3)
    assert abs(positions[-1, 2] - ground) < 2e-3
    assert positions[:, 2].max() == pytest.approx(ground + SWING_HEIGHT, abs=2e-3)
    np.testing.assert_allclose(  # positions are the integral of the velocities
        np.diff(positions, axis=0), DT * (velocities[1:] + velocities[:-1]) / 2, atol=3e-5
    )


@examples
@given(st.floats(-1.2, 1.2), st.floats(0.0, 2 * np.pi))
def test_a_foot_lands_nearly_at_rest_while_the_trunk_s_velocity_sways(speed, start):
    gait, nominal = GAITS["trot"], nominal_stance(MODEL.legs.hip)
    targets, reference = np.zeros(1, dtype=TARGETS)[0], at_rest()
    reference.velocity[0] = speed
    place = np.array([0.0, 0.0, 0.27])
    feet = np.column_stack([nominal, np.full(4, ROBOT.foot_radius)])
    for foot in range(4):
        stand(targets, foot, feet[foot])
    for tick in range(65, 130):  # the first half is FR's stance
        phases = foot_phases(gait, tick * DT, np.zeros(4, bool))
        sway = 0.05 * np.sin(start + 4 * np.pi * tick * DT / gait.period)  # twice a stride
        velocity = np.array([speed + sway, 0.0, 0.0])
        place[:2] += DT * velocity[:2]
        plan_feet(
            targets, phases, gait, feet, nominal, place, velocity, 0.0, reference, 0.27, 0.02, DT
        )
    assert not targets.stance[0]
    assert np.linalg.norm(targets.motion[0, 1, :2]) < 0.35  # chasing its foothold to the end: 0.86
    np.testing.assert_allclose(targets.motion[0, 0, :2], targets.foothold[0], atol=1e-3)


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


# the task-space program

STANCES = [(1, 0, 0, 1), (0, 1, 1, 0), (1, 1, 1, 1), (1, 1, 0, 1), (0, 0, 0, 0)]


def problem(seed: int, stance: tuple[int, ...], effort: float = 1.0):
    """Return the arguments of both forms at a random state near the stance, and q."""
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
    args = (M, bias, v, R, feet, np.array(stance, dtype=np.uint8), tasks, 0.6, LIMITS)
    return args, q


def condensed(args) -> tuple[QuadraticProgram, np.record]:
    w = np.zeros(1, dtype=WORKSPACE)[0]
    rows = 12 + 4 * condense(*args, w)
    return QuadraticProgram(w.H, w.f, w.A[:rows], w.lower[: 12 + rows], w.upper[: 12 + rows], 0), w


def full(args) -> QuadraticProgram:
    w = np.zeros(1, dtype=FULL_WORKSPACE)[0]
    return program_views(w, full_form(*args, w))


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
    asked = task_accelerations(state, np.eye(3), args[4], reference, targets, 0.0, 1.0).linear[:2]
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
def test_the_condensed_and_the_paper_s_form_give_the_same_torques(stance, effort):
    for seed in range(5):
        args, _ = problem(seed, stance, effort)
        program, work = condensed(args)
        ours = qp.solve(program)
        reference = qp.solve(full(args))
        assert ours.x is not None
        assert reference.x is not None
        np.testing.assert_allclose(
            program.A[:12] @ ours.x + work.torque_offset, reference.x[18:30], atol=1e-4
        )


@pytest.mark.parametrize("stance", STANCES)
def test_solutions_meet_the_kkt_conditions(stance):
    for effort in (1.0, 8.0):
        program, _ = condensed(problem(1, stance, effort)[0])
        solution = qp.solve(program)
        assert qp.residual(program, solution) < 1e-6
        _, _, A, lower, upper, _ = program
        rows = np.concatenate([solution.x, A @ solution.x])
        multipliers = solution.multipliers
        slack = np.where(multipliers > 0, upper - rows, rows - lower)
        bound = np.abs(multipliers) > 1e-9
        assert (np.abs(slack[bound]) < 1e-6).all()  # complementary


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
    v = args[2]
    x = qp.solve(full(args)).x
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


# the controller


def walk(ticks: int, u=(0.8, 0.3), **options):
    simulation = Physics()
    simulation.reset(np.zeros(2), 0.0, np.random.default_rng(0))
    controller = LocomotionController(**options)
    controller.reset(simulation.state())
    torques = []
    for _ in range(ticks):
        torques.append(controller.step(simulation.state(), np.array(u)))
        simulation.step(torques[-1])
    return np.array(torques), controller, simulation


@pytest.mark.parametrize("velocity", [(1.0, 0.0), (-0.8, 0.0), (0.0, 0.6)])
def test_feet_stand_where_they_land(velocity):
    walked = walks.walk(6.0, walks.towards(np.array(velocity), 2.0), heading="fixed")
    assert walks.slip_per_step(walked, start=1500) < 1e-3
    assert walked.failed == 0


def test_both_forms_walk_alike():
    condensed_torques, _, _ = walk(100)
    full_torques, _, _ = walk(100, formulation="full")
    np.testing.assert_allclose(condensed_torques, full_torques, atol=1e-2)


def test_kernels_run_uncompiled_with_the_same_result():
    script = (
        "import sys; sys.path.insert(0, 'tests/locomotion')\n"
        "from test_locomotion import walk\n"
        "import json; print(json.dumps(walk(20)[0].tolist()))"
    )
    run = subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    plain = np.array(json.loads(run.stdout))
    np.testing.assert_allclose(plain, walk(20)[0], rtol=1e-9, atol=1e-9)


def test_two_walks_are_identical_bit_for_bit():
    first, second = walk(200)[0], walk(200)[0]
    assert (first == second).all()


def test_diagnostics_tell_what_the_tick_did():
    _, controller, _ = walk(200)
    d = controller.diagnostics
    assert d.qp_solved == 200
    assert d.qp_failed == 0
    assert d.qp_exitflag == 1
    assert d.qp_residual < 1e-6
    assert d.stance.sum() in (2, 3, 4)
    assert np.abs(d.torque).max() <= ROBOT.stall_torque[0]
    assert np.isfinite(d.foot_position).all()
    assert np.isfinite(d.foothold).all()


def test_a_failing_program_is_counted_and_the_torques_stay_finite(monkeypatch):
    simulation = Physics()
    simulation.reset(np.zeros(2), 0.0, np.random.default_rng(0))
    controller = LocomotionController(formulation="full")
    controller.reset(simulation.state())
    controller.step(simulation.state(), np.zeros(2))
    monkeypatch.setattr(qp, "solve", lambda program: qp.QpSolution(None, -1, np.zeros(0)))
    torque = controller.step(simulation.state(), np.zeros(2))
    assert (controller.solved, controller.failed) == (1, 1)
    assert np.isfinite(torque).all()
    assert controller.diagnostics.qp_residual == np.inf


def test_diagnostics_before_the_first_step_are_refused():
    with pytest.raises(InvalidInputError, match="no step yet"):
        _ = LocomotionController().diagnostics


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"gait": "gallop"}, UnknownNameError, "stand.*trot.*walk"),
        ({"heading": "north"}, UnknownNameError, "fixed.*velocity"),
        ({"formulation": "primal"}, UnknownNameError, "condensed.*full"),
        ({"friction": 0.0}, InvalidInputError, "friction"),
        ({"timestep": -0.002}, InvalidInputError, "timestep"),
        ({"gait": "walk", "max_speed": 1.2}, InvalidInputError, "at most 0.4"),
    ],
)
def test_bad_options_are_refused_with_the_choices(options, error, message):
    with pytest.raises(error, match=message):
        LocomotionController(**options)
