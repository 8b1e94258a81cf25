"""Measured robots that move in any direction and turn to and fro while they slide along a wall."""

import math
from dataclasses import replace

import pytest

from hcbf_gym.models.plant import Reason
from hcbf_gym.programs import FilterStatus
from hcbf_robots import Command, Response, Robot, VelocityFilter
from tests.online.test_unmeasured import WALL, Lagged

EXACT = Response(
    residual=(0.003, 0.012, 0.05), sway=0.01, overshoot=0.0, stopping=0.3, seconds=60.0
)
ROBOTS = {
    "late": (Command(0.8, 3.0, sideways=0.8), 0.3, 0.1, math.inf, 0.97),
    "spins": (Command(0.5, 4.0, sideways=0.5), 0.2, 0.1, math.inf, 0.91),
    "brakes slowly": (Command(1.0, 2.5, sideways=0.6), 0.15, 0.05, 1.5, 1.29),
}
CALM = (FilterStatus.NOMINAL, FilterStatus.SAFE, FilterStatus.RELAXED)


@pytest.mark.parametrize("switch", [0.6, 1.0, 2.0, 100.0])
@pytest.mark.parametrize("period", [0.05, 0.2])
@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.filterwarnings("ignore:safety filter")
def test_who_turns_to_and_fro_stays_out_of_the_wall(name, period, switch):
    command, lag, delay, hardest, braking = ROBOTS[name]
    response = replace(EXACT, time_constant=lag, delay=delay, braking=braking)
    for angle in (0.3, 0.8, 1.4, 1.57):
        safe = VelocityFilter(Robot(command, response, reach=0.2), [WALL], period=period)
        driven, calm = Lagged((0.9, 0.0, 0.0), lag, delay, hardest), True
        for k in range(round(16.0 / period)):
            at = (1.0 if int(k * period / 5.0) % 2 == 0 else -1.0) * (math.pi / 2 - angle)
            turn = command.turn * (1.0 if int(k * period / switch) % 2 == 0 else -1.0)
            along = at - driven.pose[2]
            asked = 2.0 * math.cos(along), 2.0 * math.sin(along), turn
            told, report = safe.step(asked, driven.pose, driven.velocity, period * k)
            assert abs(told[2]) <= command.turn
            assert report["reason"] == Reason.NONE
            calm = calm and report["status"] in CALM
            assert max(x for x, _ in driven.drive(told, period)) < 1.8, (angle, k, calm)


def test_it_may_turn_as_fast_as_it_can_where_it_follows_soon():
    response = replace(EXACT, time_constant=0.05, delay=0.0, braking=4.0)
    robot = Robot(Command(0.5, 2.0, sideways=0.5), response, reach=0.2)
    safe = VelocityFilter(robot, [WALL], period=0.05)
    driven = Lagged((0.0, 0.0, 0.0), 0.05, 0.0)
    for k in range(40):
        told, _ = safe.step((0.0, 0.0, 2.0), driven.pose, driven.velocity, 0.05 * k)
        list(driven.drive(told, 0.05))
    assert told[2] == 2.0


@pytest.mark.parametrize("braking", [1.0, 2.0, 4.0])
@pytest.mark.parametrize(("lag", "delay"), [(0.1, 0.02), (0.2, 0.1), (0.3, 0.1)])
@pytest.mark.parametrize("speed", [0.8, 1.5, 3.0])
@pytest.mark.filterwarnings("ignore:safety filter", "ignore:velocity filter")
def test_who_drives_straight_at_a_wall_stops_before_it(speed, lag, delay, braking):
    response = replace(EXACT, time_constant=lag, delay=delay, braking=braking)
    robot = Robot(Command(speed, 1.0, sideways=speed), response, reach=0.2)
    for period in (0.05, 0.1):
        safe = VelocityFilter(robot, [WALL], period=period)
        driven = Lagged((1.8 - safe.horizon - speed, 0.0, 0.0), lag, delay, braking)
        for k in range(round((20.0 + safe.horizon / speed) / period)):
            told, report = safe.step((speed, 0.0, 0.0), driven.pose, driven.velocity, period * k)
            assert report["reason"] == Reason.NONE
            assert max(x for x, _ in driven.drive(told, period)) < 1.8, (period, k)
