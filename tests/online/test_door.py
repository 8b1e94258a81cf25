"""Guidance takes a cart through a door that is little wider than the cart needs, from askew."""

import numpy as np
import pytest

from benchmarks.velocity_loops import Cart
from hcbf_gym.barriers import ConvexPolygon, HalfPlane
from hcbf_robots import VelocityFilter
from hcbf_robots.walkers import Walker

PERIOD, GOAL = 0.05, np.array([3.5, 0.0])


def wall_with_a_door(width, center):
    left, right = center + 0.5 * width, center - 0.5 * width
    return [
        ConvexPolygon("left", 1, ((2.0, left), (2.15, left), (2.15, 3.0), (2.0, 3.0))),
        ConvexPolygon("right", 1, ((2.0, -3.0), (2.15, -3.0), (2.15, right), (2.0, right))),
        HalfPlane("far left", 1, (0.0, -1.0), -2.5),
        HalfPlane("far right", 1, (0.0, 1.0), -2.5),
    ]


@pytest.mark.parametrize(
    ("width", "seed", "center"),
    [(0.79, 1, -0.25 / 7.0), (0.79, 2, -0.15 / 7.0), (0.79, 7, 0.05), (0.8, 0, -0.05)],
)
def test_a_cart_that_asks_for_nothing_is_led_through(width, seed, center):
    walker, rng = Walker.load("cart"), np.random.default_rng(seed)
    cart = Cart(walker)
    start = np.array([rng.uniform(-0.5, 0.8), rng.uniform(-1.5, 1.5)])
    cart.physics.reset(start, rng.uniform(-3.0, 3.0), rng)
    scene = wall_with_a_door(width, center)
    door = VelocityFilter(walker, scene, period=PERIOD, guidance="geodesic", goal=GOAL)
    ahead, least = walker.command.look_ahead, np.inf
    while cart.time < 30.0:
        pose, twist = cart.says()
        _, report = door.step((0.0, 0.0), pose, twist, cart.time)
        least = min(least, report["h"].min())
        end = cart.time + PERIOD
        while cart.time < end - 1e-9:
            cart.step(door.command_at(min(cart.time, end)))
        point = pose[:2] + ahead * np.array([np.cos(pose[2]), np.sin(pose[2])])
        if np.hypot(*(point - GOAL)) < 0.3:
            break
    assert cart.time < 30.0
    assert least > 0.0
