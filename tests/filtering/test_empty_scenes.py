"""Guidance where nothing is around: its row is the only one, from the first step on."""

import numpy as np
import pytest

from hcbf_gym import BatchFilter, VelocityFilter
from hcbf_gym.barriers import Disc
from hcbf_gym.models.input_sets import Box

GOAL = (3.0, 1.0)
ASIDE = [Disc("aside", 1, (-2.0, 2.0), 0.5)]


@pytest.mark.parametrize("robot", ["cart", "holonomic-cart"])
def test_a_robot_is_led_through_nothing(robot):
    safe = VelocityFilter(robot, [], goal=GOAL, guidance="geodesic", period=0.05)
    pose, twist = np.zeros(3), np.zeros(3)
    for k in range(120):
        if k in (20, 40):
            safe.barriers = ASIDE if k == 20 else []
        told, report = safe.step(np.zeros(len(safe.robot.command.limits)), pose, twist, 0.05 * k)
        assert report["reason"] == 0
        assert report["h"].shape == ((1,) if 20 <= k < 40 else (0,))
        ahead, aside = (told[0], 0.0) if len(told) == 2 else told[:2]
        twist = np.array([ahead, aside, told[-1]])
        middle = pose[2] + 0.025 * twist[2]
        cos, sin = np.cos(middle), np.sin(middle)
        step = cos * ahead - sin * aside, sin * ahead + cos * aside, twist[2]
        pose = pose + 0.05 * np.array(step)
    assert np.hypot(*(GOAL - pose[:2])) < 1.5


@pytest.mark.parametrize("program", ["lex-cbf-qp", "eh-cbf-qp"])
def test_many_points_are_led_through_nothing(program):
    led = BatchFilter(Box.symmetric(2.0), 0.05, 3, program=program, guidance="geodesic")
    led.set_scene([])
    x = np.zeros((3, 4))
    led.reset(np.ones(3, dtype=bool), x, goal=GOAL)
    for _ in range(60):
        u, report = led(np.zeros((3, 2)), x)
        assert (report["reason"] == 0).all()
        x[:, :2] += 0.05 * x[:, 2:] + 0.5 * 0.05**2 * u
        x[:, 2:] += 0.05 * u
    assert (x[:, 0] > 0.5).all()
