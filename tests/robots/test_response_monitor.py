"""Whether a robot that does not do what it is told is noticed, and one that does is left alone."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hcbf_robots.walkers import Walker
from hcbf_robots.walkers.response_monitor import ResponseMonitor
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import Response

HOLONOMIC = Walker.load("holonomic-cart")
PERIOD = 0.05


def alarmed(
    seed, *, share=1.0, late=0, turned=0.0, lost=0.0, known=True, straight=False, seconds=10.0
):
    """Whether a monitor alarms of a robot with the measured response, or a fault of it."""
    rng = np.random.default_rng(seed)
    response = HOLONOMIC.response
    assert response is not None
    monitor = ResponseMonitor(HOLONOMIC.command, response if known else None)
    velocity, place, command, told = np.zeros(2), np.zeros(2), np.zeros(3), []
    time, alarm = 0.0, False
    for k in range(round(seconds / PERIOD)):
        if k % 12 == 0 and not (straight and k):
            angle = rng.uniform(-math.pi, math.pi)
            command = 0.8 * np.array([math.cos(angle), math.sin(angle), 0.0])
        if rng.random() >= lost:
            alarm |= monitor.observe(np.array([*place, 0.0]), velocity, time)
        monitor.tell(command, time)
        told.append(share * command[:2] * np.array(response.gain[:2]))
        goal = told[max(0, k - late)] if k >= late else np.zeros(2)
        cos, sin = math.cos(turned), math.sin(turned)
        goal = np.array([cos * goal[0] - sin * goal[1], sin * goal[0] + cos * goal[1]])
        step = rng.uniform(0.7, 1.3) * PERIOD
        left = math.exp(-step / response.time_constant)
        place = place + goal * step + (velocity - goal) * response.time_constant * (1.0 - left)
        velocity = goal + (velocity - goal) * left
        time += step
    return alarm


seeds = st.integers(0, 2**32 - 1)


@settings(deadline=None, max_examples=30)
@given(seeds, st.sampled_from([0.0, 0.3]), st.booleans())
def test_a_robot_that_follows_is_no_alarm(seed, lost, known):
    assert not alarmed(seed, lost=lost, known=known)


@pytest.mark.parametrize(
    "fault",
    [
        {"share": 0.0},
        {"share": 0.5},
        {"share": 1.5},
        {"share": -1.0},
        {"late": 10},
        {"turned": 1.2},
    ],
)
def test_a_robot_that_does_not_is_one(fault):
    assert all(alarmed(seed, **fault) for seed in range(5))


def test_a_response_that_nobody_measured_has_wide_bounds_not_none():
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
    sways = 0.01 * command.forward
    residual = 0.0, 2.0 * sways, 5.0 * sways
    known = replace(LATE, gain=(), delay=0.0, sway=sways, residual=residual) if response else None
    monitor, place, speed = ResponseMonitor(command, known), 0.0, 0.0
    told, alarmed = share * command.forward * np.eye(len(command.limits))[0], math.inf
    tau = 0.3 if response is None else LATE.time_constant
    for k in range(round(8.0 / PERIOD)):
        now, fault = PERIOD * k, does if k * PERIOD >= 4.0 else 1.0
        if monitor.observe(np.array([place, 0.0, 0.0]), np.array([speed, 0.0]), now):
            alarmed = min(alarmed, now)
        monitor.tell(told, now, now + 1.5 * PERIOD)
        left, goal = math.exp(-PERIOD / tau), fault * told[0]
        place += PERIOD * goal + (speed - goal) * tau * (1.0 - left)
        speed = goal + (speed - goal) * left
    assert alarmed == math.inf if does == 1.0 else 4.0 < alarmed <= 6.0 + 1e-9


def test_a_response_with_complaints_hides_no_half_of_its_own_gain():
    command = Command(1.0, 2.0, sideways=1.0)
    for does in (0.5, 1.0):
        monitor, place = ResponseMonitor(command, COMPLAINED_OF), 0.0
        alarms = []
        for k in range(200):
            alarms.append(monitor.observe(np.array([place, 0.0, 0.0]), np.zeros(2), PERIOD * k))
            monitor.tell(np.array([0.8, 0.0, 0.0]), PERIOD * k)
            place += PERIOD * 0.4 * 0.8 * (does if k > 80 else 1.0)
        assert any(alarms) == (does == 0.5)


def test_a_pause_and_a_jump_begin_anew():
    monitor = ResponseMonitor(Command(1.0, 1.0, sideways=1.0), HOLONOMIC.response)
    for k, x in enumerate((0.0, 5.0, -3.0, 8.0)):
        assert not monitor.observe(np.array([x, 0.0, 0.0]), np.zeros(2), 0.05 * k)
    for time in (3600.0, 0.1):  # a clock that jumps ahead and comes back
        assert not monitor.observe(np.zeros(3), np.zeros(2), time)
    for k in range(100):
        monitor.tell(np.array([1.0, 0.0, 0.0]), 0.1 + 0.02 * k)
        alarm = monitor.observe(np.zeros(3), np.zeros(2), 0.1 + 0.02 * (k + 1))
    assert alarm


LATE = Response(
    gain=(0.9, 1.1), time_constant=0.12, delay=0.07, residual=(0.0, 0.02, 0.05), sway=0.01,
    overshoot=0.05, braking=3.0,
)  # fmt: skip


def test_a_robot_is_carried_on_by_what_it_was_told():
    command, rng = Command(1.0, 2.0, look_ahead=0.2), np.random.default_rng(1)
    monitor, fine = ResponseMonitor(command, LATE), 0.001
    pose, twist, told, seen = np.zeros(3), np.zeros(3), [np.zeros(2)] * 70, {}
    one = np.zeros(2)
    for k in range(2000):
        if k % 50 == 0:  # as hard as it brakes
            one = np.clip(one + rng.uniform(-0.14, 0.16, 2), -command.limits, command.limits)
            monitor.tell(one, fine * k, fine * (k + 50))
        told.append(one)
        seen[k] = pose.copy(), twist.copy()
        goal = np.array(LATE.gain) * told[k]
        left = math.exp(-fine / LATE.time_constant)
        twist = np.array([goal[0], 0.0, goal[1]]) * (1.0 - left) + twist * left
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        pose = pose + fine * np.array([cos * twist[0], sin * twist[0], twist[2]])
        if k >= 500 and k % 50 == 49:
            ages = {0: 0.0, 20: 0.02, 190: 0.19, 400: 0.4}
            for back, age in ages.items():
                at, moves = (one.copy() for one in seen[k - back])
                may_miss = monitor.carry(at, moves, fine * (k - back), fine * k)
                np.testing.assert_allclose(at, seen[k][0], atol=5e-3)
                np.testing.assert_allclose(moves, seen[k][1], atol=3e-2)
                assert np.linalg.norm((at - seen[k][0])[:2]) <= may_miss + 1e-9
                assert may_miss <= 0.2 if age else may_miss == 0.0


def test_what_a_command_that_is_not_renewed_may_still_do_is_reserved():
    command = Command(1.0, 2.0, look_ahead=0.2)
    reserved = []
    for lapse in (0.0, 0.02):
        monitor = ResponseMonitor(command, LATE)
        for k in range(20):
            time = k * (0.05 + lapse)
            monitor.tell(np.array([1.0, 0.0]), time, time + 0.05)
        at, moves = np.zeros(3), np.zeros(3)
        reserved.append(monitor.carry(at, moves, time - 0.3, time))
    assert reserved[1] > reserved[0] + 0.05


@pytest.mark.parametrize("late", [0.0, 0.15])
def test_late_odometry_of_commands_that_lapse_is_no_alarm(late):
    monitor, place, moves, past = (
        ResponseMonitor(HOLONOMIC.command, HOLONOMIC.response),
        0.0,
        0.0,
        [],
    )
    for k in range(400):  # called every 60 ms with a command that is good for 50 ms; it goes on
        time, wanted = 0.06 * k, np.array([np.sign(np.sin(0.05 * k)), 0.0, 0.0])
        past.append((time, place, moves))
        stamp, at, was = next((p for p in reversed(past) if p[0] <= time - late), past[0])
        assert not monitor.observe(np.array([at, 0.0, 0.0]), np.array([was, 0.0]), stamp)
        monitor.tell(wanted, time, time + 0.05)
        left = math.exp(-0.06 / 0.056)
        place += wanted[0] * 0.06 + (moves - wanted[0]) * 0.056 * (1.0 - left)
        moves = wanted[0] + (moves - wanted[0]) * left


@pytest.mark.parametrize("gap", [1, 12])
def test_a_stop_at_once_takes_the_way_that_brakes_need(gap):
    response = replace(LATE, time_constant=0.02, delay=0.0, gain=())
    monitor, place, speed = ResponseMonitor(Command(1.2, 2.0, look_ahead=0.2), response), 0.0, 0.0
    for k in range(200):
        told = 1.2 * (k % 40 >= 20)
        if k % gap == 0:
            at, velocity = np.array([place, 0.0, 0.0]), np.array([speed, 0.0])
            assert not monitor.observe(at, velocity, 0.05 * k)
        monitor.tell(np.array([told, 0.0]), 0.05 * k)
        for _ in range(10):
            speed += float(np.clip(told - speed, -0.015, 0.015))  # 3 m/s²
            place += 0.005 * speed


def test_the_first_command_after_a_change_of_filters_is_a_step_that_nobody_can_follow():
    """A robot that moves is told to turn back at once: it brakes as it was measured to."""
    command = Command(forward=1.0, turn=2.0, look_ahead=0.2)
    measured = Response(time_constant=0.02, delay=0.0, sway=0.004, braking=3.5, residual=(0, 0, 0))
    monitor, x, v = ResponseMonitor(command, measured), 0.0, 0.5
    for k in range(60):
        pose, velocity = np.array([x, 0.0, 0.0]), np.array([v, 0.0])
        assert not monitor.observe(pose, velocity, 0.02 * k), k
        monitor.tell(np.array([-0.1, 0.0]), 0.02 * k, 0.02 * k + 0.05)
        change = max(-0.02 * 3.5, -0.1 - v)
        x, v = x + 0.02 * (v + 0.5 * change), v + change


FAST = Response(
    gain=(1.0, 1.0), time_constant=0.02, delay=0.0, residual=(0.002, 0.04, 0.17), sway=0.0034,
    overshoot=0.13, braking=4.5,
)  # fmt: skip
"""A cart's: it changes its velocity no harder than it brakes, which small steps do not show."""


@pytest.mark.parametrize("lapse", [0.0, 0.04])
@pytest.mark.parametrize("period", [0.05, 0.13])
def test_a_robot_that_needs_its_braking_to_follow_rare_commands_is_no_alarm(period, lapse):
    command, rng, fine = Command(1.2, 2.5, look_ahead=0.25), np.random.default_rng(7), 0.005
    monitor, place, speed, told, worst = ResponseMonitor(command, FAST), 0.0, 0.0, 0.0, 0.0
    for k in range(300):
        time = k * (period + lapse)
        asked = rng.choice([-1.2, 0.0, 1.2])
        change = FAST.braking * period
        told = 0.0 if rng.random() < 0.2 else float(np.clip(asked, told - change, told + change))
        monitor.tell(np.array([told, 0.0]), time, time + period)
        goes_on = rng.random() < 0.5  # beyond the time until which the command is good
        for j in range(round((period + lapse) / fine)):
            ends = j * fine >= period and not goes_on
            most = fine * FAST.braking
            speed += float(np.clip((0.0 if ends else told) - speed, -most, most))
            place += fine * speed
        at, moves = np.array([place, 0.0, 0.0]), np.array([speed, 0.0])
        assert not monitor.observe(at, moves, time + period + lapse)
        worst = max(worst, monitor.worst)
    assert worst > 0.2
    stands = [
        (monitor.tell(np.array([1.0, 0.0]), time + (period + lapse) * (k + 1), time + 99.0),
         monitor.observe(at, np.zeros(2), time + (period + lapse) * (k + 2)))[1]
        for k in range(20)
    ]  # fmt: skip
    assert any(stands)


def test_a_clock_that_counts_from_1970_changes_nothing():
    seen = []
    for shift in (0.0, 1.7e9):
        monitor = ResponseMonitor(Command(1.2, 2.5, look_ahead=0.25), FAST)
        rng = np.random.default_rng(3)
        place, worst = 0.0, []
        for k in range(100):
            told = float(rng.uniform(-1.0, 1.0))
            monitor.tell(np.array([told, 0.0]), shift + k / 8.0, shift + k / 8.0 + 1.0 / 16.0)
            place += told / 16.0
            if k % 10 < 5:  # after a pause it begins anew, in the midst of commands that lapse
                at, moves = np.array([place, 0.0, 0.0]), np.array([told, 0.0])
                monitor.observe(at, moves, shift + k / 8.0 + 1.0 / 32.0)
                worst.append(monitor.worst)
        seen.append(worst)
    np.testing.assert_allclose(seen[0], seen[1], atol=1e-5)
    assert max(seen[0]) > 0.05
