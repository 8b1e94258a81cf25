"""When feet stand, where they land and how they get there."""

# ruff: noqa: N806 - matrices keep their usual capitals

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hcbf_gym import _core
from hcbf_gym._core import MAX_OFFSET, RESTING, SWING_HEIGHT, minimum_jerk_step, swing_step
from hcbf_gym.arrays import attributes, packed, words_of
from hcbf_gym.locomotion.gait import GAITS, Gait
from hcbf_gym.locomotion.model import RobotModel
from hcbf_gym.locomotion.records import GAIT, REFERENCE, TARGETS
from hcbf_gym.robots.reader import read_robot

DT = 0.002
ORIGIN = np.zeros(3)
ROBOT = read_robot()
MODEL = RobotModel(ROBOT)
examples = settings(deadline=None, max_examples=40)
speeds = st.floats(-1.0, 1.0)


def standing(gait: Gait, clock: float, contact: np.ndarray) -> np.ndarray:
    """Return (4,) which feet stand."""
    return np.array(_core.foot_phases(packed(gait, GAIT), clock, contact)[0])


def advance_clock(gait: Gait, clock: float, quiet: bool, dt: float) -> float:
    return _core.advance_clock(packed(gait, GAIT), clock, quiet, dt)


@pytest.mark.parametrize("name", ["trot", "walk"])
def test_each_foot_is_in_stance_for_the_gait_s_share_of_the_time(name):
    gait = GAITS[name]
    clocks = (np.arange(2000) + 0.5) * gait.period / 2000
    stance = np.array([standing(gait, c, np.zeros(4, bool)) for c in clocks])
    np.testing.assert_allclose(stance.mean(axis=0), gait.duty, atol=1e-3)
    least = 2 if name == "trot" else 3
    assert stance.sum(axis=1).min() == least


@pytest.mark.parametrize("name", ["trot", "walk"])
def test_every_swing_lasts_the_same_number_of_ticks_for_minutes(name):
    gait, clock, stance = GAITS[name], 0.0, []
    for _ in range(60_000):
        stance.append(standing(gait, clock, np.zeros(4, bool)))
        clock = advance_clock(gait, clock, False, DT)
    for foot in np.array(stance).T:
        lift_offs = np.flatnonzero(foot[:-1] & ~foot[1:])
        touchdowns = np.flatnonzero(~foot[:-1] & foot[1:])
        assert (np.diff(lift_offs) == round(gait.period / DT)).all()
        assert (np.diff(touchdowns) == round(gait.period / DT)).all()


def test_a_foot_that_lands_late_in_its_swing_becomes_stance_and_an_early_touch_does_not():
    gait, touching = GAITS["trot"], np.ones(4, dtype=bool)
    early, late = 0.3 * 0.13, 0.7 * 0.13
    assert standing(gait, early, touching).tolist() == [True, False, False, True]
    assert standing(gait, late, touching).all()


def test_standing_rests_while_quiet_and_steps_at_once_when_disturbed():
    gait = GAITS["stand"]
    assert advance_clock(gait, RESTING, True, DT) == RESTING
    clock = advance_clock(gait, RESTING, False, DT)
    assert clock == 0.0
    assert not standing(gait, clock, np.zeros(4, bool)).all()
    while clock >= 0.0:
        before, clock = clock, advance_clock(gait, clock, True, DT)
    half = 0.5 * gait.period
    assert (before + DT) // half > before // half  # it stopped as feet landed


@examples
@given(speeds, speeds, st.floats(-2.0, 2.0), st.floats(0.0, 0.13))
def test_footholds_stay_within_reach_of_the_hip(vx, vy, yaw_rate, remaining):
    nominal = _core.nominal_stance(MODEL.legs.hip)
    reference = np.zeros(1, dtype=REFERENCE)
    reference["yaw_rate"] = yaw_rate
    velocity = np.array([vx, vy, 0.0])
    for foot in range(4):
        trunk = ORIGIN, velocity, 0.0, 0.27
        landing = _core.foothold(nominal[foot], trunk, words_of(reference), remaining, 0.13)
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
    np.testing.assert_array_equal(positions[1, :2], positions[0, :2])  # it rises first
    assert positions[1, 2] > positions[0, 2]
    np.testing.assert_allclose(  # positions are the integral of the velocities
        np.diff(positions, axis=0), DT * (velocities[1:] + velocities[:-1]) / 2, atol=3e-5
    )


@examples
@given(st.floats(-1.2, 1.2), st.floats(0.0, 2 * np.pi))
def test_a_foot_lands_nearly_at_rest_while_the_trunk_s_velocity_oscillates(speed, start):
    gait, nominal = GAITS["trot"], _core.nominal_stance(MODEL.legs.hip)
    plan, reference = np.zeros(1, dtype=TARGETS), np.zeros(1, dtype=REFERENCE)
    targets = attributes(plan)
    reference["velocity"][0, 0] = speed
    place = np.array([0.0, 0.0, 0.27])
    feet = np.column_stack([nominal, np.full(4, ROBOT.foot_radius)])
    targets.stance[:] = True
    targets.motion[:, 0] = feet
    targets.foothold[:] = feet[:, :2]
    for tick in range(65, 130):  # the first half is FR's stance
        ripple = 0.05 * np.sin(start + 4 * np.pi * tick * DT / gait.period)  # twice a stride
        velocity = np.array([speed + ripple, 0.0, 0.0])
        place[:2] += DT * velocity[:2]
        now = packed(gait, GAIT), tick * DT, np.zeros(4, bool)
        trunk = place, velocity, 0.0, 0.27
        places = feet, nominal, 0.02
        _core.plan_feet(words_of(plan), *now, *places, trunk, words_of(reference), DT)
    assert not targets.stance[0]
    assert np.linalg.norm(targets.motion[0, 1, :2]) < 0.35  # chasing its foothold to the end: 0.86
    np.testing.assert_allclose(targets.motion[0, 0, :2], targets.foothold[0], atol=1e-3)
