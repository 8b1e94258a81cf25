"""A robot that does not follow its commands is noticed before it enters; one that does, never."""

import math
import warnings

import numpy as np
import pytest

from benchmarks import command_tracking
from benchmarks.velocity_loops import LoopEpisode
from hcbf_gym.barriers import HalfPlane
from hcbf_gym.models.plant import Reason
from hcbf_gym.programs import FilterStatus
from hcbf_robots import VelocityFilter

ALARMS = Reason.RESPONSE, Reason.INPUT, Reason.MOTION, Reason.SLIP, Reason.LAG
WALL = [HalfPlane("wall", 1, (-1.0, 0.0), -20.0)]


FAULTS = [(robot, fault) for robot in ("cart", "a1") for fault in command_tracking.faults_of(robot)]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("robot", "fault"), FAULTS)
def test_a_fault_is_warned_of_before_a_region_is_entered(robot, fault):
    seen = command_tracking.run_one(robot, fault, k=0, seed=11)
    assert seen.alarmed < seen.entered
    assert seen.reason in ALARMS


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("robot", ["cart", "holonomic-cart"])
def test_an_undisturbed_robot_raises_no_alarm(robot):
    assert command_tracking.run_one(robot, None, k=2, seed=12).alarmed == math.inf


@pytest.mark.parametrize("seed", [13, 14])
def test_lost_and_jittered_messages_raise_no_alarm(seed):
    assert LoopEpisode("cart", "bang-bang", "random", seed, 20.0, 1.2, lost=0.3).run().alarm == 0


@pytest.mark.parametrize("on_alarm", ["warn", "brake"])
def test_dead_odometry_warns_or_brakes_as_the_user_chooses(on_alarm):
    safe = VelocityFilter("cart", WALL, period=0.05, on_alarm=on_alarm)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for k in range(40):
            command, report = safe.step((0.6, 0.0), np.zeros(3), np.zeros(3), 0.05 * k)
    assert any("does not do what it is commanded" in str(warning.message) for warning in caught)
    assert report["reason"] == Reason.RESPONSE
    brakes = on_alarm == "brake"
    assert (report["status"] == FilterStatus.BACKUP) == brakes
    assert (np.abs(command).max() == 0.0) == brakes
    safe.reset()
    assert safe.step((0.6, 0.0), np.zeros(3), np.zeros(3), 0.0)[1]["reason"] == Reason.NONE
