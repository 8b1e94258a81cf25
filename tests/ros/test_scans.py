"""Scans that become old, and scanners that turn while the robot moves."""

import math

import numpy as np
import pytest

from benchmarks.ros.drive import ANGLES, SCAN, Drive
from hcbf_gym.barriers import HalfPlane
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models import Reason
from hcbf_gym.programs import FilterStatus
from hcbf_robots import Command, Response, Robot, VelocityFilter
from hcbf_robots.maps import Scan, points_of
from hcbf_robots.maps.scan import FINE
from hcbf_robots.online.sample import placed
from hcbf_robots.ros.sources import LONGEST_SWEEP, Beams

pytestmark = pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")

EXACT = Robot(
    Command(forward=1.0, turn=1.0, sideways=1.0),
    Response(time_constant=0.0, delay=0.0, residual=(0.0, 0.0, 0.0), braking=1.0),
)
PERIOD, PERSON, PACE, REACH = 0.05, 0.25, 0.5, 0.3
FINELY = np.linspace(-np.pi, np.pi, 360, endpoint=False)


def seen(center, pose, angles=ANGLES):
    """Return ranges of beams that meet a disc of the radius `PERSON`."""
    beams = np.column_stack([np.cos(angles + pose[2]), np.sin(angles + pose[2])])
    to = np.array(center) - pose[:2]
    ahead = beams @ to
    half2 = PERSON**2 - to @ to + ahead**2
    far = ahead - np.sqrt(np.maximum(half2, 0.0))
    return np.where((half2 > 0.0) & (far > 0.0), far, np.inf)


def approach(person, pose, velocity):
    """Return how far a robot is from a person [m], and how fast it drives at them itself [m/s]."""
    to = person - pose[:2]
    away = float(np.hypot(*to))
    return away - PERSON - REACH, float(np.dot(velocity, to)) / away


def reserved(report):
    return float(report["margin"][0])


@pytest.mark.parametrize("stamped", [True, False])
@pytest.mark.parametrize("clock", [0.0, 1.7e9])
def test_the_age_of_a_scan_beyond_its_period_is_reserved(stamped, clock):
    safe = VelocityFilter(EXACT, [], period=PERIOD)
    scan = Scan(
        "laser", [[0.06, 0.0], [0.06, 0.1]], (0.0, 0.0, 0.0), period=0.1, speed=PACE,
        stamp=clock if stamped else None,
    )  # fmt: skip
    safe.barriers = [scan]
    margins = []
    for k in range(20):
        _, report = safe.step(np.zeros(3), np.zeros(3), np.zeros(3), clock + PERIOD * k)
        margins.append(reserved(report))
    ages = PERIOD * (np.arange(20) + 1)  # at the end of each command
    grown = PACE * np.maximum(0.0, ages - 0.1)
    more = np.array(margins) - margins[0] - grown  # what the robot itself lags behind, too
    assert more.min() >= -1e-6
    assert more.max() < 0.26
    safe.barriers = [
        Scan("laser", scan.points, scan.pose, period=0.1, speed=PACE, stamp=clock + PERIOD * 19)
    ]
    _, report = safe.step(np.zeros(3), np.zeros(3), np.zeros(3), clock + PERIOD * 20)
    assert reserved(report) < margins[-1] - grown[-1] + 0.01


def test_where_nothing_moves_a_scan_does_not_become_old():
    safe = VelocityFilter(EXACT, [Scan("laser", [[0.1, 0.0]], (0.0, 0.0, 0.0))], period=PERIOD)
    margins = {
        reserved(safe.step(np.zeros(3), np.zeros(3), np.zeros(3), PERIOD * k)[1])
        for k in range(2000)
    }
    assert len(margins) == 1


@pytest.mark.parametrize(
    ("stamp", "message"),
    [(0.3, "0.30 s ahead of the clock"), (-61.0, "61.00 s old"), (1.7e9, "ahead")],
)
def test_a_scan_of_another_clock_is_not_accepted(stamp, message):
    scan = Scan("laser", [[3.0, 0.0]], (0.0, 0.0, 0.0), period=0.1, speed=PACE, stamp=stamp)
    safe = VelocityFilter(EXACT, [scan], period=PERIOD)
    with pytest.warns(UserWarning, match=f"'laser': .*{message}"):
        given, report = safe.step((0.5, 0.0, 0.0), np.zeros(3), np.zeros(3), 0.0)
    assert (report["status"], report["reason"]) == (FilterStatus.BACKUP, Reason.AGE)
    assert not given.any()
    safe.barriers = [Scan("laser", scan.points, scan.pose, period=0.1, speed=PACE, stamp=0.05)]
    _, report = safe.step((0.5, 0.0, 0.0), np.zeros(3), np.zeros(3), 0.05)
    assert report["status"] != FilterStatus.BACKUP


def met(blind_after, wanted=0.7):
    """Return (towards, status) at each contact with a person who walks at a robot of old scans."""
    safe = VelocityFilter(EXACT, [], period=PERIOD, radius=REACH)
    pose, given, person, found = np.zeros(3), np.zeros(3), np.array([3.0, 0.05]), []
    for k in range(60):
        now = PERIOD * k
        if k % 2 == 0 and now <= blind_after:
            points = points_of(seen(person, pose, FINELY), FINELY)
            safe.barriers = [Scan("laser", points, tuple(pose), 0.1, PACE, stamp=now)]
        given, report = safe.step((wanted, 0.0, 0.0), pose, given, now)
        for _ in range(5):
            pose = pose + 0.01 * given
            person = person - [0.01 * PACE, 0.0]
            apart, towards = approach(person, pose, given[:2])
            if apart <= 0.0:
                found.append((towards, report["status"]))
    return found


@pytest.mark.parametrize("blind_after", [0.5, 1.0, 1.5])
def test_an_old_scan_is_as_good_as_a_new_one_of_a_person_who_walks_at_the_robot(blind_after):
    fresh, old = met(math.inf), met(blind_after)
    assert all(status > FilterStatus.SAFE for _, status in old)
    assert max(towards for towards, _ in old) < max(towards for towards, _ in fresh) + 0.02


@pytest.mark.parametrize("blind_after", [1.0, 2.0, 3.0])
def test_the_node_does_not_drive_at_a_person_whom_an_old_scan_shows(blind_after):
    d = Drive({**SCAN, "scan.obstacle_speed": PACE}, wanted=(0.5, 0.0, 0.0))
    person, contacts = np.array([4.0, 0.05]), []

    def walk(d):
        person[0] -= 0.01 * PACE
        d.ranges = seen(person, d.pose)
        ahead = np.array([math.cos(d.pose[2]), math.sin(d.pose[2])])
        contacts.append(approach(person, d.pose, d.motion[0] * ahead))

    d.run(0.5)
    d.run(blind_after, each=walk)
    d.run(1.8, each=walk, scan=False)  # less than source_timeout
    assert all(apart > 0.0 or towards < 0.05 for apart, towards in contacts)


# -- a scanner that turns -------------------------------------------------------------------------

SWEEP = 0.1


def wall(pose, angle, at=2.0):
    """Return how far a beam goes until the wall x = at."""
    ahead = math.cos(angle + pose[2])
    return (at - pose[0]) / ahead if ahead > 1e-3 else math.inf


@pytest.mark.parametrize("turn", [-2.0, -0.5, 0.0, 0.5, 2.0])
@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.2, -0.1, 1.0)])
def test_each_beam_of_a_turning_scanner_counts_from_where_it_was_taken(turn, mount):
    d = Drive(SCAN).run(0.5, command=False, scan=False)
    begun, start = d.now.ros, d.pose.copy()
    angles = FINELY

    def at(after):
        return start + after * np.array([0.5, 0.0, turn])

    for k in range(11):
        d.now = d.now._replace(ros=begun + 0.01 * k, steady=d.now.steady + 0.01)
        pose = at(0.01 * k)
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        d.say_odometry(pose, twist=(0.5 * cos, -0.5 * sin, turn))
    sensors = [placed(at(SWEEP * i / 359), np.array(mount)) for i in range(360)]
    ranges = np.array([wall(*one) for one in zip(sensors, angles, strict=True)])
    ranges = np.where(ranges < 5.0, ranges, np.inf)
    beams = Beams(ranges, -np.pi, math.tau / 360, 0.05, 10.0, SWEEP / 359)
    shown = d.core.of_scan("scan", beams, mount, begun)
    assert d.core.hear_source("scan", shown, begun, d.now, "base_footprint")
    (scan,) = d.core.sources["scan"].entries
    for y in np.linspace(-1.0, 1.0, 21):
        assert scan.conditions[0].h(np.array([2.0, y, 0.0, 0.0])) <= FINE
        near = scan.conditions[0].h(np.array([1.5, y, 0.0, 0.0]))
        assert near == pytest.approx(0.5, abs=0.01)


def test_a_sweep_that_is_too_long_or_that_odometry_does_not_reach_is_refused():
    d = Drive(SCAN).run(0.5, command=False, scan=False)
    far = np.full(72, 3.0)
    for between in (1.1 * LONGEST_SWEEP / 71, -1e-3, math.nan):
        beams = Beams(far, -np.pi, math.tau / 72, 0.05, 10.0, between)
        with pytest.raises(InvalidInputError, match="time_increment: got"):
            d.core.of_scan("scan", beams, None, d.now.ros)
    beams = Beams(far, -np.pi, math.tau / 72, 0.05, 10.0, SWEEP / 71)
    assert d.core.of_scan("scan", beams, None, d.now.ros)
    with pytest.raises(InvalidInputError, match="expected odometry"):
        d.core.of_scan("scan", beams, None, d.now.ros + 5.0)


def turning(d, count=72):
    """Let a scanner turn once in `SWEEP`, a part of its beams in each tick."""
    angles = np.linspace(-np.pi, np.pi, count, endpoint=False)
    ranges, stamps, part = [], [], round(count * 0.01 / SWEEP) + 1

    def each(d):
        stamps.append(d.now.ros)
        for angle in angles[len(ranges) : len(ranges) + part]:
            far = wall(d.pose, angle)
            ranges.append(far if far < 6.0 else math.inf)
        if len(ranges) == count:
            beams = Beams(np.array(ranges), -np.pi, math.tau / count, 0.05, 10.0, 0.01 / part)
            shown = d.core.of_scan("scan", beams, None, stamps[0])
            d.core.hear_source("scan", shown, stamps[0], d.now, "base_footprint")
            ranges.clear()
            stamps.clear()

    return each


@pytest.mark.parametrize("turn", [-1.5, 0.6, 1.5])
def test_a_robot_that_turns_at_a_wall_that_a_turning_scanner_sees_stays_out(turn):
    d = Drive(SCAN, wanted=(0.6, 0.0, turn))
    look, least = turning(d), []

    def each(d):
        look(d)
        if d.ticks % 60 == 0:  # to and fro
            d.wanted = (0.6, 0.0, -d.wanted[2])
        least.append(2.0 - d.pose[0] - 0.3)

    d.run(8.0, scan=False, each=each)
    assert min(least) > 0.0
    assert min(least) < 0.7
    assert HalfPlane("wall", 1, (-1.0, 0.0), -2.0).h(np.array([*d.pose[:2], 0.0, 0.0])) > 0.3
