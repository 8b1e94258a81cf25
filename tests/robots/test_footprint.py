"""Footprints as Nav2 writes them: the circle that holds them, and what is no outline."""

import math

import numpy as np
import pytest

from hcbf_gym.errors import InvalidInputError
from hcbf_robots import Command, Robot
from hcbf_robots.walkers import footprint

COMMAND = Command(forward=0.5, turn=1.0, look_ahead=0.2)
L_SHAPE = [[-0.2, -0.2], [0.4, -0.2], [0.4, 0.0], [0.1, 0.0], [0.1, 0.3], [-0.2, 0.3]]


def test_nav2s_text_and_a_list_say_the_same():
    text = "[ [0.21, .195], [0.21, -0.195], [-0.21, -0.195], [-0.21, 0.195] ]"
    expected = math.hypot(0.21, 0.195)
    assert footprint.reach(text) == pytest.approx(expected)
    corners = footprint.corners(text)
    assert footprint.reach(corners[::-1]) == pytest.approx(expected)
    assert footprint.reach([*corners, corners[0]]) == pytest.approx(expected)  # closed
    assert Robot(COMMAND, footprint=text).reach == pytest.approx(expected)
    assert Robot(COMMAND, reach=0.5, footprint=text).reach == 0.5


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


def test_a_concave_outline_is_one():
    assert footprint.reach(L_SHAPE) == pytest.approx(math.hypot(0.4, 0.2))


BENT = {
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
    "self-crossing": [[-0.2, -0.2], [0.2, 0.2], [0.2, -0.2], [-0.2, 0.2]],
    "a spike": [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [1.0, 2.0], [1.0, 1.0], [-1.0, 1.0]],
    "the axle outside": [[0.1, 0.1], [0.5, 0.1], [0.5, 0.5]],
    "the axle in the bay": [[-0.2, -0.3], [0.4, -0.3], [0.4, -0.1], [-0.1, -0.1], [-0.1, 0.4]],
}


@pytest.mark.parametrize("bent", BENT)
def test_what_is_no_outline_is_refused_in_words(bent):
    with pytest.raises(InvalidInputError, match=r"footprint: .*expected"):
        Robot(COMMAND, footprint=BENT[bent])


def test_footprints_whose_order_is_shuffled_are_refused_or_outlines():
    rng = np.random.default_rng(1)
    refused = 0
    for _ in range(100):
        angles = np.linspace(0.0, math.tau, 9)[:-1]
        points = 0.5 * np.column_stack([np.cos(angles), np.sin(angles)])
        order = rng.permutation(8)
        steps = np.diff(order, append=order[0]) % 8
        in_order = len(set(steps.tolist())) == 1 and steps[0] in (1, 7)
        try:
            footprint.reach(points[order])
            assert in_order
        except InvalidInputError:
            refused += 1
    assert refused > 90
