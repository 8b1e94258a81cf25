"""Robots from .05 to 3 m/s that nobody has measured: they get their speed, and stay outside."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hcbf_gym.barriers import Disc, HalfPlane
from hcbf_gym.errors import CoverageWarning, InvalidInputError
from hcbf_robots import Command, Response, Robot, VelocityFilter
from hcbf_robots.walkers import Walker
from hcbf_robots.walkers.walker_response import assumed

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
TICK = 0.005
PERIOD = 0.05


class Simulated:
    """A robot that follows with a lag and a delay, by another share and with noise."""

    def __init__(self, command, seed):
        self.rng = rng = np.random.default_rng(seed)
        self.command = command
        self.tau, self.gain = rng.uniform(0.05, 0.3), rng.uniform(0.85, 1.05)
        self.hardest = rng.uniform(1.5, 3.0) * np.ones(len(command.limits))
        self.hardest[-1] /= 0.2  # a turn changes faster than a speed
        self.sway = 0.03 * command.forward
        self.waiting = [np.zeros(len(command.limits))] * round(rng.uniform(0.0, 0.1) / TICK)
        self.doing = np.zeros(len(command.limits))
        self.pose = np.zeros(3)

    @property
    def twist(self):
        return self.doing if len(self.doing) == 3 else np.array([self.doing[0], 0.0, self.doing[1]])

    @property
    def place(self):
        """Of its centre or axle, which must stay outside."""
        return np.array([*self.pose[:2], 0.0, 0.0])

    def go(self, told, seconds):
        """Follow a command; yield where it is, tick by tick."""
        for _ in range(round(seconds / TICK)):
            self.waiting.append(np.array(told))
            wanted = self.gain * self.waiting.pop(0)
            change = (wanted - self.doing) * TICK / self.tau
            self.doing = self.doing + np.clip(change, -TICK * self.hardest, TICK * self.hardest)
            forward, aside, turn = self.twist
            forward += self.sway * self.rng.standard_normal()
            yaw = self.pose[2]
            cos, sin = math.cos(yaw), math.sin(yaw)
            moved = [cos * forward - sin * aside, sin * forward + cos * aside, turn]
            self.pose = self.pose + TICK * np.array(moved)
            yield self.place


def hostile(command, seed, seconds):
    """Return the least h of a run that drives at the nearest region, backs off and spins."""
    robot, limits = Simulated(command, seed), command.limits
    room = 0.25 + 0.6 * command.fastest + (command.look_ahead or 0.0)
    barriers = [
        HalfPlane("wall", 1, normal=(-1.0, 0.0), offset=-room),
        HalfPlane("side", 1, normal=(0.0, -1.0), offset=-room),
        Disc("pillar", 1, center=(-room - 0.2, -0.5 * room), radius=0.2),
    ]
    door = VelocityFilter(Robot(command), barriers, period=PERIOD)
    least, mode, until = math.inf, 0, 0.0
    for k in range(round(seconds / PERIOD)):
        now = PERIOD * k
        if now >= until:
            mode, until = robot.rng.integers(5), now + robot.rng.uniform(0.3, 3.0)
        x = robot.place
        nearest = min(barriers, key=lambda b: b.h(x, now))
        wanted = -np.array(nearest.jet(x, now).gradient[:2]) * 2.0 * command.fastest
        cos, sin = math.cos(robot.pose[2]), math.sin(robot.pose[2])
        ahead, aside = cos * wanted[0] + sin * wanted[1], cos * wanted[1] - sin * wanted[0]
        turn = aside / command.look_ahead if command.look_ahead else 0.0
        straight = np.array([ahead, turn] if command.look_ahead else [ahead, aside, 0.0])
        asked = (straight, straight, -straight, limits * robot.rng.choice([-1.0, 1.0]), limits)[
            mode
        ]
        told, _ = door.step(asked, robot.pose, robot.twist, now)
        least = min(least, *(b.h(p, now) for p in robot.go(told, PERIOD) for b in barriers))
    return least


@pytest.mark.filterwarnings("ignore:.*")
@pytest.mark.parametrize("name", ROBOTS)
def test_on_a_free_floor_it_is_told_what_was_asked(name):
    command = ROBOTS[name]
    far = Disc("far", 1, center=(500.0, 0.0), radius=1.0)
    door = VelocityFilter(Robot(command), [far], period=PERIOD)
    robot = Simulated(command, 0)
    asked = command.forward * np.eye(len(command.limits))[0]
    for k in range(100):
        told, _ = door.step(asked, robot.pose, robot.twist, PERIOD * k)
        list(robot.go(told, PERIOD))
    assert told[0] >= 0.95 * command.forward
    assert door.fastest >= command.forward


@pytest.mark.physics
@pytest.mark.filterwarnings("ignore:.*")
@pytest.mark.parametrize("name", ROBOTS)
def test_hostile_commands_enter_nothing(name):
    assert min(hostile(ROBOTS[name], seed, 15.0) for seed in range(2)) > 0.0


def test_a_cap_below_what_its_row_reserves_is_refused_with_number_and_remedy():
    far = [Disc("far", 1, center=(500.0, 0.0), radius=1.0)]
    robot = Robot(ROBOTS["TurtleBot 3 Burger"])
    with pytest.raises(InvalidInputError, match=r"0\.1 m/s, expected above .* leave v_max out"):
        VelocityFilter(robot, far, v_max=0.1)
    measured = Robot(robot.command, Response(overshoot=0.0, residual=(0.0, 0.01, 0.02)))
    assert VelocityFilter(measured, far, v_max=0.2).fastest > 0.0


@pytest.mark.filterwarnings("ignore:.*")
def test_the_top_speed_under_a_cap_falls_with_the_period_and_is_said():
    far = [Disc("far", 1, center=(500.0, 0.0), radius=1.0)]
    for period in (0.05, 0.15):
        door = VelocityFilter("cart", far, period=period, v_max=1.2)
        x = told = 0.0
        for k in range(80):
            told = door.step((1.2, 0.0), (x, 0.0, 0.0), (told, 0.0, 0.0), period * k)[0][0]
            x += period * told
        assert told == pytest.approx(door.fastest, rel=0.02)


def test_a_robot_that_does_not_follow_is_said_at_the_door():
    far = [Disc("far", 1, center=(500.0, 0.0), radius=1.0)]
    robot = Robot(ROBOTS["AMR"], Response(gain=(0.2, 1.0)))
    with pytest.warns(CoverageWarning, match=r"entry 0 of the command: the robot gives 0\.20"):
        VelocityFilter(robot, far)


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
    cart, far = Walker.load("cart"), [HalfPlane("far", 1, (-1.0, 0.0), -900.0)]
    if speed < cart.command.forward:
        with pytest.raises(InvalidInputError, match=rf"Command\(forward={speed:g}, …\)"):
            VelocityFilter(cart, far, period=0.02, v_max=speed)
    slow = Robot(replace(cart.command, forward=speed), cart.response, cart.reach)
    door, x, told = VelocityFilter(slow, far, period=0.02), 0.0, np.zeros(2)
    assert door.fastest == speed
    for k in range(200):
        told, report = door.step((speed, 0.0), (x, 0.0, 0.0), (told[0], 0.0, told[1]), 0.02 * k)
        x += 0.02 * told[0]
    assert told[0] == pytest.approx(speed, rel=0.05)
    assert report["reason"] == 0
