"""What a filter knows of its barriers remains where its settings change, or another continues."""

import copy
import math

import numpy as np
import pytest

from hcbf_gym.barriers import Disc
from hcbf_gym.models import Reason
from hcbf_robots import Command, Robot, VelocityFilter
from hcbf_robots.maps import Scan

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

ROBOT = Robot(Command(0.8, 1.5, sideways=0.5), reach=0.1)
T, STEPS, FAR = 0.05, 40, (5e5, 5e6)
SPEED = 0.4
"""Of what moves [m/s]."""


def made(barriers, origin, **options):
    goal = (origin[0], origin[1] + 0.5)
    return VelocityFilter(ROBOT, barriers, period=T, goal=goal, **options)


def nothing(safe, origin, k, t):
    return safe


def goal(safe, origin, k, t):
    safe.goal = (origin[0], origin[1] + 0.5 + 1e-3 * k)
    return safe


def cap(safe, origin, k, t):
    safe.v_max = (None, 0.7)[k % 2]
    return safe


def program(safe, origin, k, t):
    safe.program = ("lex-cbf-qp", "h-cbf-qp")[k % 2]
    return safe


def copied(safe, origin, k, t):
    return copy.deepcopy(safe)


def place(safe, origin, k, t):
    """Let a new filter continue in each step."""
    other = made(safe.barriers, origin)
    other.go_on_from(safe)
    return other


def planned(safe, origin, k, t):
    """Let a filter continue that has looked at goal and barriers, where the robot is not now."""
    other = made(safe.barriers, origin, guidance="geodesic")
    beside = (origin[0] + 2.0, origin[1] + 2.0, 0.0)
    other.step(np.zeros(3), beside, np.zeros(3), t)
    other.go_on_from(safe)
    return other


CHANGES = [nothing, goal, cap, program, copied, place, planned]
BOTH = pytest.mark.parametrize("origin", [(0.0, 0.0), FAR], ids=["near", "far"])


class Loop:
    """A robot that follows its commands within two tenths of a second."""

    def __init__(self, safe, origin, change):
        self.safe, self.origin, self.change = safe, origin, change
        self.pose, self.twist = np.array([*origin, 0.0]), np.zeros(3)

    def run(self, each=lambda safe, k: None):
        """Yield the report of each step, and where the robot is, seen from the origin."""
        for k in range(STEPS):
            t = 100.0 + k * T
            if k:
                self.safe = self.change(self.safe, self.origin, k, t)
            each(self.safe, k)
            command, report = self.safe.step(np.zeros(3), self.pose, self.twist, t)
            yield report, self.pose[:2] - self.origin
            self.twist = self.twist + 0.3 * (command - self.twist)
            self.pose = self.pose + T * self.twist


@BOTH
@pytest.mark.parametrize("change", CHANGES)
def test_a_moving_region_is_where_it_was_set_and_moves_on(change, origin):
    disc = Disc("it", 1, (origin[0] + 5.0, origin[1]), 0.5, (-SPEED, 0.1))
    for k, (report, at) in enumerate(Loop(made([disc], origin), origin, change).run()):
        there = 5.0 - SPEED * k * T - at[0], 0.1 * k * T - at[1]
        assert report["h"][0] == pytest.approx(math.hypot(*there) - 0.5, abs=1e-6)


@BOTH
@pytest.mark.parametrize("change", CHANGES)
def test_a_scan_without_a_stamp_becomes_older(change, origin):
    points = np.array([[0.9, 0.0], [0.9, 0.1]])
    scan = Scan("scan", points, (*origin, 0.0), period=0.1, speed=SPEED)
    loop = Loop(made([scan], origin), origin, change)
    margins = [float(report["margin"][0]) for report, _ in loop.run()]
    assert margins[-1] > SPEED * (STEPS - 1) * T


@BOTH
@pytest.mark.parametrize("every", [1, 10])
@pytest.mark.parametrize("change", CHANGES)
def test_motion_without_a_velocity_is_named_however_often_it_is_seen(change, every, origin):
    """Guidance looks at new barriers every half a second."""

    def seen(k):
        return [Disc("it", 1, (origin[0] + 5.0 - SPEED * k * T, origin[1]), 0.5)]

    def track(safe, k):
        if k % every == 0:
            safe.barriers = seen(k)

    loop = Loop(made(seen(0), origin, guidance="geodesic"), origin, change)
    found = [int(report["reason"]) for report, _ in loop.run(track)]
    assert Reason.MOVES in found[:25]


@BOTH
@pytest.mark.parametrize("change", CHANGES)
def test_what_rests_has_not_moved(change, origin):
    def track(safe, k):
        safe.barriers = [Disc("it", 1, (origin[0] + 5.0, origin[1]), 0.5)]

    loop = Loop(made([], origin, guidance="geodesic"), origin, change)
    assert all(report["reason"] != Reason.MOVES for report, _ in loop.run(track))
