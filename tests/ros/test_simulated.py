"""The simulated robot of `hcbf ros-sim`: any walker, whose time is the clock's."""

import math

import numpy as np
import pytest

from hcbf_robots.ros.robot import SimulatedRobot
from tests.robots.walkers import CARTS, LEARNED

pytestmark = pytest.mark.physics


@pytest.mark.parametrize("period", [0.01, 0.02, 0.023])
@pytest.mark.parametrize("walker", [*CARTS, *LEARNED])
def test_its_time_is_the_clocks_though_no_tick_divides_the_period(walker, period):
    robot = SimulatedRobot(walker)
    for k in range(60):
        robot.run(period)
        assert abs(robot.time - (k + 1) * period) <= 0.5 * robot.dt + 1e-9


@pytest.mark.parametrize("walker", [*CARTS, *LEARNED])
def test_it_follows_a_command_until_its_time_out_and_then_stands(walker):
    robot = SimulatedRobot(walker, start=(1.0, -2.0, 0.7))
    begun = robot.pose
    for _ in range(100):
        robot.command((0.3, 0.0, 0.0))
        robot.run(0.02)
    moved = robot.pose - begun
    ahead = math.cos(0.7) * moved[0] + math.sin(0.7) * moved[1]
    assert 0.3 * 1.2 < ahead < 0.3 * 2.2  # less by what it needs until it drives so fast
    assert abs(math.cos(0.7) * moved[1] - math.sin(0.7) * moved[0]) < 0.15
    robot.run(2.0)  # the last command is good for half a second
    stood = robot.pose
    robot.run(1.0)
    assert np.hypot(*(robot.pose - stood)[:2]) < 0.1
    assert not robot.fallen
    assert not robot.failed
    times = robot.timed_path()[:, 0]
    assert times == pytest.approx(robot.dt * np.arange(1, len(times) + 1))
