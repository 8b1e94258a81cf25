"""Reduced-order models: their derivatives, their steps, and what they refuse."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from hcbf_gym import HcbfError, _core
from hcbf_gym.barriers import Disc, GeneralRows, LinearClassK, SpeedLimit
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models import (
    Axle,
    ControlAffine,
    DoubleIntegrator,
    KinematicBicycle,
    SingleIntegrator,
    Unicycle,
    clocks,
)
from hcbf_gym.models.clocks import AHEAD

PENDULUM = ControlAffine(
    f=lambda x: np.array([x[1], 15.0 * np.sin(x[0])]),
    g=lambda x: np.array([[0.0], [3.0]]),
    n=2,
    n_u=1,
)
MODELS = (
    SingleIntegrator(),
    SingleIntegrator(n_u=6),
    DoubleIntegrator(),
    DoubleIntegrator(n_u=3, drag=0.3),
    Unicycle(),
    KinematicBicycle(),
    PENDULUM,
)
NAMES = [*map(str, MODELS[:-1]), "pendulum"]
LINEAR = LinearClassK(2.0)


@pytest.mark.parametrize("model", MODELS, ids=NAMES)
def test_shapes_and_jacobian_of_the_drift(model):
    rng = np.random.default_rng(0)
    for x in rng.normal(size=(10, model.n)):
        assert model.f(x).shape == (model.n,)
        assert model.g(x).shape == (model.n, model.n_u)
        steps = 1e-6 * np.eye(model.n)
        expected = np.array([(model.f(x + s) - model.f(x - s)) / 2e-6 for s in steps]).T
        np.testing.assert_allclose(model.f_jacobian(x), expected, atol=1e-8)


@pytest.mark.parametrize("model", MODELS, ids=NAMES)
def test_step_follows_the_flow(model):
    rng = np.random.default_rng(1)
    x, u = rng.normal(size=model.n), rng.normal(size=model.n_u)
    solution = solve_ivp(
        lambda _, y: model.f(y) + model.g(y) @ u, (0.0, 0.02), x, rtol=1e-11, atol=1e-12
    )
    np.testing.assert_allclose(model.step(x, u, 0.02), solution.y[:, -1], atol=1e-8)


def test_a_bicycle_turns_by_its_slip_and_a_unicycle_drives_where_it_looks():
    x = KinematicBicycle(rear=2.0).step(np.array([0.0, 0.0, 0.0, 4.0]), np.array([0.0, 0.1]), 0.01)
    assert x[2] == pytest.approx(0.01 * 4.0 / 2.0 * 0.1)
    x = Unicycle().step(np.array([0.0, 0.0, np.pi / 2]), np.array([1.0, 0.0]), 0.5)
    np.testing.assert_allclose(x, [0.0, 0.5, np.pi / 2], atol=1e-12)


def test_drag_slows_a_coasting_point():
    x = np.array([0.0, 0.0, 1.0, 0.0])
    for _ in range(100):
        x = DoubleIntegrator(drag=0.5).step(x, np.zeros(2), 0.01)
    assert x[2] == pytest.approx(np.exp(-0.5))


def test_where_no_input_reaches_a_row_it_is_constant():
    """A unicycle that passes a disc sideways can neither help nor harm at this instant."""
    make = GeneralRows(Unicycle(), LINEAR, LINEAR)
    rows = make([Disc("d", 1, center=(0.0, 2.0))], np.array([0.0, 0.0, 0.0]))
    np.testing.assert_array_equal(rows.a, 0.0)
    assert rows.b[0] == pytest.approx(-2.0 * rows.h[0])


def test_a_row_of_degree_1_leaves_inputs_of_degree_2_free():
    x, disc = np.array([0.0, 0.0, 0.3]), [Disc("d", 1, center=(2.0, 0.0))]
    row = GeneralRows(Unicycle(), LINEAR, LINEAR)(disc, x)
    assert row.a[0, 0] < -0.5
    assert row.a[0, 1] == 0.0


def test_margins_come_as_one_number_for_strict_positions_or_one_for_each_row():
    barriers = (Disc("a", 1), Disc("b", 2), SpeedLimit("s", 1, v_max=2.0, margin=0.1))
    make, x = GeneralRows(DoubleIntegrator(), LINEAR, LINEAR), np.array([2.0, 0.5, 0.3, -0.1])
    bare, one = make(barriers, x), make(barriers, x, margin=0.05)
    np.testing.assert_allclose(one.b - bare.b, [4.0 * 0.05, 0.0, 0.0], atol=1e-12)
    each = make(barriers, x, margin=[0.05, 0.0, 0.1], margin_rate=[0.2, 0.0, 0.0])
    np.testing.assert_allclose(each.b - one.b, [4.0 * 0.2, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    "make",
    [
        lambda: SingleIntegrator(0),
        lambda: DoubleIntegrator(2.5),
        lambda: DoubleIntegrator(drag=-0.1),
        lambda: KinematicBicycle(rear=0.0),
        lambda: ControlAffine(lambda x: x[:1], lambda x: np.ones((2, 1)), n=2, n_u=1),
        lambda: ControlAffine(lambda x: x, lambda x: np.ones(2), n=2, n_u=1),
        lambda: GeneralRows(Unicycle(), LINEAR, LINEAR)([SpeedLimit("s", 1)], np.zeros(3)),
    ],
)
def test_bad_models_are_refused_with_what_was_expected(make):
    with pytest.raises(HcbfError, match="expected"):
        make()


def test_a_barrier_that_no_input_reaches_is_refused():
    idle = ControlAffine(lambda x: 0.0 * x, lambda x: np.array([[0.0], [0.0], [1.0]]), n=3, n_u=1)
    with pytest.raises(HcbfError, match="no input"):
        GeneralRows(idle, LINEAR, LINEAR)([Disc("d", 1)], np.zeros(3))


@pytest.mark.parametrize("oldest", [0.0, 0.1, 60.0, math.inf])
def test_an_age_is_accepted_from_a_tenth_ahead_to_the_oldest_and_else_named(oldest):
    ages = np.array([-10.0, -1.01 * AHEAD, -AHEAD, 0.0, oldest, 1.01 * oldest + 1e-3])
    ages = np.append(ages, [math.nan, math.inf, -math.inf])
    accepted = clocks.is_accepted(ages, oldest)
    for age, here in zip(ages.tolist(), accepted.tolist(), strict=True):
        assert here == bool(clocks.is_accepted(age, oldest))
        assert here == (math.isfinite(age) and -AHEAD <= age <= oldest)
        if not here and math.isfinite(age):
            assert ("ahead" if age < 0.0 else "old") in clocks.refusal(age, oldest)


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
