"""The guidance row where two ways round are alike."""

import numpy as np

from hcbf_gym import _core, guidance
from hcbf_gym.barriers import BarrierSet, Disc, HalfPlane

POCKET = [
    HalfPlane("left", 1, (0.0, -1.0), -2.37),
    HalfPlane("right", 1, (0.0, 1.0), -2.37),
    Disc("upper", 2, (-0.114, 0.646), 0.504),
    Disc("lower", 3, (0.06, -0.338), 0.725),
]
"""Two discs that overlap, and a robot in the corner between them."""


def field():
    way = guidance.Geodesic()
    way.reset(BarrierSet([POCKET]), (9.7, -0.35), start=(0.0, 0.0), clearance=0.054)
    return way


def led(way, x, out):
    _core.guidance_rows(way.field, way.geometry, way.goal, x[None], way.pull, out)
    return out[0, :2].copy()


def test_on_the_ridge_between_two_ways_a_robot_stays_on_the_side_that_it_was_led_to():
    way, ridges = field(), 0
    for x in np.linspace(-1.2, -0.5, 36):
        places = [np.array([x, y, 0.0, 0.0]) for y in np.arange(0.0, 0.5, 0.004)]
        rows = [led(way, place, np.zeros((1, 3))) for place in places]
        for k in range(1, len(rows)):
            if rows[k] @ rows[k - 1] >= 0.0:
                continue
            ridges += 1  # a hair decides
            for first in (k - 1, k):
                out = np.zeros((1, 3))
                begun = led(way, places[first], out)
                for step in range(6):
                    assert led(way, places[k - step % 2], out) @ begun > 0.0
    assert ridges > 10


def test_elsewhere_what_came_before_makes_no_difference():
    way, rng = field(), np.random.default_rng(4)
    places = np.column_stack([rng.uniform(-2.0, 9.0, 400), rng.uniform(-2.0, 2.0, 400)])
    turned = 0
    for place in places:
        x = np.concatenate([place, np.zeros(2)])
        fresh = led(way, x, np.zeros((1, 3)))
        angle = rng.uniform(-1.5, 1.5)  # a row before that points less than a quarter turn away
        cos, sin = np.cos(angle), np.sin(angle)
        last = np.array([[cos * fresh[0] - sin * fresh[1], sin * fresh[0] + cos * fresh[1], 0.0]])
        np.testing.assert_array_equal(led(way, x, last), fresh)
        turned += abs(angle) > 1.0
    assert turned > 50
