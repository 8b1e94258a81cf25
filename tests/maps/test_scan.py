"""What a scan shows: straight surfaces in the world, whatever pose and beams they were seen by."""

import warnings

import numpy as np
import pytest

from hcbf_gym.barriers import BarrierSet, Disc
from hcbf_gym.errors import InvalidInputError
from hcbf_robots import Command, Response, Robot, VelocityFilter
from hcbf_robots.maps import MapClass, Scan, paying, points_of
from hcbf_robots.maps.scan import FINE, REACH
from hcbf_robots.maps.surfaces import CLOSE
from tests.maps.floors import cells, room

ANGLES = np.linspace(-np.pi, np.pi, 360, endpoint=False)
POSE = (1.0, -2.0, 0.7)
ALONG, NORMAL, OFF = np.array([0.6, 0.8]), np.array([0.8, -0.6]), 3.0
"""A wall: NORMAL · p = OFF, in no direction of an axis."""
HERE = np.array([3.1, -0.2])
"""Half a metre before it."""


def h(scan, points):
    states = np.column_stack([points, np.zeros((len(points), 2))])
    return np.array([scan.conditions[0].h(x) for x in states])


def beams_at_the_wall(pose, angles=ANGLES, openings=()):
    """Return ranges of beams that meet the wall, but where it is open: from a to b along it."""
    beams = np.column_stack([np.cos(angles + pose[2]), np.sin(angles + pose[2])])
    with np.errstate(divide="ignore"):
        far = (OFF - NORMAL @ pose[:2]) / (beams @ NORMAL)
    far = np.where(far > 0.0, far, np.inf)
    along = (pose[:2] + np.where(far < 50.0, far, 0.0)[:, None] * beams) @ ALONG
    for low, high in openings:
        far = np.where((low < along) & (along < high), np.inf, far)
    return np.where(far < 8.0, far, np.inf)


def seen(pose, angles=ANGLES, noise=0.0, rng=None, **options):
    ranges = beams_at_the_wall(np.array(pose), angles)
    if rng is not None:
        ranges = ranges + rng.normal(0.0, noise / 3.0, angles.size)
    return Scan("laser", points_of(ranges, angles), pose, noise=noise, **options)


def poses(count, rng):
    for _ in range(count):
        x, y = HERE + rng.uniform(-0.05, 0.05, 2)
        yield x, y, rng.uniform(-np.pi, np.pi)


def test_every_point_lies_in_or_beside_a_piece_and_pieces_are_few():
    ranges = 3.0 + np.sin(3.0 * ANGLES)
    scan = Scan("laser", points_of(ranges, ANGLES), POSE)
    turned = ANGLES + POSE[2]
    points = POSE[:2] + ranges[:, None] * np.column_stack([np.cos(turned), np.sin(turned)])
    assert h(scan, points).max() <= FINE
    assert len(scan.conditions[0].pieces) < 360 / 3


def test_a_wall_is_the_same_from_every_pose():
    rng = np.random.default_rng(0)
    at = HERE + rng.uniform(-0.3, 0.3, (50, 2))
    for pose in poses(20, rng):
        np.testing.assert_allclose(h(seen(pose), at), OFF - at @ NORMAL, atol=2e-6)


def test_noise_moves_a_wall_by_less_than_is_reserved():
    rng = np.random.default_rng(1)
    for noise in (0.03, 0.06):
        scans = [seen(pose, noise=noise, rng=rng) for pose in poses(50, rng)]
        off = np.array([h(scan, HERE[None])[0] for scan in scans]) - (OFF - HERE @ NORMAL)
        assert np.abs(off).max() < noise
        assert np.abs(off).mean() < noise / 6.0
        assert scans[0].conditions[0].margin == pytest.approx(2.0 * noise + FINE)


def rough(rng):
    """Return ranges of a random surface: a wall, waves, a box around, with bumps."""
    kind = rng.integers(3)
    if kind == 0:
        far = beams_at_the_wall(np.array([*HERE, rng.uniform(-np.pi, np.pi)]))
    elif kind == 1:
        far = 2.0 + rng.uniform(0.0, 0.5) * np.sin(rng.integers(1, 9) * ANGLES + rng.uniform(0, 6))
    else:
        turn = ANGLES + rng.uniform(0.0, 6.0)
        far = rng.uniform(0.5, 2.0) / np.maximum(abs(np.cos(turn)), abs(np.sin(turn)))
    bumps = rng.choice([-1.0, 0.0, 1.0], ANGLES.size, p=[0.1, 0.8, 0.1])
    return far + rng.uniform(0.0, 0.08) * bumps


def worst(noise, rng):
    """Return errors of ranges of at most the noise: constant, of random signs, slow, or any."""
    errors = (
        rng.choice([-1.0, 1.0]),
        rng.choice([-1.0, 1.0], ANGLES.size),
        np.sin(rng.integers(1, 40) * ANGLES),
        rng.uniform(-1.0, 1.0, ANGLES.size),
    )
    return noise * errors[rng.integers(4)]


def test_with_errors_of_at_most_the_noise_the_true_distance_is_at_least_the_robots_margin():
    rng, beyond = np.random.default_rng(6), -np.inf
    beams = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
    for _ in range(300):
        noise, margin = rng.uniform(0.0, 0.08), 0.2
        far = rough(rng)
        measured = np.maximum(far + worst(noise, rng), 0.0)
        options = {"noise": noise, "margin": margin}
        scan = Scan("laser", points_of(measured, ANGLES), (0.0, 0.0, 0.0), **options)
        seen = far < REACH - 1.0
        met = far[seen, None] * beams[seen]
        after = np.roll(met, -1, axis=0)
        near = np.linalg.norm(after - met, axis=1) < CLOSE
        between = 0.5 * (met + after)[near]
        lies = h(scan, np.concatenate([met, between]))  # of the true surface, whose own h is 0
        assert lies.max() <= scan.conditions[0].margin - margin + 1e-9
        beyond = max(beyond, (lies.max() - noise - FINE) / max(noise, 1e-3))
    assert beyond > 0.5  # what was reserved once was not enough


def test_what_lies_between_two_beams_of_one_surface_is_covered():
    rng = np.random.default_rng(2)
    places = OFF * NORMAL + np.linspace(-0.5, 0.5, 200)[:, None] * ALONG + (HERE @ ALONG) * ALONG
    for beams in (360, 72, 40):
        angles = np.linspace(-np.pi, np.pi, beams, endpoint=False)
        for pose in poses(10, rng):
            assert h(seen(pose, angles), places).max() <= 0.0


def test_dropped_beams_leave_no_hole_and_openings_stay_open():
    rng = np.random.default_rng(3)
    middle = HERE @ ALONG
    gap = OFF * NORMAL + np.array([[middle, middle + 0.3]]).T * ALONG
    for x, y, yaw in poses(20, rng):
        ranges = beams_at_the_wall(np.array([x, y, yaw]))
        dropped = np.where(rng.random(360) < 0.3, np.inf, ranges)
        scan = Scan("laser", points_of(dropped, ANGLES), (x, y, yaw))
        np.testing.assert_allclose(h(scan, HERE[None]), OFF - HERE @ NORMAL, atol=0.01)
        assert h(scan, gap).max() <= 0.0
        gapped = beams_at_the_wall(np.array([x, y, yaw]), openings=[(middle - 0.4, middle + 0.4)])
        free = h(Scan("laser", points_of(gapped, ANGLES), (x, y, yaw)), gap[:1])[0]
        assert 0.38 < free < 0.45


def test_what_stands_before_a_wall_is_not_joined_to_it():
    angles = np.radians(np.arange(-45.0, 45.0))
    ranges = np.where(np.abs(np.degrees(angles)) < 6.0, 1.0, 3.0) / np.cos(angles)
    scan = Scan("laser", points_of(ranges, angles), (0.0, 0.0, 0.0))
    assert h(scan, np.array([[2.0, 0.4]]))[0] > 0.2
    assert h(scan, np.array([[1.0, 0.0], [3.0, 1.0]])).max() <= 0.0


def test_its_depth_changes_no_distance_from_where_it_was_seen():
    points = np.array([[1.0, y] for y in np.arange(-0.5, 0.5, 0.02)])
    thin, thick = (Scan("laser", points, (0.0, 0.0, 0.0), depth=d) for d in (0.01, 1.0))
    before = np.random.default_rng(5).uniform([-1.0, -2.0], [0.99, 2.0], (50, 2))
    np.testing.assert_allclose(h(thin, before), h(thick, before), atol=1e-12)
    assert h(thick, np.array([[1.3, 0.0]]))[0] == pytest.approx(-0.3, abs=1e-3)
    assert h(thin, np.array([[1.3, 0.0]]))[0] > 0.2


def test_a_ring_around_the_sensor_is_closed():
    for first in (0.0, 0.7, 3.0):
        angles = first + np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)
        scan = Scan("laser", points_of(np.ones(90), angles), (0.0, 0.0, 0.0))
        turn = np.linspace(0.0, 2.0 * np.pi, 500)
        assert h(scan, np.column_stack([np.cos(turn), np.sin(turn)])).max() < FINE


def test_nothing_in_sight_is_free_and_what_is_too_near_to_be_measured_lies_at_the_sensor():
    nothing = np.full(360, np.inf)
    for points in (points_of(nothing, ANGLES), []):
        assert h(Scan("laser", points, POSE), np.zeros((1, 2)))[0] > 100.0
    nothing[7] = -np.inf
    assert h(Scan("laser", points_of(nothing, ANGLES), POSE), np.array([POSE[:2]]))[0] <= 0.0
    far = np.nextafter(REACH, 0.0)  # a point just within reach is seen
    assert h(Scan("tracker", [[far, far]], (0.0, 0.0, 0.0)), np.array([[far, far]]))[0] <= 0.0


def test_speed_times_period_is_reserved_all_the_time():
    scan = Scan("laser", [[1.0, 0.0]], POSE, period=0.1, speed=2.0, margin=0.05, noise=0.01)
    assert scan.conditions[0].margin == pytest.approx(0.27 + FINE)


MALFORMED = (
    {"points": [[1.0, 2.0, 3.0]]}, {"points": ["a"]}, {"points": [[np.nan, 0.0]]},
    {"pose": (0.0, np.nan, 0.0)}, {"period": -0.1}, {"depth": 0.0}, {"noise": np.nan},
    {"speed": np.inf},
)  # fmt: skip


@pytest.mark.parametrize("malformed", MALFORMED)
def test_a_malformed_scan_is_refused(malformed):
    with pytest.raises(InvalidInputError, match="laser"):
        Scan(**({"name": "laser", "points": [[1.0, 0.0]], "pose": POSE} | malformed))
    with pytest.raises(InvalidInputError, match="got NaN"):  # a beam that failed saw something
        points_of(np.where(np.arange(360) == 7, np.nan, np.inf), ANGLES)


def test_a_class_that_is_relaxed_is_named_with_the_place():
    ranked = room(0, mats=MapClass("mats", 2, "keepout", cells(3)))
    at = np.array([2.0, 1.5])
    (only,) = paying(ranked, at, [0.0, 0.3])
    assert (only.name, only.slack) == ("mats", 0.3)
    assert ranked.distance([only.place], 2)[0] <= 1e-9
    away = max(ranked.distance([at], 2)[0], 0.0)
    assert np.linalg.norm(only.place - at) == pytest.approx(away)


def test_a_map_beside_new_scans_stays_where_it_stands():
    rng, floor = np.random.default_rng(4), room(0)
    at = np.column_stack([rng.uniform(0.0, 4.0, (20, 2)), np.zeros((20, 2))])
    last, arrays = None, []
    for k in range(60):
        scan = Scan("laser", rng.uniform(-2.0, 2.0, (3, 2)), (2.0, 2.0, 0.1 * k))
        listed = [Disc("post", 1, (1.0, 1.0), 0.1)] if k % 20 == 19 else [floor, scan]
        made = BarrierSet([listed], last)
        anew = BarrierSet([listed]).along(at, np.zeros(20))
        np.testing.assert_array_equal(made.along(at, np.zeros(20)), anew)
        if last is not None and len(last.listed[0]) == 2:  # the old set is as it was
            again = BarrierSet(last.listed).along(at, np.zeros(20))
            np.testing.assert_array_equal(last.along(at, np.zeros(20)), again)
        if made.atlas:
            arrays.append(made.atlas.numbers)
        last = made
    assert len({id(one) for one in arrays}) < 20
    assert max(one.size for one in arrays) < 2 * arrays[0].size


@pytest.mark.parametrize(("speed", "warned"), [(0.5, False), (3.0, True)])
def test_a_robot_that_must_see_farther_than_a_scan_reaches_is_warned_of(speed, warned):
    response = Response(time_constant=0.1, delay=0.02, braking=0.8, residual=(0.01, 0.02, 0.05))
    robot = Robot(Command(speed, 1.0, sideways=speed), response, reach=0.2)
    seen = Scan("laser", np.array([[5.9, 0.0], [5.9, 0.1]]), (0.0, 0.0, 0.0))
    with warnings.catch_warnings(record=True) as raised:
        warnings.simplefilter("always")
        safe = VelocityFilter(robot, [], period=0.05)
        setters = (
            lambda: VelocityFilter(robot, [seen], period=0.05),
            lambda: setattr(safe, "barriers", [seen]),  # before its first step
            lambda: safe.step((0.0, 0.0, 0.0), np.zeros(3), np.zeros(3), 0.0),
            lambda: safe.set_barriers((seen,), 0.0),
        )
        for set_barriers, warns in zip(setters, (True, True, False, True), strict=True):
            raised.clear()
            set_barriers()
            found = [one for one in raised if "must see" in str(one.message)]
            assert len(found) == (warned and warns)
        raised.clear()
        reach = safe.horizon + seen.reserved
        safe.barriers = [Scan("farther", seen.points, seen.pose, reach=reach)]
        safe.v_max = 0.8 if warned else None  # strict: so fast it never is
        safe.barriers = [seen]
    assert not [one for one in raised if "must see" in str(one.message)]
    assert (reach > 6.0) == warned
