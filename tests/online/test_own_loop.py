"""A robot's own loop: data that are late, repeated or out of order, and settings that change."""

import math
import warnings

import numpy as np
import pytest

from hcbf_gym import Command, Response, Robot, VelocityFilter, certificates
from hcbf_gym.barriers import Disc, HalfPlane
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.plant import Reason
from hcbf_gym.programs import FilterStatus

FAR = [Disc("far", 1, center=(50.0, 0.0), radius=1.0)]
EXACT = Robot(
    Command(forward=1.0, turn=2.0, sideways=1.0),
    Response(
        time_constant=0.02, delay=0.0, residual=(0.0, 0.02, 0.04), sway=0.01, overshoot=0.01,
        braking=3.0,
    ),
)  # fmt: skip
PERIOD = 0.05


def drive(door, seconds, *, odometry=PERIOD, late=0.0, shuffled=False, wanted=(1.0, 0.0, 0.0)):
    """Drive a robot that follows at once; return its path, what it was told and the reports.

    Args:
        door: the filter.
        seconds: how long.
        odometry: its period [s].
        late: how old it is when it comes [s].
        shuffled: whether every other sample is one that has been seen before.
    """
    x, told, reports, path, past = 0.0, np.zeros(3), [], [], []
    for k in range(round(seconds / PERIOD)):
        now = PERIOD * k
        past.append((now, x, told[0]))
        ready = [one for one in past if one[0] <= now - late + 1e-9] or past[:1]
        fresh = [one for one in ready if abs(one[0] / odometry - round(one[0] / odometry)) < 1e-6]
        stamp, at, speed = fresh[-1 - (shuffled and k % 2 and len(fresh) > 1)]
        told, report = door.step(wanted, (at, 0.0, 0.0), (speed, 0.0, 0.0), stamp, now)
        x += PERIOD * told[0]
        path.append(x)
        reports.append(report)
    return np.array(path), reports


@pytest.mark.parametrize(
    "how", [{}, {"odometry": 0.1}, {"late": 0.05}, {"odometry": 0.1, "shuffled": True}]
)
def test_repeated_and_late_data_within_max_age_go_on_and_stay_outside(how):
    wall = [HalfPlane("wall", 1, normal=(-1.0, 0.0), offset=-3.0)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        door = VelocityFilter(EXACT, wall, period=PERIOD, max_age=0.3)
        path, reports = drive(door, 8.0, **how)
    assert all(report["status"] != FilterStatus.BACKUP for report in reports)
    assert path.max() < 3.0
    assert path[-1] > 2.6  # it comes near
    assert path[20] > 0.5  # and does not stand meanwhile


def test_a_command_is_good_from_now_on():
    door = VelocityFilter(EXACT, FAR, period=PERIOD)
    told, report = door.step((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0, now=1.08)
    assert report["valid_until"] == pytest.approx(1.13)
    np.testing.assert_array_equal(door.command_at(1.12), told)
    np.testing.assert_array_equal(door.command_at(1.07), np.zeros(3))


@pytest.mark.filterwarnings("ignore:.*")
@pytest.mark.parametrize("clock", [True, False])
def test_one_stamp_an_hour_ahead_costs_no_more_than_itself(clock):
    door = VelocityFilter(EXACT, FAR, period=PERIOD)
    told, speeds = np.zeros(3), []
    for k in range(12):
        now = PERIOD * k
        stamp = now + 3600.0 if k == 6 else now
        present = (now,) if clock else ()
        told, report = door.step(
            (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (*told[:2], 0.0), stamp, *present
        )
        speeds.append(told[0])
        assert k == 6 or report["status"] != FilterStatus.BACKUP, (k, report["reason"])
    if clock:
        assert speeds[6] == 0.0
    assert min(speeds[8:]) > 0.0


@pytest.mark.filterwarnings("ignore:.*")
def test_data_from_before_max_age_brake():
    door = VelocityFilter(EXACT, FAR, period=PERIOD, max_age=0.1)
    still = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(3):
        told, report = door.step((1.0, 0.0, 0.0), *still, 0.0, now=PERIOD * k)
        assert told[0] > 0.0
    told, report = door.step((1.0, 0.0, 0.0), *still, 0.0, now=0.15)
    assert report["reason"] == Reason.AGE
    np.testing.assert_array_equal(told, np.zeros(3))


def test_settings_change_at_run_time():
    door = VelocityFilter(EXACT, FAR, period=PERIOD, guidance="geodesic", goal=(3.0, 0.0))
    path, _ = drive(door, 1.0)
    door.v_max = 0.5
    assert door.fastest < 0.5
    x, told = path[-1], np.diff(path)[-1:] / PERIOD
    for k in range(20, 60):
        told, report = door.step((1.0, 0.0, 0.0), (x, 0.0, 0.0), (told[0], 0.0, 0.0), PERIOD * k)
        x += PERIOD * told[0]
    assert told[0] == pytest.approx(door.fastest, rel=0.05)
    assert report["h"].shape == (2,)
    door.v_max, door.goal, door.program = None, (-3.0, 0.0), "h-cbf-qp"
    _, report = door.step((1.0, 0.0, 0.0), (x, 0.0, 0.0), (told[0], 0.0, 0.0), PERIOD * 60)
    assert report["h"].shape == (1,)
    assert report["status"] != FilterStatus.BACKUP
    assert door.program == "h-cbf-qp"
    with pytest.raises(InvalidInputError, match="goal"):
        door.goal = None
    with pytest.raises(InvalidInputError, match="v_max"):
        door.v_max = 9.0


def test_margin_and_certificate_are_taken_as_by_the_wrapper():
    still = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0
    margins = [
        VelocityFilter("cart", FAR, radius=0.0, **given).step((0.0, 0.0), *still)[1]["margin"][0]
        for given in ({"margin": 0.3}, {"certificate": "cart"})
    ]
    assert margins[0] == pytest.approx(0.3)
    found = certificates.shipped()["cart"].margins
    assert found.distance <= margins[1] < found.distance + 1e-3  # and what turning strays by
    assert not math.isnan(margins[1])
