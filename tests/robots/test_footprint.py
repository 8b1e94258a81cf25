"""Footprints as Nav2 writes them: the circle that contains them, and malformed outlines."""

import math

import numpy as np
import pytest

from hcbf_gym.errors import InvalidInputError
from hcbf_robots import Command, Robot
from hcbf_robots.walkers import footprint

COMMAND = Command(forward=0.5, turn=1.0, look_ahead=0.2)
L_SHAPE = [[-0.2, -0.2], [0.4, -0.2], [0.4, 0.0], [0.1, 0.0], [0.1, 0.3], [-0.2, 0.3]]


def test_nav2s_text_and_a_list_mean_the_same():
    text = "[ [0.21, .195], [0.21, -0.195], [-0.21, -0.195], [-0.21, 0.195] ]"
    expected = math.hypot(0.21, 0.195)
    corners = [[0.21, 0.195], [0.21, -0.195], [-0.21, -0.195], [-0.21, 0.195]]
    for outline in (text, corners, corners[::-1], [*corners, corners[0]]):
        assert footprint.reach(outline) == pytest.approx(expected)
    assert footprint.reach(L_SHAPE) == pytest.approx(math.hypot(0.4, 0.2))
    assert Robot(COMMAND, footprint=text).reach == pytest.approx(expected)
    assert Robot(COMMAND, reach=0.5, footprint=text).reach == 0.5
    behind = [[0.0, 0.2], [0.4, 0.2], [0.4, -0.2], [0.0, -0.2]]  # the axle is on an edge
    assert footprint.reach(behind) == pytest.approx(math.hypot(0.4, 0.2))


def test_every_point_of_a_random_outline_lies_in_its_circle_and_one_on_it():
    rng = np.random.default_rng(0)
    for _ in range(200):
        angles = np.sort(rng.uniform(0.0, math.tau, rng.integers(3, 12)))
        if (np.diff(angles, append=angles[0] + math.tau) >= math.pi).any():
            continue  # (0, 0) lies outside
        points = rng.uniform(0.1, 1.0, len(angles)) * [np.cos(angles), np.sin(angles)]
        distance = np.linalg.norm(points, axis=0)
        assert footprint.reach(points.T) == pytest.approx(distance.max(), abs=1e-12)
        mirrored = points.T * [1.0, -1.0]
        assert footprint.reach(mirrored) == pytest.approx(distance.max(), abs=1e-12)


MALFORMED = {
    "no text of Nav2's": "[[0.2, 0.1], [0.2",
    "NaN in a text": "[[nan, 0.1], [0.2, -0.1], [-0.2, 0.0]]",
    "code": "__import__('os').getcwd()",
    "a long text": "[" * 9_999,
    "a number": 3.0,
    "triples": [[0.2, 0.1, 0.0]] * 4,
    "NaN": [[math.nan, 0.1], [0.2, -0.1], [-0.2, 0.0]],
    "millimetres": [[210.0, 195.0], [210.0, -195.0], [-210.0, 0.0]],
    "two corners": [[0.2, 0.1], [-0.2, -0.1]],
    "one corner again and again": [[0.2, 0.1]] * 5,
    "zero width": [[-0.2, 0.0], [0.2, 0.0], [0.1, 0.0]],
    "the axle outside": [[0.1, 0.1], [0.5, 0.1], [0.5, 0.5]],
}


@pytest.mark.parametrize("malformed", MALFORMED)
def test_anything_but_an_outline_is_refused_in_words(malformed):
    with pytest.raises(InvalidInputError, match=r"footprint: .*expected"):
        Robot(COMMAND, footprint=MALFORMED[malformed])
