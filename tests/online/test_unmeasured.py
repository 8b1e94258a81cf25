"""Unmeasured robots from 0.05 to 3 m/s: they may follow at once, or as late as is assumed."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hcbf_gym.barriers import Disc, HalfPlane
from hcbf_gym.errors import CoverageWarning, InvalidInputError
from hcbf_gym.models import Reason
from hcbf_robots import Command, Response, Robot, VelocityFilter, Walker
from hcbf_robots.walkers.walker_response import assumed
from tests.online.followers import FAR, WALL, Lagged

PERIOD = 0.05
ROBOTS = {
    "as slow as allowed": Command(forward=0.05, turn=1.0, look_ahead=0.05),
    "TurtleBot 3 Burger": Command(forward=0.22, turn=2.84, look_ahead=0.09),
    "TurtleBot 3 Waffle": Command(forward=0.26, turn=1.82, look_ahead=0.15),
    "TurtleBot 4": Command(forward=0.46, turn=1.9, look_ahead=0.17),
    "Nav2's stock robot": Command(forward=0.5, turn=1.0, look_ahead=0.2),
    "a slow holonomic base": Command(forward=0.3, turn=1.0, sideways=0.3),
    "AMR": Command(forward=1.5, turn=1.5, look_ahead=0.4),
    "fast": Command(forward=3.0, turn=2.0, look_ahead=0.5),
}


@pytest.mark.parametrize("turn", [-3.0, -2.0, -1.0, 1.0, 2.0])
@pytest.mark.parametrize(("lag", "delay"), [(0.0, 0.0), (0.15, 0.05), (0.3, 0.1)])
@pytest.mark.parametrize(("speed", "period"), [(0.3, 0.2), (1.0, 0.05), (2.0, 0.02)])
@pytest.mark.filterwarnings("ignore:velocity filter", "ignore:safety filter")
def test_a_robot_that_turns_along_a_wall_stays_out_of_it(turn, lag, delay, speed, period):
    robot = Robot(Command(forward=speed, turn=3.0, sideways=speed), reach=0.2)
    safe = VelocityFilter(robot, [WALL], period=period)
    driven = Lagged((1.0, 0.0, 0.0), lag, delay)
    for k in range(round(8.0 / period)):
        at = 1.5 - driven.pose[2]
        wanted = speed * math.cos(at), speed * math.sin(at), turn
        given, report = safe.step(wanted, driven.pose, driven.velocity, period * k)
        assert max(x for x, _ in driven.drive(given, period)) < 1.8
        assert report["reason"] == Reason.NONE


@pytest.mark.parametrize(
    ("forward", "look_ahead", "turn"),
    [(0.1, 0.2, 2.84), (0.1, 0.3, 1.0), (0.1, 0.3, 2.84), (0.15, 0.3, 2.84), (0.22, 0.09, 2.84)],
)
@pytest.mark.parametrize("lag", [0.0, 0.02, 0.2])
def test_a_slow_robot_that_follows_is_no_alarm_however_fast_its_point_turns(
    forward, look_ahead, turn, lag
):
    robot = Robot(Command(forward=forward, turn=turn, look_ahead=look_ahead), reach=0.2)
    safe = VelocityFilter(robot, FAR, period=0.1)
    driven, rng = Lagged((0.0, 0.0, 0.0), lag, 0.0), np.random.default_rng(0)
    for k in range(300):
        if k % 4 == 0:
            wanted = rng.choice([-1.0, 1.0], 2) * (forward, turn)
        given, report = safe.step(wanted, driven.pose, driven.velocity, 0.1 * k)
        list(driven.drive(given, 0.1))
        assert report["reason"] == Reason.NONE


@pytest.mark.parametrize("gain", [0.0, -1.0])
@pytest.mark.parametrize(("forward", "look_ahead", "turn"), [(0.1, 0.2, 2.84), (0.1, 0.3, 1.0)])
@pytest.mark.filterwarnings("ignore:safety filter")
def test_a_slow_robot_that_does_not_follow_is_one(forward, look_ahead, turn, gain):
    robot = Robot(Command(forward=forward, turn=turn, look_ahead=look_ahead), reach=0.2)
    for seed in range(5):
        safe = VelocityFilter(robot, FAR, period=0.1)
        driven, rng = Lagged((0.0, 0.0, 0.0), 0.1, 0.0), np.random.default_rng(seed)
        reasons = []
        for k in range(100):
            if k % 10 == 0:
                wanted = rng.uniform(-1.0, 1.0, 2) * (forward, turn)
            given, report = safe.step(wanted, driven.pose, driven.velocity, 0.1 * k)
            list(driven.drive(gain * given, 0.1))
            reasons.append(report["reason"])
        assert Reason.RESPONSE in reasons


@pytest.mark.parametrize("ahead", [2.0, 60.0, 1e6])
def test_a_first_stamp_from_the_future_costs_its_own_sample(ahead):
    robot = Robot(Command(forward=0.5, turn=1.0, look_ahead=0.1), reach=0.2)
    safe = VelocityFilter(robot, [WALL], period=PERIOD)
    here, still, now = np.zeros(3), np.zeros(3), 1.7e9
    safe.step((0.0, 0.0), here, still, now + ahead)
    reasons = [safe.step((0.0, 0.0), here, still, now + PERIOD * k)[1]["reason"] for k in range(20)]
    assert reasons[1:] == [Reason.NONE] * 19


def simulated(command, seed):
    """Return a robot that follows by a drawn lag, delay, share and acceleration, with noise."""
    rng = np.random.default_rng(seed)
    lag, gain, hardest = rng.uniform(0.05, 0.3), rng.uniform(0.85, 1.05), rng.uniform(1.5, 3.0)
    noise = 0.03 * command.forward
    return Lagged(np.zeros(3), lag, rng.uniform(0.0, 0.1), hardest, gain, noise, seed)


def hostile(command, seed, seconds):
    """Return the least h of a run that drives at the nearest region, backs off and spins."""
    robot, rng, limits = simulated(command, seed), np.random.default_rng(seed), command.limits
    room = 0.25 + 0.6 * command.fastest + (command.look_ahead or 0.0)
    barriers = [
        HalfPlane("wall", 1, normal=(-1.0, 0.0), offset=-room),
        HalfPlane("side", 1, normal=(0.0, -1.0), offset=-room),
        Disc("pillar", 1, center=(-room - 0.2, -0.5 * room), radius=0.2),
    ]
    safe = VelocityFilter(Robot(command), barriers, period=PERIOD)
    least, mode, until = math.inf, 0, 0.0
    for k in range(round(seconds / PERIOD)):
        now = PERIOD * k
        if now >= until:
            mode, until = rng.integers(5), now + rng.uniform(0.3, 3.0)
        x = np.array([*robot.pose[:2], 0.0, 0.0])
        nearest = min(barriers, key=lambda b: b.h(x, now))
        away = -np.array(nearest.jet(x, now).gradient[:2]) * 2.0 * command.fastest
        cos, sin = math.cos(robot.pose[2]), math.sin(robot.pose[2])
        ahead, aside = cos * away[0] + sin * away[1], cos * away[1] - sin * away[0]
        turn = aside / command.look_ahead if command.look_ahead else 0.0
        straight = np.array([ahead, turn] if command.look_ahead else [ahead, aside, 0.0])
        spin = limits * rng.choice([-1.0, 1.0])
        wanted = (straight, straight, -straight, spin, limits)[mode]
        given, _ = safe.step(wanted, robot.pose, robot.velocity, now)
        path = [np.array([*place, 0.0, 0.0]) for place in robot.drive(given, PERIOD)]
        least = min(least, *(b.h(p, now) for p in path for b in barriers))
    return least


@pytest.mark.filterwarnings("ignore:.*")
@pytest.mark.parametrize("name", ROBOTS)
def test_on_a_free_floor_commands_pass(name):
    command = ROBOTS[name]
    safe, robot = VelocityFilter(Robot(command), FAR, period=PERIOD), simulated(command, 0)
    wanted = command.forward * np.eye(len(command.limits))[0]
    for k in range(100):
        given, _ = safe.step(wanted, robot.pose, robot.velocity, PERIOD * k)
        list(robot.drive(given, PERIOD))
    assert given[0] >= 0.95 * command.forward
    assert safe.fastest >= command.forward


@pytest.mark.physics
@pytest.mark.filterwarnings("ignore:.*")
@pytest.mark.parametrize("name", ROBOTS)
def test_hostile_commands_enter_nothing(name):
    assert min(hostile(ROBOTS[name], seed, 15.0) for seed in range(2)) > 0.0


def test_a_cap_below_what_its_row_reserves_is_refused_with_number_and_remedy():
    robot = Robot(ROBOTS["TurtleBot 3 Burger"])
    with pytest.raises(InvalidInputError, match=r"0\.1 m/s, expected above .* leave v_max out"):
        VelocityFilter(robot, FAR, v_max=0.1)
    measured = Robot(robot.command, Response(overshoot=0.0, residual=(0.0, 0.01, 0.02)))
    assert VelocityFilter(measured, FAR, v_max=0.2).fastest > 0.0


@pytest.mark.filterwarnings("ignore:.*")
def test_fastest_is_the_top_speed_under_a_cap_of_any_period():
    for period in (0.05, 0.15):
        safe = VelocityFilter("cart", FAR, period=period, v_max=1.2)
        x = given = 0.0
        for k in range(80):
            given = safe.step((1.2, 0.0), (x, 0.0, 0.0), (given, 0.0, 0.0), period * k)[0][0]
            x += period * given
        assert given == pytest.approx(safe.fastest, rel=0.02)


def test_a_robot_that_does_not_follow_is_warned_of():
    robot = Robot(ROBOTS["AMR"], Response(gain=(0.2, 1.0)))
    with pytest.warns(CoverageWarning, match=r"entry 0 of the command: the robot gives 0\.20"):
        VelocityFilter(robot, FAR)


@pytest.mark.parametrize(
    ("what", "make"),
    [
        ("2 numbers", lambda: Robot(ROBOTS["AMR"], Response(gain=(1.0,)))),
        ("none below 0", lambda: Response(residual=(-0.1, 0.2, 0.3))),
        ("none below the one before", lambda: Response(residual=(0.3, 0.2, 0.1))),
        ("got nan", lambda: Response(delay=math.nan)),
        ("look_ahead", lambda: Command(forward=1.0, turn=1.0, sideways=0.0)),
        ("a Command", lambda: Robot("cart")),
    ],
)
def test_what_does_not_fit_is_refused(what, make):
    with pytest.raises(InvalidInputError, match=what):
        make()


def test_what_is_assumed_grows_with_the_speed_and_never_falls_below_what_was_measured():
    cart = Walker.load("cart")
    known = cart.response
    for speed in (0.05, 0.22, 0.5, 1.2, 3.0):
        command = Command(forward=speed, turn=0.1, look_ahead=0.1)
        share = speed / cart.command.forward
        taken = assumed(command)
        assert taken.overshoot >= share * known.overshoot
        assert taken.residual[1] >= share * known.residual[1]
    slow = assumed(Command(forward=0.22, turn=0.1, look_ahead=0.1))
    assert slow.overshoot < 0.05
    assert not slow.complaints


@pytest.mark.parametrize("speed", [0.05, 0.2, 0.39, 3.0])
def test_the_remedy_of_a_cap_that_is_too_low_serves_that_speed(speed):
    cart = Walker.load("cart")
    if speed < cart.command.forward:
        with pytest.raises(InvalidInputError, match=rf"Command\(forward={speed:g}, …\)"):
            VelocityFilter(cart, FAR, period=0.02, v_max=speed)
    slow = Robot(replace(cart.command, forward=speed), cart.response, cart.reach)
    safe, x, given = VelocityFilter(slow, FAR, period=0.02), 0.0, np.zeros(2)
    assert safe.fastest == speed
    for k in range(200):
        given, report = safe.step((speed, 0.0), (x, 0.0, 0.0), (given[0], 0.0, given[1]), 0.02 * k)
        x += 0.02 * given[0]
    assert given[0] == pytest.approx(speed, rel=0.05)
    assert report["reason"] == 0
