"""A user's loop: data that are late, repeated or out of order, and settings that change."""

import math
import warnings

import numpy as np
import pytest

from hcbf_gym import certificates
from hcbf_gym.barriers import (
    BarrierSet,
    Capsule,
    ConvexPolygon,
    Disc,
    Ellipse,
    HalfPlane,
    Shapes,
    SpeedLimit,
)
from hcbf_gym.barriers.many import each
from hcbf_gym.errors import InvalidInputError, SafetyWarning
from hcbf_gym.models import Reason
from hcbf_gym.models.grid import Grid
from hcbf_gym.programs import FilterStatus
from hcbf_robots import Command, Response, Robot, VelocityFilter
from hcbf_robots.maps import MapClass, RankedMap, Scan
from tests.worlds import OwnDisc

FAR = [Disc("far", 1, center=(50.0, 0.0), radius=1.0)]
EXACT = Robot(
    Command(forward=1.0, turn=2.0, sideways=1.0),
    Response(
        time_constant=0.02, delay=0.0, residual=(0.0, 0.02, 0.04), deviation=0.01, overshoot=0.01,
        braking=3.0,
    ),
)  # fmt: skip
PERIOD = 0.05


def drive(safe, seconds, *, odometry=PERIOD, late=0.0, shuffled=False, wanted=(1.0, 0.0, 0.0)):
    """Drive a robot that follows at once; return its path and the reports.

    Odometry has a period [s] and comes late [s]; every other sample may be a repeated one.
    """
    x, given, reports, path, past = 0.0, np.zeros(3), [], [], []
    for k in range(round(seconds / PERIOD)):
        now = PERIOD * k
        past.append((now, x, given[0]))
        ready = [one for one in past if one[0] <= now - late + 1e-9] or past[:1]
        fresh = [one for one in ready if abs(one[0] / odometry - round(one[0] / odometry)) < 1e-6]
        stamp, at, speed = fresh[-1 - (shuffled and k % 2 and len(fresh) > 1)]
        given, report = safe.step(wanted, (at, 0.0, 0.0), (speed, 0.0, 0.0), stamp, now)
        x += PERIOD * given[0]
        path.append(x)
        reports.append(report)
    return np.array(path), reports


@pytest.mark.parametrize(
    "how", [{}, {"odometry": 0.1}, {"late": 0.05}, {"odometry": 0.1, "shuffled": True}]
)
def test_repeated_and_late_data_within_max_age_are_propagated_and_stay_outside(how):
    wall = [HalfPlane("wall", 1, normal=(-1.0, 0.0), offset=-3.0)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        safe = VelocityFilter(EXACT, wall, period=PERIOD, max_age=0.3)
        path, reports = drive(safe, 8.0, **how)
    assert all(report["status"] != FilterStatus.BACKUP for report in reports)
    assert path.max() < 3.0
    assert path[-1] > 2.6  # it comes near
    assert path[20] > 0.5  # and does not stand meanwhile


def test_late_data_of_a_measured_robot_are_propagated_by_its_commands():
    wall = [HalfPlane("wall", 1, normal=(-1.0, 0.0), offset=-3.0)]
    reserved = []
    for robot in (EXACT, Robot(EXACT.command)):
        safe = VelocityFilter(robot, wall, period=PERIOD, max_age=0.3)
        path, reports = drive(safe, 16.0, late=0.2)
        before = np.concatenate([[0.0], path[:-1]])
        h = np.array([report["h"][0] for report in reports])
        off = np.abs(h - (3.0 - before))[5:]
        assert off.max() < (0.01 if robot is EXACT else 0.1)
        if robot is EXACT:
            assert all(report["status"] <= FilterStatus.SAFE for report in reports)
        exact = VelocityFilter(robot, wall, period=PERIOD)
        still = exact.step((0.0, 0.0, 0.0), np.zeros(3), np.zeros(3), 0.0)[1]["margin"][0]
        reserved.append(reports[-1]["margin"][0] - still)
    assert 0.0 < reserved[0] < 0.15
    assert reserved[1] == pytest.approx(0.5 * 1.5 * 0.2**2, abs=1e-6)


def test_a_command_is_good_from_now_on():
    safe = VelocityFilter(EXACT, FAR, period=PERIOD)
    given, report = safe.step((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0, now=1.08)
    assert report["valid_until"] == pytest.approx(1.13)
    np.testing.assert_array_equal(safe.command_at(1.12), given)
    np.testing.assert_array_equal(safe.command_at(1.07), np.zeros(3))


@pytest.mark.filterwarnings("ignore:.*")
@pytest.mark.parametrize("clock", [True, False])
def test_one_stamp_an_hour_ahead_costs_no_more_than_itself(clock):
    safe = VelocityFilter(EXACT, FAR, period=PERIOD)
    given, speeds = np.zeros(3), []
    for k in range(12):
        now = PERIOD * k
        stamp = now + 3600.0 if k == 6 else now
        present = (now,) if clock else ()
        given, report = safe.step(
            (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (*given[:2], 0.0), stamp, *present
        )
        speeds.append(given[0])
        assert k == 6 or report["status"] != FilterStatus.BACKUP, (k, report["reason"])
    if clock:
        assert speeds[6] == 0.0
    assert min(speeds[8:]) > 0.0


def test_a_cart_whose_pose_is_missing_meets_the_map_where_it_was():
    cells = np.zeros((60, 60), dtype=bool)
    cells[:, 45] = True
    room = RankedMap(Grid(0.1, (0.0, 0.0, 0.0), cells.shape), (MapClass("w", 1, "keepout", cells),))
    safe = VelocityFilter("cart", [room])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SafetyWarning)
        for time in (0.0, 0.05):  # before anything is known
            command, report = safe.step((0.0, 0.0), None, None, math.nan, time)
            assert not command.any()
        safe.step((0.5, 0.0), (3.8, 3.0, 0.0), (0.0, 0.0, 0.0), 0.1, 0.1)
        _, report = safe.step((0.5, 0.0), None, None, math.nan, 0.15)
    assert np.isnan(report["h"][0])  # the wall has a row without h


def test_settings_change_at_run_time():
    safe = VelocityFilter(EXACT, FAR, period=PERIOD, guidance="geodesic", goal=(3.0, 0.0))
    path, _ = drive(safe, 1.0)
    safe.v_max = 0.5
    assert safe.fastest < 0.5
    x, given = path[-1], np.diff(path)[-1:] / PERIOD
    for k in range(20, 60):
        given, report = safe.step((1.0, 0.0, 0.0), (x, 0.0, 0.0), (given[0], 0.0, 0.0), PERIOD * k)
        x += PERIOD * given[0]
    assert given[0] == pytest.approx(safe.fastest, rel=0.05)
    assert report["h"].shape == (2,)
    safe.v_max, safe.goal, safe.program = None, (-3.0, 0.0), "h-cbf-qp"
    _, report = safe.step((1.0, 0.0, 0.0), (x, 0.0, 0.0), (given[0], 0.0, 0.0), PERIOD * 60)
    assert report["h"].shape == (1,)
    assert report["status"] != FilterStatus.BACKUP
    assert safe.program == "h-cbf-qp"
    with pytest.raises(InvalidInputError, match="goal"):
        safe.goal = None
    with pytest.raises(InvalidInputError, match="v_max"):
        safe.v_max = 9.0


def test_margin_and_certificate_are_taken_as_by_the_wrapper():
    still = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0
    margins = [
        VelocityFilter("cart", FAR, radius=0.0, **more).step((0.0, 0.0), *still)[1]["margin"][0]
        for more in ({"margin": 0.3}, {"certificate": "cart"})
    ]
    assert margins[0] == pytest.approx(0.3)
    found = certificates.shipped()["cart"].margins
    assert found.distance <= margins[1] < found.distance + 1e-3  # and what turning strays by
    assert not math.isnan(margins[1])


def run(safe, clock, where=(0.0, 0.0), wanted=(0.6, 0.0, 0.0), seconds=6.0, change=None):
    """Drive the exact robot; return its path (k, 2) from `where` [m] on, and h and status.

    The clock begins at `clock` [s]; `change` (k, clock) is called before each step.
    """
    place, given, path, seen = np.zeros(2), np.zeros(3), [], []
    for k in range(round(seconds / PERIOD)):
        now = clock + PERIOD * k
        if change is not None:
            change(k, now)
        pose = (where[0] + place[0], where[1] + place[1], 0.0)
        given, report = safe.step(wanted, pose, (*given[:2], 0.0), now)
        place = place + PERIOD * given[:2]
        path.append(place)
        seen.append((*report["h"], report["status"]))
    return np.array(path), np.array(seen)


CROSSING = Disc("person", 1, center=(1.5, -1.2), radius=0.4, velocity=(0.0, 0.4))


@pytest.mark.parametrize("clock", [0.0, 1.7e9])
def test_what_moves_is_where_it_was_put_at_the_first_step_whatever_the_clock(clock):
    safe = VelocityFilter(EXACT, [CROSSING], period=PERIOD, radius=0.0)
    path, seen = run(safe, clock)
    times = PERIOD * np.arange(len(path))
    before = np.vstack([[0.0, 0.0], path[:-1]])
    apart = np.linalg.norm(before - [1.5, -1.2] - np.outer(times, [0.0, 0.4]), axis=1) - 0.4
    np.testing.assert_allclose(seen[:, 0], apart, atol=1e-6)
    assert apart.min() > 0.0
    assert (seen[:, 1] == FilterStatus.SAFE).any()  # it made way


def test_barriers_seen_at_a_stamp_have_moved_on_since():
    late, clock = 0.15, 1.7e9
    safe = VelocityFilter(EXACT, [CROSSING], period=PERIOD, radius=0.0)

    def track(k, now):  # a tracker at 10 Hz, .15 s late
        if k % 2 == 0:
            ago = now - clock - late
            at = Disc("person", 1, (1.5, -1.2 + 0.4 * ago), 0.4, (0.0, 0.4))
            safe.set_barriers([at], seen_at=now - late)

    _, seen = run(safe, clock, change=track)
    still = VelocityFilter(EXACT, [CROSSING], period=PERIOD, radius=0.0)
    _, expected = run(still, 0.0)
    np.testing.assert_allclose(seen[:, 0], expected[:, 0], atol=1e-6)
    assert (seen[:, -1] != FilterStatus.BACKUP).all()
    with pytest.raises(InvalidInputError, match="seen_at"):
        safe.set_barriers([CROSSING], seen_at=math.nan)


@pytest.mark.parametrize("off", [-1.7e9, -100.0, 0.5, 1.7e9])
def test_barriers_of_another_clock_are_not_accepted(off):
    safe = VelocityFilter(EXACT, [CROSSING], period=PERIOD, radius=0.0)
    safe.step((0.5, 0.0, 0.0), np.zeros(3), np.zeros(3), 100.0)
    safe.set_barriers([CROSSING], seen_at=100.0 + PERIOD + off)
    because = pytest.warns(SafetyWarning, match="the barriers")
    with because, pytest.warns(SafetyWarning, match="seen_at: got .* at .* expected a stamp"):
        given, report = safe.step((0.5, 0.0, 0.0), np.zeros(3), np.zeros(3), 100.0 + PERIOD)
    assert (report["status"], report["reason"]) == (FilterStatus.BACKUP, Reason.BARRIERS)
    assert not given.any()
    safe.set_barriers([CROSSING], seen_at=100.0 + PERIOD)
    given, report = safe.step((0.5, 0.0, 0.0), np.zeros(3), np.zeros(3), 100.0 + 2.0 * PERIOD)
    assert report["status"] in (FilterStatus.NOMINAL, FilterStatus.SAFE)


def test_guidance_follows_a_goal_and_barriers_that_are_set_meanwhile():
    def behind(k, now):
        if k == 40:
            safe.goal = (-2.0, 0.0)
        if k == 60:
            safe.barriers = [Disc("new", 1, (-1.0, 0.0), 0.3)]

    safe = VelocityFilter(EXACT, FAR, period=PERIOD, guidance="geodesic", goal=(2.0, 0.0))
    path, _ = run(safe, 100.0, wanted=(0.0, 0.0, 0.0), seconds=25.0, change=behind)
    assert path[39, 0] > 0.5
    assert np.linalg.norm(path[-1] - [-2.0, 0.0]) < 0.3  # and past what is new


BOX = np.array([[3.0, -1.0], [4.0, -1.0], [4.0, 0.0], [3.0, 0.2]])
WEDGE = np.array([[0.0, 2.0], [1.0, 2.0], [1.0, 3.0]])


def around(x, y):
    """Return barriers of every kind around a place [m]."""
    at = np.array([x, y])
    cells = np.zeros((20, 30), dtype=bool)
    cells[:, -1] = True
    grid = Grid(0.2, (x - 2.0, y - 2.0, 0.0), (20, 30))
    return [
        HalfPlane("wall", 1, (0.6, 0.8), 0.6 * (x - 3.0) + 0.8 * (y - 3.0)),
        Disc("disc", 1, (x + 2.0, y + 0.6), 0.3, (-0.05, 0.0)),
        Ellipse("ellipse", 2, (x + 1.0, y - 1.0), (0.5, 0.3), 0.4),
        Capsule("capsule", 2, (x + 1.0, y + 1.5), (x + 2.0, y + 1.5), 0.2),
        ConvexPolygon("box", 1, tuple(map(tuple, at + BOX))),
        SpeedLimit("slow", 1, 0.9),
        Shapes("scan", 1, "disc", [[x - 1.0, y, 0.2], [x - 1.0, y + 0.5, 0.2]]),
        Shapes("boxes", 2, "convex-polygon", [at + WEDGE]),
        Shapes("lines", 2, "half-plane", [[1.0, 0.0, x - 3.0]]),
        Shapes("bars", 2, "capsule", [[x, y - 2.0, x + 1.0, y - 2.0, 0.1]]),
        Shapes("eggs", 2, "ellipse", [[x, y + 3.5, 0.4, 0.2, 0.1]]),
        OwnDisc("post", 2, (x + 0.5, y - 0.9), 0.3),
        RankedMap(grid, (MapClass("walls", 1, "keepout", cells),)),
        Scan("laser", [[2.5, -0.4]], (x, y, 0.0)),
    ]


UTM = (500_000.0, 5_900_000.0)


def test_far_origins_change_nothing():
    runs = []
    for x, y in ((0.0, 0.0), UTM):
        safe = VelocityFilter(EXACT, around(x, y), period=PERIOD, radius=0.1)
        runs.append(run(safe, 0.0, (x, y), wanted=(0.6, 0.1, 0.0)))
    (path, seen), (far, far_seen) = runs
    np.testing.assert_allclose(far, path, atol=1e-6)
    np.testing.assert_allclose(far_seen, seen, atol=1e-6)
    assert np.linalg.norm(path[-1]) > 0.5
    assert (seen[:, -1] != FilterStatus.BACKUP).all()


def test_shapes_and_maps_elsewhere_have_the_same_h():
    rng = np.random.default_rng(0)
    step = np.array([7.0, -4.0])
    here = BarrierSet([around(0.0, 0.0)])
    there = BarrierSet([[one.moved(step) for one in each(around(0.0, 0.0))]])
    for x in rng.uniform(-2.0, 2.0, (50, 4)):
        t, away = np.array([0.3]), x + np.array([*step, 0.0, 0.0])
        found, expected = there.values(away[None], t), here.values(x[None], t)
        np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.filterwarnings("ignore:.*")
@pytest.mark.parametrize("robot", [EXACT, Robot(EXACT.command)])
def test_data_of_any_age_cost_no_more_time_than_others(robot):
    safe = VelocityFilter(robot, FAR, period=PERIOD, max_age=1e12)
    safe.step((1.0, 0.0, 0.0), np.zeros(3), np.zeros(3), 0.0, 0.0)
    given, report = safe.step((1.0, 0.0, 0.0), np.zeros(3), np.zeros(3), 0.0, 1.7e9)
    assert report["status"] != FilterStatus.NOMINAL
    assert np.isfinite(given).all()
