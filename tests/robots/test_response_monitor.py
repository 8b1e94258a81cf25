"""Whether a robot that does not do what it is told is noticed, and one that does is left alone."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hcbf_gym.robots import Walker
from hcbf_gym.robots.response_monitor import ResponseMonitor
from hcbf_gym.robots.walker_parts import Command

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
