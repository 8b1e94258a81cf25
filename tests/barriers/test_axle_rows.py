"""Rows of a differential drive, against the exact motion of its axle and of the point before it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hcbf_gym import _core
from hcbf_gym.barriers import LinearClassK, LogClassK, RowSettings, axle_rows
from hcbf_gym.models import Axle

CARTS = (
    Axle(look_ahead=0.25, forward=1.2, turn=2.5, braking=1.5),
    Axle(look_ahead=0.1, forward=0.22, turn=2.84, braking=1.0),
)
PERIODS = 0.02, 0.05, 0.1
numbers = st.floats(-1.0, 1.0)
angles = st.floats(-3.2, 3.2)
cases = st.tuples(st.sampled_from(CARTS), st.sampled_from(PERIODS), angles, angles)
states = st.tuples(numbers, numbers, st.floats(0.0, 1.0), st.floats(0.0, 1.0))


def vectors(angle):
    e = np.array([np.cos(angle), np.sin(angle)])
    return e, np.array([-e[1], e[0]])


def drawn(case, state):
    """Return a cart, T, its heading, v, ω, the state of its point, an input of U, and a normal."""
    (cart, period, heading, side), (v, turning, one, other) = case, state
    v, turning = cart.forward * v, cart.turn * turning
    e, across = vectors(heading)
    x = np.concatenate([cart.look_ahead * e, v * e + cart.look_ahead * turning * across])
    u = np.empty((4, 2))
    _core.axle_corners(cart, x, heading, period, u)
    inside = u[0] + one * (u[1] - u[0]) + other * (u[3] - u[0])
    return cart, period, heading, v, turning, x, inside, vectors(side)[0]


@given(cases, states)
def test_a_row_on_the_axle_knows_its_mean_acceleration(case, state):
    cart, period, heading, v, turning, x, u, n = drawn(case, state)
    e, across = vectors(heading)
    later_v, later_turning = v + period * u @ e, turning + period / cart.look_ahead * (u @ across)
    mean = (later_v * vectors(heading + period * later_turning)[0] - v * e) / period
    a_x, a_y, b = _core.axle_row(cart, x, heading, period, *n, 0.0)
    assert abs(n @ mean - (np.array([a_x, a_y]) @ u - b)) <= cart.jerk(period) + 1e-9


@given(cases, states)
def test_the_axle_strays_no_farther_than_is_reserved(case, state):
    cart, period, heading, v, turning, _, u, _ = drawn(case, state)
    e, across = vectors(heading)
    a, rate = u @ e, turning + period / cart.look_ahead * (u @ across)
    times = np.linspace(0.0, period, 401)
    way = (v + a * times)[:, None] * np.array([vectors(heading + rate * t)[0] for t in times])
    moved = np.trapezoid(way, times, axis=0)
    mean = (way[-1] - v * e) / period
    straight = v * e * period + 0.5 * mean * period**2
    assert np.linalg.norm(moved - straight) <= cart.strays(period) + 1e-6 * period


@given(cases, states)
def test_a_row_on_the_point_knows_its_mean_acceleration(case, state):
    cart, period, heading, v, turning, x, u, n = drawn(case, state)
    e, across = vectors(heading)
    later_v, later_turning = v + period * u @ e, turning + period / cart.look_ahead * (u @ across)
    later, later_across = vectors(heading + period * later_turning)
    velocity = later_v * later + cart.look_ahead * later_turning * later_across
    mean = (velocity - x[2:]) / period
    a_x, a_y, b = _core.axle_point_row(cart, x, heading, period, *n, 0.0)
    change = abs(later_turning - turning)
    missed = change * cart.braking * period * 1.5
    missed += 0.5 * change**2 * period * (np.hypot(*x[2:]) + 2.0 * cart.braking * period)
    assert abs(n @ mean - (np.array([a_x, a_y]) @ u - b)) <= missed + 1e-9


def fitted(cart, period, alpha1):
    """Return the settings of held rows that braking along the heading meets."""
    settings = RowSettings(alpha1, LinearClassK(2.0), period, cart.hardest)
    return RowSettings(
        alpha1.stretched(axle_rows.share(settings, cart)), settings.alpha2, period, cart.hardest
    )


@pytest.mark.parametrize("alpha1", [LogClassK(), LinearClassK(2.0)], ids=["log", "linear"])
@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize("cart", CARTS)
def test_one_braking_input_meets_the_rows_of_all_walls_at_once(cart, period, alpha1):
    settings = fitted(cart, period, alpha1)
    reserved = axle_rows.wall_clearance(settings, cart.jerk(period))
    steep = settings.alpha1.derivative(0.0)
    rng, bound = np.random.default_rng(3), 0
    for _ in range(2000):
        v = cart.forward * rng.uniform(-1.0, 1.0)
        for angle in rng.uniform(-np.pi, np.pi, 4):  # walls around it, left and neared alike
            rate = v * np.cos(angle)
            kept = reserved + rng.choice([0.0, 1.0]) * rng.exponential(0.3)
            kept = max(kept, reserved + settings.alpha1.inverse(max(0.0, -rate)))
            b = _core.held_row(kept, rate, cart.jerk(period), abs(v), 0.0, np.inf, settings.packed)[
                0
            ]
            braking = -np.sign(v) * min(steep * abs(v), cart.braking)
            bound += b > -cart.braking
            assert braking * np.cos(angle) >= b - 1e-9, (v, angle, kept, b)
    assert bound > 500
