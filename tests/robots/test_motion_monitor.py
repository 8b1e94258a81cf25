"""A robot that does not follow its commands is reported, and one that does is not."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hcbf_robots import Command, Response, Walker
from hcbf_robots.walkers.motion_monitor import MotionMonitor

HOLONOMIC = Walker.load("holonomic-cart")
PERIOD = 0.05
LATE = Response(
    gain=(0.9, 1.1), time_constant=0.12, delay=0.07, residual=(0.0, 0.02, 0.05), deviation=0.01,
    overshoot=0.05, braking=3.0,
)  # fmt: skip
FAST = Response(
    gain=(1.0, 1.0), time_constant=0.02, delay=0.0, residual=(0.002, 0.04, 0.17), deviation=0.0034,
    overshoot=0.13, braking=4.5,
)  # fmt: skip
"""A cart's: it changes its velocity no harder than it brakes, which small steps do not show."""


def follow(place, velocity, goal, tau, time):
    """Return place and velocity of a first-order robot after a time."""
    left, off = math.exp(-time / tau), velocity - goal
    return place + goal * time + off * tau * (1.0 - left), goal + off * left


def ahead(monitor, place, speed, time):
    """Observe a robot that moves along x, and return whether that alarms."""
    return bool(monitor.observe(np.array([place, 0.0, 0.0]), np.array([speed, 0.0]), time))


def alarmed(seed, *, share=1.0, late=0, turned=0.0, lost=0.0, known=True, straight=False):
    """Whether a monitor alarms of a robot with the measured response, or a fault of it."""
    rng = np.random.default_rng(seed)
    response = HOLONOMIC.response
    assert response is not None
    monitor = MotionMonitor(HOLONOMIC.command, response if known else None)
    velocity, place, command, goals = np.zeros(2), np.zeros(2), np.zeros(3), []
    time, alarm = 0.0, False
    for k in range(round(10.0 / PERIOD)):
        if k % 12 == 0 and not (straight and k):
            angle = rng.uniform(-math.pi, math.pi)
            command = 0.8 * np.array([math.cos(angle), math.sin(angle), 0.0])
        if rng.random() >= lost:
            alarm |= bool(monitor.observe(np.array([*place, 0.0]), velocity, time))
        monitor.command(command, time)
        goals.append(share * command[:2] * np.array(response.gain[:2]))
        goal = goals[k - late] if k >= late else np.zeros(2)
        cos, sin = math.cos(turned), math.sin(turned)
        goal = np.array([cos * goal[0] - sin * goal[1], sin * goal[0] + cos * goal[1]])
        step = rng.uniform(0.7, 1.3) * PERIOD
        place, velocity = follow(place, velocity, goal, response.time_constant, step)
        time += step
    return alarm


seeds = st.integers(0, 2**32 - 1)


@settings(deadline=None, max_examples=30)
@given(seeds, st.sampled_from([0.0, 0.3]), st.booleans())
def test_a_robot_that_follows_is_no_alarm(seed, lost, known):
    assert not alarmed(seed, lost=lost, known=known)


@pytest.mark.parametrize(
    "fault", [*({"share": share} for share in (0.0, 0.5, 1.5, -1.0)), {"late": 10}, {"turned": 1.2}]
)
def test_a_robot_that_does_not_is_one(fault):
    assert all(alarmed(seed, **fault) for seed in range(5))


def test_an_unmeasured_response_has_wide_bounds_not_none():
    assert alarmed(0, share=0.0, known=False, straight=True)
    assert not alarmed(0, share=0.7, known=False, straight=True)


COMMANDS = {
    "slow differential": Command(0.22, 2.0, look_ahead=0.1),
    "fast differential": Command(1.5, 1.5, look_ahead=0.4),
    "holonomic": Command(1.0, 2.0, sideways=1.0),
    "walker": Command(1.0, 1.0, sideways=0.5),
}
COMPLAINED_OF = Response(gain=(0.4, 1.0, 1.0), falls=1, seconds=9.0)


@pytest.mark.parametrize("response", [None, "measured"])
@pytest.mark.parametrize("does", [0.0, 0.5, 2.0, -1.0, 1.0])
@pytest.mark.parametrize("share", [0.5, 1.0])
@pytest.mark.parametrize("name", COMMANDS)
def test_half_or_twice_of_a_command_for_2_s_at_half_speed_is_never_silent(
    name, share, does, response
):
    command = COMMANDS[name]
    least = 0.01 * command.forward
    residual = 0.0, 2.0 * least, 5.0 * least
    known = (
        replace(LATE, gain=(), delay=0.0, deviation=least, residual=residual) if response else None
    )
    monitor, place, speed = MotionMonitor(command, known), 0.0, 0.0
    given, alarmed = share * command.forward * np.eye(len(command.limits))[0], math.inf
    tau = 0.3 if response is None else LATE.time_constant
    for k in range(round(8.0 / PERIOD)):
        now, fault = PERIOD * k, does if k * PERIOD >= 4.0 else 1.0
        if ahead(monitor, place, speed, now):
            alarmed = min(alarmed, now)
        monitor.command(given, now, now + 1.5 * PERIOD)
        place, speed = follow(place, speed, fault * given[0], tau, PERIOD)
    assert alarmed == math.inf if does == 1.0 else 4.0 < alarmed <= 6.0 + 1e-9


def test_a_response_with_complaints_hides_no_half_of_its_own_gain():
    command = Command(1.0, 2.0, sideways=1.0)
    for does in (0.5, 1.0):
        monitor, place = MotionMonitor(command, COMPLAINED_OF), 0.0
        alarms = []
        for k in range(200):
            alarms.append(ahead(monitor, place, 0.0, PERIOD * k))
            monitor.command(np.array([0.8, 0.0, 0.0]), PERIOD * k)
            place += PERIOD * 0.4 * 0.8 * (does if k > 80 else 1.0)
        assert any(alarms) == (does == 0.5)


def test_a_pause_and_a_jump_begin_anew():
    monitor = MotionMonitor(Command(1.0, 1.0, sideways=1.0), HOLONOMIC.response)
    for k, x in enumerate((0.0, 5.0, -3.0, 8.0)):
        assert not ahead(monitor, x, 0.0, 0.05 * k)
    for time in (3600.0, 0.1):  # a clock that jumps ahead and comes back
        assert not ahead(monitor, 0.0, 0.0, time)
    for k in range(100):
        monitor.command(np.array([1.0, 0.0, 0.0]), 0.1 + 0.02 * k)
        alarm = ahead(monitor, 0.0, 0.0, 0.1 + 0.02 * (k + 1))
    assert alarm


def test_a_robot_is_propagated_by_its_commands():
    command, rng = Command(1.0, 2.0, look_ahead=0.2), np.random.default_rng(1)
    monitor, fine = MotionMonitor(command, LATE), 0.001
    pose, twist, given, seen = np.zeros(3), np.zeros(3), [np.zeros(2)] * 70, {}
    one = np.zeros(2)
    for k in range(2000):
        if k % 50 == 0:  # as hard as it brakes
            one = np.clip(one + rng.uniform(-0.14, 0.16, 2), -command.limits, command.limits)
            monitor.command(one, fine * k, fine * (k + 50))
        given.append(one)
        seen[k] = pose.copy(), twist.copy()
        goal = np.array(LATE.gain) * given[k]
        left = math.exp(-fine / LATE.time_constant)
        twist = np.array([goal[0], 0.0, goal[1]]) * (1.0 - left) + twist * left
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        pose = pose + fine * np.array([cos * twist[0], sin * twist[0], twist[2]])
        if k >= 500 and k % 50 == 49:
            for back in (0, 20, 190, 400):
                since = fine * (k - back)
                at, moves, may_miss = monitor.propagate(*seen[k - back], since, fine * k)
                np.testing.assert_allclose(at, seen[k][0], atol=5e-3)
                np.testing.assert_allclose(moves, seen[k][1], atol=3e-2)
                assert np.linalg.norm((at - seen[k][0])[:2]) <= may_miss + 1e-9
                assert may_miss <= 0.2 if back else may_miss == 0.0


def test_the_effect_of_a_command_after_its_time_is_reserved():
    command = Command(1.0, 2.0, look_ahead=0.2)
    reserved = []
    for lapse in (0.0, 0.02):
        monitor = MotionMonitor(command, LATE)
        for k in range(20):
            time = k * (0.05 + lapse)
            monitor.command(np.array([1.0, 0.0]), time, time + 0.05)
        propagated = monitor.propagate(np.zeros(3), np.zeros(3), time - 0.3, time)
        reserved.append(propagated.position_error)
    assert reserved[1] > reserved[0] + 0.05


@pytest.mark.parametrize("late", [0.0, 0.15])
def test_late_odometry_of_commands_that_lapse_is_no_alarm(late):
    monitor = MotionMonitor(HOLONOMIC.command, HOLONOMIC.response)
    place, moves, past = 0.0, 0.0, []
    for k in range(400):  # called every 60 ms with a command that is good for 50 ms
        time, wanted = 0.06 * k, np.array([np.sign(np.sin(0.05 * k)), 0.0, 0.0])
        past.append((time, place, moves))
        stamp, at, was = next((p for p in reversed(past) if p[0] <= time - late), past[0])
        assert not ahead(monitor, at, was, stamp)
        monitor.command(wanted, time, time + 0.05)
        place, moves = follow(place, moves, wanted[0], 0.056, 0.06)


@pytest.mark.parametrize("gap", [1, 12])
def test_a_stop_at_once_takes_the_path_that_brakes_need(gap):
    response = replace(LATE, time_constant=0.02, delay=0.0, gain=())
    monitor, place, speed = MotionMonitor(Command(1.2, 2.0, look_ahead=0.2), response), 0.0, 0.0
    for k in range(200):
        goal = 1.2 * (k % 40 >= 20)
        if k % gap == 0:
            assert not ahead(monitor, place, speed, 0.05 * k)
        monitor.command(np.array([goal, 0.0]), 0.05 * k)
        for _ in range(10):
            speed += float(np.clip(goal - speed, -0.015, 0.015))  # 3 m/s²
            place += 0.005 * speed


def test_the_first_command_after_a_change_of_filters_is_followed_by_braking():
    """A robot that moves is commanded back at once: it brakes as it was measured to."""
    command = Command(forward=1.0, turn=2.0, look_ahead=0.2)
    measured = Response(
        time_constant=0.02, delay=0.0, deviation=0.004, braking=3.5, residual=(0, 0, 0)
    )
    monitor, x, v = MotionMonitor(command, measured), 0.0, 0.5
    for k in range(60):
        assert not ahead(monitor, x, v, 0.02 * k), k
        monitor.command(np.array([-0.1, 0.0]), 0.02 * k, 0.02 * k + 0.05)
        change = max(-0.02 * 3.5, -0.1 - v)
        x, v = x + 0.02 * (v + 0.5 * change), v + change


@pytest.mark.parametrize("lapse", [0.0, 0.04])
@pytest.mark.parametrize("period", [0.05, 0.13])
def test_a_robot_that_needs_its_braking_to_follow_rare_commands_is_no_alarm(period, lapse):
    command, rng, fine = Command(1.2, 2.5, look_ahead=0.25), np.random.default_rng(7), 0.005
    monitor, place, speed, last, worst = MotionMonitor(command, FAST), 0.0, 0.0, 0.0, 0.0
    for k in range(300):
        time = k * (period + lapse)
        goal = rng.choice([-1.2, 0.0, 1.2])
        change = FAST.braking * period
        last = 0.0 if rng.random() < 0.2 else float(np.clip(goal, last - change, last + change))
        monitor.command(np.array([last, 0.0]), time, time + period)
        continues = rng.random() < 0.5  # beyond the time until which the command is good
        for j in range(round((period + lapse) / fine)):
            ends = j * fine >= period and not continues
            most = fine * FAST.braking
            speed += float(np.clip((0.0 if ends else last) - speed, -most, most))
            place += fine * speed
        assert not ahead(monitor, place, speed, time + period + lapse)
        worst = max(worst, monitor._notes[0]["worst"])
    assert worst > 0.2
    alarms = []
    for k in range(20):  # then it is at rest
        monitor.command(np.array([1.0, 0.0]), time + (period + lapse) * (k + 1), time + 99.0)
        alarms.append(ahead(monitor, place, 0.0, time + (period + lapse) * (k + 2)))
    assert any(alarms)


def test_a_clock_that_counts_from_1970_changes_nothing():
    seen = []
    for shift in (0.0, 1.7e9):
        monitor = MotionMonitor(Command(1.2, 2.5, look_ahead=0.25), FAST)
        rng = np.random.default_rng(3)
        place, worst = 0.0, []
        for k in range(100):
            speed = float(rng.uniform(-1.0, 1.0))
            monitor.command(np.array([speed, 0.0]), shift + k / 8.0, shift + k / 8.0 + 1.0 / 16.0)
            place += speed / 16.0
            if k % 10 < 5:  # after a pause it begins anew, in the midst of commands that lapse
                ahead(monitor, place, speed, shift + k / 8.0 + 1.0 / 32.0)
                worst.append(monitor._notes[0]["worst"])
        seen.append(worst)
    np.testing.assert_allclose(seen[0], seen[1], atol=1e-5)
    assert max(seen[0]) > 0.05
