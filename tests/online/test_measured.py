"""Measured robots: turning to and fro along a wall, straight at it, above a strict limit."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hcbf_gym.models import Reason
from hcbf_gym.models.grid import Grid
from hcbf_gym.programs import FilterStatus
from hcbf_robots import Command, Response, Robot, VelocityFilter
from hcbf_robots.maps import MapClass, RankedMap
from tests.online.followers import WALL, Lagged

EXACT = Response(
    residual=(0.003, 0.012, 0.05), deviation=0.01, overshoot=0.0, stopping=0.3, seconds=60.0
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
def test_a_robot_that_turns_to_and_fro_stays_out_of_the_wall(name, period, switch):
    command, lag, delay, hardest, braking = ROBOTS[name]
    response = replace(EXACT, time_constant=lag, delay=delay, braking=braking)
    for angle in (0.3, 0.8, 1.4, 1.57):
        safe = VelocityFilter(Robot(command, response, reach=0.2), [WALL], period=period)
        driven, calm = Lagged((0.9, 0.0, 0.0), lag, delay, hardest), True
        for k in range(round(16.0 / period)):
            at = (1.0 if int(k * period / 5.0) % 2 == 0 else -1.0) * (math.pi / 2 - angle)
            turn = command.turn * (1.0 if int(k * period / switch) % 2 == 0 else -1.0)
            along = at - driven.pose[2]
            wanted = 2.0 * math.cos(along), 2.0 * math.sin(along), turn
            given, report = safe.step(wanted, driven.pose, driven.velocity, period * k)
            assert abs(given[2]) <= command.turn
            assert report["reason"] == Reason.NONE
            calm = calm and report["status"] in CALM
            assert max(x for x, _ in driven.drive(given, period)) < 1.8, (angle, k, calm)


def test_it_may_turn_as_fast_as_it_can_where_it_follows_soon():
    response = replace(EXACT, time_constant=0.05, delay=0.0, braking=4.0)
    robot = Robot(Command(0.5, 2.0, sideways=0.5), response, reach=0.2)
    safe = VelocityFilter(robot, [WALL], period=0.05)
    driven = Lagged((0.0, 0.0, 0.0), 0.05, 0.0)
    for k in range(40):
        given, _ = safe.step((0.0, 0.0, 2.0), driven.pose, driven.velocity, 0.05 * k)
        list(driven.drive(given, 0.05))
    assert given[2] == 2.0


@pytest.mark.parametrize("braking", [1.0, 2.0, 4.0])
@pytest.mark.parametrize(("lag", "delay"), [(0.1, 0.02), (0.2, 0.1), (0.3, 0.1)])
@pytest.mark.parametrize("speed", [0.8, 1.5, 3.0])
@pytest.mark.filterwarnings("ignore:safety filter", "ignore:velocity filter")
def test_a_robot_that_drives_straight_at_a_wall_stops_before_it(speed, lag, delay, braking):
    response = replace(EXACT, time_constant=lag, delay=delay, braking=braking)
    robot = Robot(Command(speed, 1.0, sideways=speed), response, reach=0.2)
    for period in (0.05, 0.1):
        safe = VelocityFilter(robot, [WALL], period=period)
        driven = Lagged((1.8 - safe.horizon - speed, 0.0, 0.0), lag, delay, braking)
        for k in range(round((20.0 + safe.horizon / speed) / period)):
            given, report = safe.step((speed, 0.0, 0.0), driven.pose, driven.velocity, period * k)
            assert report["reason"] == Reason.NONE
            assert max(x for x, _ in driven.drive(given, period)) < 1.8, (period, k)


LATE = replace(EXACT, time_constant=0.3, delay=0.1, braking=0.97)
LIMITED = {
    "cart": Robot(Command(0.8, 1.5, look_ahead=0.2), LATE, reach=0.2),
    "holonomic": Robot(Command(0.8, 1.5, sideways=0.8), LATE, reach=0.2),
}
LIMIT = 0.4
CELLS = np.ones((200, 200), dtype=bool)
ZONE = RankedMap(
    Grid(0.1, (-10.0, -10.0, 0.0), CELLS.shape), (MapClass("slow", 1, "speed", CELLS, limit=LIMIT),)
)


@pytest.mark.parametrize("turning", [0.0, 0.1, -0.8], ids=["straight", "turns", "turns fast"])
@pytest.mark.parametrize("anew", [False, True], ids=["continues", "reset"])
@pytest.mark.parametrize("limits", ["cap", "zone"])
@pytest.mark.parametrize("name", LIMITED)
@pytest.mark.filterwarnings("ignore:safety filter", "ignore:v_max")
def test_no_step_above_a_strict_limit_is_called_calm(name, limits, anew, turning):
    safe, robot = VelocityFilter(LIMITED[name], [], period=0.1), LIMITED[name]
    driven = Lagged((0.0, 0.0, 0.0), 0.3, 0.1)
    wanted = np.zeros(len(robot.command.limits))
    wanted[0], wanted[-1], above, below = 0.8, turning, 0, 0
    for k in range(80):
        if k == 30:
            assert driven.velocity[0] > 0.7
            if anew:
                safe.reset()
            if limits == "cap":
                safe.v_max = LIMIT
            else:
                safe.barriers = [ZONE]
        given, report = safe.step(wanted, driven.pose, driven.velocity, 0.1 * k)
        if k >= 30 and np.hypot(*driven.velocity[:2]) > LIMIT + 1e-3:
            assert report["status"] == FilterStatus.UNSAFE, k
            above += 1
        elif k >= 30:
            below += report["status"] <= FilterStatus.SAFE
        list(driven.drive(given, 0.1))
    assert above >= 3
    assert below >= 20  # it is slow enough in the end, and calm
