"""The controller as a whole, in the loop with the simulation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.judges.task_space import PLAN, paper_program
from benchmarks.suites import walks
from hcbf_gym import _core
from hcbf_gym._core import LEASH, MAX_YAW_ACCELERATION, MAX_YAW_RATE, advance_reference
from hcbf_gym.arrays import attributes, words_of
from hcbf_gym.envs.a1_physics import A1Physics
from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_gym.locomotion import qp
from hcbf_gym.locomotion.controller import LocomotionController
from hcbf_gym.locomotion.records import REFERENCE
from hcbf_gym.robots.reader import read_robot

ROBOT = read_robot()


def standing(**options):
    """Return a simulation and its controller after a reset."""
    simulation, controller = A1Physics(), LocomotionController(**options)
    simulation.reset(np.zeros(2), 0.0, np.random.default_rng(0))
    controller.reset(simulation.state())
    return simulation, controller


def walk(ticks: int, u=(0.8, 0.3)):
    (simulation, controller), torques = standing(), []
    for _ in range(ticks):
        torques.append(controller.step(simulation.state(), np.array(u)))
        simulation.step(torques[-1])
    return np.array(torques), controller


@pytest.mark.parametrize("velocity", [(1.0, 0.0), (-0.8, 0.0), (0.0, 0.6)])
def test_feet_stand_where_they_land(velocity):
    walked = walks.walk(6.0, walks.towards(np.array(velocity), 2.0), heading="fixed")
    assert walks.slip_per_step(walked, start=1500) < 1e-3
    assert walked.failed == 0


def test_the_torques_of_a_walk_are_those_of_the_paper_s_program():
    simulation, controller = standing()
    settings, u = controller._settings, np.array([0.8, 0.3])
    friction, robot = controller._settings["friction"][0], controller.robot
    planned = np.zeros(1, dtype=PLAN)
    plan = attributes(planned)
    for _ in range(300):
        state = simulation.state()
        before = controller._memory.copy()
        torque = controller.step(state, u)
        rate = state.joint_velocity
        limits = _core.torque_limits(robot.stall_torque, robot.no_load_speed, rate)
        _core.plan_tick(words_of(settings), words_of(before), state.vector, u, words_of(planned))
        solution = qp.solve(paper_program(plan.robot, plan.tasks, friction, limits))
        assert solution.x is not None
        expected = np.clip(solution.x[18:30] + plan.feedback.ravel(), *limits)
        np.testing.assert_allclose(torque, expected, atol=1e-2)
        simulation.step(torque)
    assert controller.solved == 300


def test_diagnostics_report_the_tick():
    d = walk(200)[1].diagnostics
    assert d.qp_solved == 200
    assert d.qp_failed == 0
    assert d.qp_exitflag == 1
    assert d.qp_residual < 1e-6
    assert d.stance.sum() in (2, 3, 4)
    assert np.abs(d.torque).max() <= ROBOT.stall_torque[0]
    assert np.isfinite(d.foot_position).all()
    assert np.isfinite(d.foothold).all()


def test_a_failing_program_is_counted_and_the_torques_stay_finite(monkeypatch):
    simulation, controller = standing()
    controller.step(simulation.state(), np.zeros(2))
    tick = _core.LocomotionTick.tick
    bound = lambda *arguments: (tick(*arguments)[0], False)  # noqa: E731
    monkeypatch.setattr(_core.LocomotionTick, "tick", bound)
    monkeypatch.setattr(qp, "solve", lambda program: qp.Solution(None, -1, np.zeros(0)))
    torque = controller.step(simulation.state(), np.zeros(2))
    assert (controller.solved, controller.failed) == (1, 1)
    assert np.isfinite(torque).all()
    assert controller.diagnostics.qp_residual == np.inf


def test_diagnostics_of_a_reset_show_a_robot_at_rest():
    with pytest.raises(InvalidInputError, match="no reset yet"):
        _ = LocomotionController().diagnostics
    d = standing()[1].diagnostics
    assert d.stance.all()
    assert (d.torque == 0.0).all()
    assert (d.qp_solved, d.qp_exitflag, d.qp_residual) == (0, 0, 0.0)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"gait": "gallop"}, UnknownNameError, "stand.*trot.*walk"),
        ({"heading": "north"}, UnknownNameError, "fixed.*velocity"),
        ({"friction": 0.0}, InvalidInputError, "friction"),
        ({"timestep": -0.002}, InvalidInputError, "timestep"),
        ({"gait": "walk", "max_speed": 1.2}, InvalidInputError, "at most 0.4"),
    ],
)
def test_bad_options_are_refused_with_the_choices(options, error, message):
    with pytest.raises(error, match=message):
        LocomotionController(**options)


DT = 0.002
ORIGIN = np.zeros(3)
examples = settings(deadline=None, max_examples=40)
speeds = st.floats(-1.0, 1.0)


def at_rest() -> tuple[np.record, np.ndarray]:
    """Return a reference at rest, and its bytes."""
    reference = np.zeros(1, dtype=REFERENCE)
    return attributes(reference), words_of(reference)


@examples
@given(speeds, speeds, st.floats(0.1, 0.5))
def test_the_reference_is_the_exact_double_integrator_below_its_cap(ux, uy, duration):
    (reference, packed), u = at_rest(), np.array([ux, uy])
    ticks = round(duration / DT)
    for _ in range(ticks):
        place = np.array([*reference.position, 0.27])  # a robot that keeps up
        advance_reference(packed, u, place, DT, 2.0, False, 1.0)
    t = ticks * DT
    np.testing.assert_allclose(reference.velocity, u * t, atol=1e-12)
    np.testing.assert_allclose(reference.position, 0.5 * u * t**2, atol=1e-12)
    np.testing.assert_allclose(reference.acceleration, u, atol=1e-9)


@examples
@given(
    st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=1, max_size=8),
    st.floats(0.1, 1.0),
)
def test_the_reference_keeps_to_speed_leash_and_yaw_limits(inputs, grip):
    reference, packed = at_rest()
    for u in inputs:
        for _ in range(50):
            rate = reference.yaw_rate
            advance_reference(packed, np.array(u), ORIGIN, DT, 1.2, True, grip)
            assert np.linalg.norm(reference.velocity) <= 1.2 + 1e-12
            assert np.linalg.norm(reference.position) <= LEASH + 1e-12
            assert abs(reference.yaw_rate) <= grip * MAX_YAW_RATE + 1e-12
            assert abs(reference.yaw_rate - rate) <= grip * MAX_YAW_ACCELERATION * DT + 1e-12


@examples
@given(st.floats(-np.pi, np.pi), st.floats(0.5, 1.0))
def test_the_heading_turns_to_the_velocity_without_overshoot(direction, grip):
    reference, packed = at_rest()
    u = np.array([np.cos(direction), np.sin(direction)])
    errors = []
    for _ in range(1500):
        place = np.array([*reference.position, 0.27])
        advance_reference(packed, u, place, DT, 0.8, True, grip)
        errors.append((direction - reference.yaw + np.pi) % (2 * np.pi) - np.pi)
    assert abs(errors[-1]) < 1e-3
    overshoot = -np.min(np.sign(errors[200]) * np.array(errors[200:]))
    assert overshoot < np.radians(0.5)


def test_the_heading_is_held_while_the_velocity_is_noise():
    (reference, packed), rng = at_rest(), np.random.default_rng(0)
    reference.yaw = 1.0
    for _ in range(500):
        reference.velocity[:] = rng.uniform(-0.1, 0.1, 2)
        advance_reference(packed, np.zeros(2), ORIGIN, DT, 1.2, True, 1.0)
    assert reference.yaw == 1.0
