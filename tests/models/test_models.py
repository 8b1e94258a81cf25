"""Reduced-order models: their derivatives, their steps, and what they refuse."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hcbf_gym.barriers import Disc, SpeedLimit
from hcbf_gym.barriers.class_k import LinearClassK
from hcbf_gym.barriers.general import GeneralRows
from hcbf_gym.errors import HcbfError
from hcbf_gym.models import (
    ControlAffine,
    DoubleIntegrator,
    KinematicBicycle,
    SingleIntegrator,
    Unicycle,
)

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
