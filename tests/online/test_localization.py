"""A localization may correct the pose's frame: no alarm, and barriers stay where they are."""

import math
import warnings

import numpy as np
import pytest

from hcbf_gym._core import FIRST_ALARM
from hcbf_gym.barriers import Disc, HalfPlane
from hcbf_gym.models import Reason
from hcbf_gym.programs import FilterStatus
from hcbf_robots import Command, Robot, VelocityFilter
from hcbf_robots.online.sample import placed

pytestmark = pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")

PERIOD = 0.05
ROBOTS = {
    "cart": "cart",
    "holonomic": Robot(Command(forward=1.0, turn=1.0, sideways=1.0), reach=0.3),
}
SMALL = (0.1, 0.1, 0.05)
"""Of a correction, at most [m, rad]."""
WALL = HalfPlane("wall", 1, normal=(-1.0, 0.0), offset=-5.5)
FAR = Disc("far", 1, center=(500.0, 500.0), radius=1.0)


def between(local, pose):
    """Return the frame in which `local` is `pose`."""
    yaw = pose[2] - local[2]
    return np.array([*(pose[:2] - placed(np.array([0.0, 0.0, yaw]), local)[:2]), yaw])


def drive(robot, barriers, seconds, wanted, *, corrects=True, share=1.0, how="frame"):
    """Drive with odometry in a frame that is corrected every half second, at random.

    The robot does a share of its command. The filter gets the "frame", or corrected "pose"s.
    """
    safe = VelocityFilter(ROBOTS[robot], barriers, period=PERIOD)
    rng, true, odometry = np.random.default_rng(3), np.zeros(3), np.array([40.0, -7.0, 2.0])
    frame, doing, log = between(odometry, true), np.zeros(3), []
    wanted = np.array(wanted)
    for k in range(round(seconds / PERIOD)):
        if corrects and k % 10 == 0:
            measured = true + rng.uniform(-1.0, 1.0, 3) * SMALL
            frame = between(odometry, measured)
        command = wanted[[0, 2]] if robot == "cart" else wanted
        if how == "frame":
            out, report = safe.step(command, odometry, doing, k * PERIOD, frame=frame)
        else:
            out, report = safe.step(command, placed(frame, odometry), doing, k * PERIOD)
        doing = share * (np.array([out[0], 0.0, out[1]]) if robot == "cart" else out)
        middle = np.array([0.0, 0.0, 0.5 * PERIOD * doing[2]])
        moves = placed(middle, PERIOD * np.array([doing[0], doing[1], 0.0]))
        moves[2] = PERIOD * doing[2]
        true, odometry = placed(true, moves), placed(odometry, moves)
        log.append((true, out, int(report["status"]), Reason(int(report["reason"]))))
    return log


@pytest.mark.parametrize("robot", ROBOTS)
def test_corrections_are_no_alarm_and_the_robot_stops_before_the_wall(robot):
    log = drive(robot, [WALL], 30.0, (0.8, 0.0, 0.0))
    assert not any(reason >= FIRST_ALARM for *_, reason in log)
    assert all(status != FilterStatus.BACKUP for _, _, status, _ in log)
    nearest = max(true[0] for true, *_ in log)
    assert 5.5 - 0.3 - 1.2 < nearest < 5.5 - 0.3 + math.hypot(*SMALL[:2])


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_same_corrections_of_the_pose_are_an_alarm(robot):
    log = drive(robot, [WALL], 30.0, (0.8, 0.0, 0.0), how="pose")
    assert any(reason >= FIRST_ALARM for *_, reason in log)


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_robot_that_does_not_follow_is_seen_beside_corrections(robot):
    log = drive(robot, [FAR], 20.0, (0.8, 0.0, 0.3), share=0.3)
    assert any(reason == Reason.RESPONSE for *_, reason in log)


@pytest.mark.parametrize("robot", ROBOTS)
def test_far_from_everything_a_correction_changes_no_command(robot):
    """The model's velocity turns with the frame."""
    apart = [
        drive(robot, [FAR], 10.0, (0.8, 0.0, 0.5), corrects=corrects) for corrects in (True, False)
    ]
    for (_, one, *_), (_, other, *_) in zip(*apart, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


@pytest.mark.parametrize("frame", [(math.nan, 0.0, 0.0), (0.0, math.inf, 0.0), (0.0, 1.0), "map"])
def test_an_invalid_frame_is_not_accepted(frame):
    safe = VelocityFilter("cart", [FAR], period=PERIOD)
    for k in range(10):
        given = frame if k == 5 else (0.0, 0.0, 0.0)
        doing, report = safe.step((0.5, 0.0), np.zeros(3), np.zeros(3), k * PERIOD, frame=given)
        assert (report["status"] == FilterStatus.BACKUP) == (k == 5)
        assert doing.any() == (k != 5)


def test_a_frame_that_is_not_known_any_more_is_not_taken_for_none():
    wall = [HalfPlane("wall", 1, normal=(-1.0, 0.0), offset=-4.0)]
    robot = Robot(Command(forward=0.5, turn=1.0, look_ahead=0.2), reach=0.2)
    safe = VelocityFilter(robot, wall, period=0.05)
    here, still = np.zeros(3), np.zeros(3)
    statuses = []
    for k, frame in enumerate([(3.0, 0.0, 0.0)] * 3 + [None] * 3 + [(3.0, 0.0, 0.0)] * 2):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            doing, report = safe.step((0.5, 0.0), here, still, 0.05 * k, frame=frame)
        statuses.append(report["status"])
        if frame is None:
            assert report["reason"] == Reason.STATE
            assert np.abs(doing).max() == 0.0
        else:
            assert report["h"][0] == pytest.approx(1.0, abs=0.3)
    assert statuses[3:6] == [FilterStatus.BACKUP] * 3
    assert FilterStatus.BACKUP not in statuses[6:]
    safe.reset()
    assert safe.step((0.5, 0.0), here, still, 9.0)[1]["status"] <= FilterStatus.SAFE
