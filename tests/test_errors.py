"""What counts as a number, wherever coordinates are given."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from PIL import Image

from hcbf_gym import scenarios, wrappers
from hcbf_gym.barriers import ConvexPolygon, Disc, Ellipse, HalfPlane
from hcbf_gym.errors import (
    CoverageWarning,
    HcbfError,
    InvalidInputError,
    finite_array,
    in_words,
    warned_once,
)
from hcbf_gym.estimation import Sensors
from hcbf_gym.models import Box
from hcbf_gym.scenarios import BoxObstacle
from hcbf_robots import Command, Robot, VelocityFilter
from hcbf_robots.maps import RankedMap

NO_NUMBERS = (
    ["1.0", "0.0"],
    [True, False],
    [0.0, True],
    [1.0 + 0.0j, 0.0],
    [None, 1.0],
    [10**400, 1],
    [[1.0], 0.0],
    np.array([True, False]),
    np.array(["1.0", "0.0"]),
    np.array([1.0j, 0.0]),
    "10",
    b"10",
    {"x": 1.0, "y": 0.0},
)


@pytest.mark.parametrize("malformed", NO_NUMBERS, ids=repr)
@pytest.mark.parametrize(
    "take",
    [
        lambda p: finite_array("p", p, (2,)),
        lambda p: HalfPlane("a", 1, normal=p),
        lambda p: Disc("a", 1, center=p),
        lambda p: Disc("a", 1, velocity=p),
        lambda p: Ellipse("a", 1, semi_axes=p),
        lambda p: ConvexPolygon("a", 1, vertices=(p, (1.0, 0.0), (0.0, 1.0))),
        lambda p: Box([-1.0, -1.0], p),
        lambda p: BoxObstacle("a", center=p, size=(1.0, 1.0, 1.0)),
        lambda p: scenarios.from_dict(scenarios.make("random").to_dict() | {"start": p}),
        lambda p: scenarios.from_dict(
            scenarios.make("random").to_dict() | {"reference": {"kind": "point", "goal": p}}
        ),
    ],
    ids=lambda take: "",
)
def test_coordinates_are_real_numbers(take, malformed):
    with pytest.raises(InvalidInputError):
        take(malformed)


@pytest.mark.parametrize("given", [(1, 0), [1.0, np.float32(0.0)], np.array([1, 0])])
def test_integers_and_arrays_are_coordinates(given):
    assert Disc("a", 1, center=given).center == (1.0, 0.0)


@pytest.mark.parametrize("name", list(Sensors.__dataclass_fields__))
@pytest.mark.parametrize("malformed", [1e160, np.inf, np.nan, -1.0, "1", True])
def test_sensors_beyond_what_can_be_computed_with_are_refused(name, malformed):
    with pytest.raises(InvalidInputError):
        Sensors(**{name: malformed})


@pytest.mark.parametrize("name", ["rate", "noise", "slip", "tilt", "drift_time"])
def test_a_sensor_s_number_that_is_divided_by_is_not_next_to_nothing(name):
    with pytest.raises(InvalidInputError):
        Sensors(**{name: 1e-300})


def test_what_is_warned_of_many_times_is_warned_once_also_where_it_fails():
    def fails():
        with warned_once():
            for text in ("one", "other", "one", "one"):
                warnings.warn(text, CoverageWarning, stacklevel=2)
            raise ZeroDivisionError

    with warnings.catch_warnings(record=True) as raised:
        warnings.simplefilter("always")
        with pytest.raises(ZeroDivisionError):
            fails()
    assert [(str(one.message), one.category) for one in raised] == [
        ("one", CoverageWarning),
        ("other", CoverageWarning),
    ]


def an_environment():
    gym.make("HCBF-A1Regions-v0", friction=0.3)


def a_filter():
    env = gym.make("HCBF-Regions-v0", scenario="random", disable_env_checker=True)
    wrappers.SafetyFilter(env, rows="usual")


def a_loop():
    robot = Robot(Command(forward=0.5, turn=1.0, look_ahead=0.1), reach=0.2)
    safe = VelocityFilter(robot, [Disc("a", 1, center=(3.0, 0.0), radius=0.5)])
    for time in (0.0, 0.05):
        safe.step((0.2, 0.0), (np.nan * time, 0.0, 0.0), (0.0, 0.0), time)


def a_map(folder):
    pixels = np.full((9, 9), 254, dtype=np.uint8)
    Image.fromarray(pixels).save(folder / "map.png")
    keys = "image: map.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
    limits = "occupied_thresh: 0.65\nfree_thresh: 0.25\nauthor: me\n"
    (folder / "map.yaml").write_text(keys + limits, encoding="utf-8")
    RankedMap.load(folder / "map.yaml")


@pytest.mark.parametrize("way", [an_environment, a_filter, a_loop, a_map])
def test_a_warning_names_the_users_line(way, tmp_path):
    with warnings.catch_warnings(record=True) as raised:
        warnings.simplefilter("always")
        way(tmp_path) if way is a_map else way()
    assert {one.filename for one in raised} == {__file__}


class SilentError(ValueError):
    """An error of a user's own, whose text cannot be read."""

    def __str__(self):
        raise RuntimeError("no text")

    __repr__ = __str__


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ValueError("no data"), "ValueError: no data"),
        (ValueError(), "ValueError"),
        (SilentError(), "SilentError"),
        (InvalidInputError("x: got 1"), "x: got 1"),
        (InvalidInputError(), "InvalidInputError"),
        (HcbfError(""), "HcbfError"),
    ],
    ids=lambda one: type(one).__name__,
)
def test_an_error_without_a_readable_text_is_named_by_its_class(error, words):
    assert in_words(error) == words
