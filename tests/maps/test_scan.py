import numpy as np
import pytest

from hcbf_gym.errors import InvalidInputError
from hcbf_gym.maps import MapClass, Scan, paying
from hcbf_gym.maps.scan import REACH
from tests.maps.floors import cells, room

ANGLES = np.linspace(-np.pi, np.pi, 360, endpoint=False)
POSE = (1.0, -2.0, 0.7)


def h(scan, points):
    states = np.column_stack([points, np.zeros((len(points), 2))])
    return np.array([scan.conditions[0].h(x) for x in states])


def test_every_point_lies_in_a_piece_and_pieces_are_few():
    ranges = 3.0 + np.sin(3.0 * ANGLES)
    scan = Scan.of_ranges("laser", ranges, ANGLES, POSE)
    turned = ANGLES + POSE[2]
    seen = POSE[:2] + ranges[:, None] * np.column_stack([np.cos(turned), np.sin(turned)])
    assert (h(scan, seen) <= 0.0).all()
    assert len(scan.conditions[0].pieces) < 360 / 2


def test_nothing_in_sight_is_free():
    nothing = np.full(360, np.inf)
    assert h(Scan.of_ranges("laser", nothing, ANGLES, POSE), np.zeros((1, 2)))[0] > 100.0
    assert h(Scan("tracker", [], POSE), np.zeros((1, 2)))[0] > 100.0


def test_what_is_nearer_than_can_be_measured_lies_at_the_sensor():
    ranges = np.where(np.arange(360) == 7, -np.inf, np.inf)
    assert h(Scan.of_ranges("laser", ranges, ANGLES, POSE), np.array([POSE[:2]]))[0] <= 0.0


def test_a_point_just_within_reach_is_seen():
    far = np.nextafter(REACH, 0.0)
    scan = Scan("tracker", [[far, far]], (0.0, 0.0, 0.0))
    assert h(scan, np.array([[far, far]]))[0] <= 0.0


def test_age_times_speed_is_reserved():
    scan = Scan("laser", [[1.0, 0.0]], POSE, age=0.1, speed=2.0, margin=0.05)
    assert scan.conditions[0].margin == pytest.approx(0.25)
    older = scan.aged(0.3)
    assert older.conditions[0].margin == pytest.approx(0.65)
    assert older.conditions[0].pieces is scan.conditions[0].pieces


@pytest.mark.parametrize(
    "bent",
    [
        {"points": [[1.0, 2.0, 3.0]]},
        {"points": ["a"]},
        {"points": [[np.nan, 0.0]]},
        {"pose": (0.0, np.nan, 0.0)},
        {"age": -0.1},
        {"speed": np.inf},
    ],
)
def test_a_bent_scan_is_refused(bent):
    with pytest.raises(InvalidInputError, match="laser"):
        Scan(**({"name": "laser", "points": [[1.0, 0.0]], "pose": POSE} | bent))


def test_a_beam_that_failed_is_not_one_that_saw_nothing():
    ranges = np.where(np.arange(360) == 7, np.nan, np.inf)
    with pytest.raises(InvalidInputError, match="got NaN"):
        Scan.of_ranges("laser", ranges, ANGLES, POSE)


def test_who_pays_is_named_with_the_place():
    ranked = room(0, mats=MapClass("mats", 2, "keepout", cells(3)))
    at = np.array([2.0, 1.5])
    (only,) = paying(ranked, at, [0.0, 0.3])
    assert (only.name, only.slack) == ("mats", 0.3)
    assert ranked.distance([only.place], 2)[0] <= 1e-9
    away = max(ranked.distance([at], 2)[0], 0.0)
    assert np.linalg.norm(only.place - at) == pytest.approx(away)
