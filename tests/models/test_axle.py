"""A differential drive: what an input does to its axle, and what U leaves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hcbf_gym import _core
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.axle import Axle

CART = Axle(look_ahead=0.25, forward=1.2, turn=2.5, braking=1.5)
headings = st.floats(-3.2, 3.2)
shares = st.floats(-1.0, 1.0)


def point_state(cart, place, heading, v, turning):
    """Return x (4,) of the point before an axle."""
    e = np.array([np.cos(heading), np.sin(heading)])
    across = np.array([-e[1], e[0]])
    position = np.asarray(place) + cart.look_ahead * e
    return np.concatenate([position, v * e + cart.look_ahead * turning * across])


@given(headings, shares, shares)
def test_the_axle_is_found_from_its_point(heading, v, turning):
    x = point_state(CART, (0.3, -0.2), heading, 1.2 * v, 2.5 * turning)
    found = np.empty(4)
    _core.axle_place(CART, x, heading, found)
    e = np.array([np.cos(heading), np.sin(heading)])
    np.testing.assert_allclose(found, [0.3, -0.2, *(1.2 * v * e)], atol=1e-12)
    np.testing.assert_allclose(
        _core.axle_speeds(CART, x, heading), (1.2 * v, 2.5 * turning), atol=1e-9
    )


@given(headings, shares, shares, st.integers(0, 3), st.sampled_from([0.02, 0.05, 0.1]))
def test_every_corner_of_u_retains_the_limits(heading, v, turning, corner, period):
    v, turning = 1.2 * v, 2.5 * turning
    x = point_state(CART, (0.0, 0.0), heading, v, turning)
    u = np.empty((4, 2))
    _core.axle_corners(CART, x, heading, period, u)
    e = np.array([np.cos(heading), np.sin(heading)])
    along, across = u[corner] @ e, u[corner] @ np.array([-e[1], e[0]])
    assert max(abs(along), abs(across)) <= CART.braking + 1e-9
    assert abs(v + period * along) <= CART.forward + 1e-9
    assert abs(turning + period * across / CART.look_ahead) <= CART.turn + 1e-9


@given(headings, st.floats(-3.0, 3.0), st.floats(-8.0, 8.0))
def test_u_is_a_rectangle_that_turns_with_the_heading_even_beyond_the_limits(heading, v, turning):
    x = point_state(CART, (0.0, 0.0), heading, v, turning)
    u = np.empty((4, 2))
    _core.axle_corners(CART, x, heading, 0.05, u)
    sides = np.roll(u, -1, axis=0) - u
    turns = sides[:, 0] * np.roll(sides, -1, axis=0)[:, 1]
    turns -= sides[:, 1] * np.roll(sides, -1, axis=0)[:, 0]
    assert (turns > 0.0).all()  # counter-clockwise, and nowhere flat


@pytest.mark.parametrize("name", Axle._fields)
@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, "fast"])
def test_a_number_that_is_none_is_refused(name, bad):
    with pytest.raises(InvalidInputError, match=f"axle: {name}"):
        CART._replace(**{name: bad}).checked()
