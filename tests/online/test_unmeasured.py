"""Robots that nobody has measured: they may follow at once, or as late as is assumed."""

import math
from collections import deque

import numpy as np
import pytest

from hcbf_gym.barriers import HalfPlane
from hcbf_gym.models.plant import Reason
from hcbf_robots import Command, Robot, VelocityFilter

PERIOD, TICK = 0.05, 0.005
WALL = HalfPlane("wall", 1, normal=(-1.0, 0.0), offset=-2.0)


class Lagged:
    """A robot that follows velocities in its own axes by a delay and a first-order lag."""

    def __init__(self, pose, lag, delay, hardest=math.inf):
        self.pose, self.velocity = np.array(pose), np.zeros(3)
        self._most = TICK * hardest  # change of its velocity in the plane
        self._share = 1.0 if lag == 0.0 else 1.0 - math.exp(-TICK / lag)
        self._told = deque([np.zeros(3)] * (round(delay / TICK) + 1))

    def drive(self, command, seconds):
        """Yield the positions on the way."""
        told = np.array([command[0], 0.0, command[1]]) if len(command) == 2 else command
        for _ in range(round(seconds / TICK)):
            self._told.append(told)
            change = self._share * (self._told.popleft() - self.velocity)
            change[:2] *= min(1.0, self._most / max(float(np.hypot(*change[:2])), 1e-12))
            self.velocity = self.velocity + change
            cos, sin = np.cos(self.pose[2]), np.sin(self.pose[2])
            ahead, aside, turn = self.velocity
            step = cos * ahead - sin * aside, sin * ahead + cos * aside, turn
            self.pose = self.pose + TICK * np.array(step)
            yield self.pose[:2].copy()


@pytest.mark.parametrize("turn", [-3.0, -2.0, -1.0, 1.0, 2.0])
@pytest.mark.parametrize(("lag", "delay"), [(0.0, 0.0), (0.15, 0.05), (0.3, 0.1)])
@pytest.mark.parametrize(("speed", "period"), [(0.3, 0.2), (1.0, 0.05), (2.0, 0.02)])
@pytest.mark.filterwarnings("ignore:velocity filter", "ignore:safety filter")
def test_who_turns_while_it_slides_along_a_wall_stays_out_of_it(turn, lag, delay, speed, period):
    robot = Robot(Command(forward=speed, turn=3.0, sideways=speed), reach=0.2)
    safe = VelocityFilter(robot, [WALL], period=period)
    driven = Lagged((1.0, 0.0, 0.0), lag, delay)
    for k in range(round(8.0 / period)):
        at = 1.5 - driven.pose[2]
        asked = speed * math.cos(at), speed * math.sin(at), turn
        told, report = safe.step(asked, driven.pose, driven.velocity, period * k)
        assert max(x for x, _ in driven.drive(told, period)) < 1.8
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
    safe = VelocityFilter(robot, [HalfPlane("far", 1, (-1.0, 0.0), -900.0)], period=0.1)
    driven, rng = Lagged((0.0, 0.0, 0.0), lag, 0.0), np.random.default_rng(0)
    for k in range(300):
        if k % 4 == 0:
            asked = rng.choice([-1.0, 1.0], 2) * (forward, turn)
        told, report = safe.step(asked, driven.pose, driven.velocity, 0.1 * k)
        list(driven.drive(told, 0.1))
        assert report["reason"] == Reason.NONE


@pytest.mark.parametrize("gain", [0.0, -1.0])
@pytest.mark.parametrize(("forward", "look_ahead", "turn"), [(0.1, 0.2, 2.84), (0.1, 0.3, 1.0)])
@pytest.mark.filterwarnings("ignore:safety filter")
def test_a_slow_robot_that_does_not_follow_is_one(forward, look_ahead, turn, gain):
    robot = Robot(Command(forward=forward, turn=turn, look_ahead=look_ahead), reach=0.2)
    for seed in range(5):
        safe = VelocityFilter(robot, [HalfPlane("far", 1, (-1.0, 0.0), -900.0)], period=0.1)
        driven, rng = Lagged((0.0, 0.0, 0.0), 0.1, 0.0), np.random.default_rng(seed)
        reasons = []
        for k in range(100):
            if k % 10 == 0:
                asked = rng.uniform(-1.0, 1.0, 2) * (forward, turn)
            told, report = safe.step(asked, driven.pose, driven.velocity, 0.1 * k)
            list(driven.drive(gain * told, 0.1))
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
