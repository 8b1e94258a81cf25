"""A user's own h by automatic differentiation: against jets, and where it must speak up."""

import sys

import numpy as np
import pytest
from needs import remedy

from hcbf_gym import HcbfError
from hcbf_gym.barriers import (
    BrakeClassK,
    Disc,
    Function,
    GeneralRows,
    HalfPlane,
    LinearClassK,
    LogClassK,
    SpeedLimit,
)
from hcbf_gym.errors import InvalidInputError, MissingDependencyError, SafetyWarning
from hcbf_gym.models import (
    ControlAffine,
    DoubleIntegrator,
    KinematicBicycle,
    SingleIntegrator,
    Unicycle,
)

jax = pytest.importorskip("jax", reason=remedy("jax"))
jnp = jax.numpy

from hcbf_gym.barriers.function import maximum, minimum  # noqa: E402
from hcbf_gym.barriers.function_rows import RowsKernel  # noqa: E402

ALPHA1, ALPHA2 = LogClassK(), LinearClassK(2.0)
SHAPES = (
    HalfPlane("wall", 1, normal=(0.6, 0.8), offset=-0.3),
    Disc("moving disc", 2, center=(-1.0, 0.4), radius=0.5, velocity=(0.3, -0.7)),
    SpeedLimit("cap", 1, v_max=1.2, margin=0.1),
)
AS_FUNCTIONS = {
    "wall": lambda x, t: 0.6 * x[0] + 0.8 * x[1] + 0.3,
    "moving disc": lambda x, t: jnp.hypot(x[0] + 1.0 - 0.3 * t, x[1] - 0.4 + 0.7 * t) - 0.5,
    "cap": lambda x, t: (1.2**2 - x[2] ** 2 - x[3] ** 2) / 2.4,
}
LINEAR_F = ControlAffine(
    f=lambda x: jnp.stack([x[2], x[3], -x[0] * x[1], 0.0 * x[0]]),
    g=lambda x: jnp.stack([0 * x[:2], 0 * x[:2], jnp.stack([1 + x[1] ** 2, x[0]]), x[:2] + 3.0]),
    n=4,
    n_u=2,
    velocity_at=2,
)
MODELS = (
    SingleIntegrator(),
    DoubleIntegrator(drag=0.4),
    Unicycle(),
    KinematicBicycle(),
    LINEAR_F,
)


def functions_of(shapes):
    return tuple(Function(b.name, b.priority, AS_FUNCTIONS[b.name]) for b in shapes)


@pytest.mark.parametrize("alpha1", [ALPHA1, BrakeClassK(4.0, 0.1)], ids=["log", "brake"])
@pytest.mark.parametrize("model", MODELS, ids=lambda m: type(m).__name__)
def test_rows_equal_those_of_the_analytic_jets_one_state_and_many(model, alpha1):
    shapes = tuple(b for b in SHAPES if b.reads_position or model.velocity_at == 2)
    functions = functions_of(shapes)
    make = GeneralRows(model, alpha1, ALPHA2)
    rng = np.random.default_rng(0)
    x, t = rng.uniform(-2, 2, (50, model.n)), rng.uniform(0, 1, 50)
    margin, rate = rng.uniform(0, 0.1, len(shapes)), rng.uniform(-0.1, 0.1, len(shapes))
    batch = make(functions, x, t, margin, rate)
    for i in range(len(x)):
        analytic = make(shapes, x[i], t[i], margin, rate)
        mixed = make((*functions[:2], *shapes[2:]), x[i], t[i], margin, rate)
        one = make(functions, x[i], t[i], margin, rate)
        for expected, *others in zip(analytic, one, mixed, batch, strict=True):
            np.testing.assert_allclose(others[0], expected, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(others[1], expected, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(others[2][i], expected, rtol=1e-9, atol=1e-9)


def test_a_functions_jet_is_its_shapes():
    x, t = np.array([0.7, -1.6, 0.4, 0.3]), 0.3
    for shape, function in zip(SHAPES, functions_of(SHAPES), strict=True):
        many = function.batch(np.tile(x, (3, 1)), np.full(3, t))
        for got, of_many, expected in zip(function.jet(x, t), many, shape.jet(x, t), strict=True):
            np.testing.assert_allclose(got, expected, atol=1e-9)
            np.testing.assert_allclose(of_many, 3 * [expected], atol=1e-9)


def chain(n):
    """Return n integrators in a row."""
    return ControlAffine(
        f=lambda x: jnp.concatenate([x[1:], 0.0 * x[:1]]), g=lambda x: jnp.eye(n, 1, k=1 - n),
        n=n, n_u=1,
    )  # fmt: skip


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_the_row_of_relative_degree_r_holds_h_along_the_flow(degree):
    """h = 1 − x₁ of r integrators: with the row active h decays by the class-K chain."""
    model = chain(degree)
    make = GeneralRows(model, LinearClassK(2.0), LinearClassK(2.0))
    wall = Function("wall", 1, lambda x, t: 1.0 - x[0])
    assert make.reach(wall).degree == degree
    x, least = np.zeros(model.n), np.inf
    for _ in range(1500):
        rows = make([wall], x)
        u = rows.b / rows.a[:, 0]  # the hardest push that the row allows
        x = model.step(x, u, 0.005)
        least = min(least, 1.0 - x[0])
    assert least > 0.0
    assert least < 1e-3


def test_rows_of_degree_3_match_the_formula():
    model, gain = chain(3), 1.5
    make = GeneralRows(model, LinearClassK(gain), LinearClassK(gain))
    wall = Function("wall", 1, lambda x, t: jnp.sin(t) - x[0])
    x, t = np.array([0.2, -0.3, 0.7]), 0.4
    rows = make([wall], x, t)
    h = np.sin(t) - x[0], np.cos(t) - x[1], -np.sin(t) - x[2], -np.cos(t)  # h and its rates
    psi = h[2] + 2 * gain * h[1] + gain**2 * h[0]
    drift = h[3] + 2 * gain * h[2] + gain**2 * h[1]
    np.testing.assert_allclose(rows.a, [[-1.0]], atol=1e-12)
    np.testing.assert_allclose(rows.b, [-gain * psi - drift], atol=1e-12)


def test_64_bit_inside_and_the_users_precision_untouched():
    before = jnp.asarray(1.0).dtype
    function = Function("f", 1, lambda x, t: x[0] - 1.0 / 3.0)
    assert function.h(np.array([1.0])) == 1.0 - 1.0 / 3.0
    make = GeneralRows(SingleIntegrator(), ALPHA1, ALPHA2)
    assert make([function], np.zeros(2)).b.dtype == np.float64
    assert jnp.asarray(1.0).dtype == before


def test_a_function_that_no_input_reaches_is_refused():
    with pytest.raises(InvalidInputError, match="no input"):
        RowsKernel(SingleIntegrator(), [Function("clock", 1, lambda x, t: 1.0 - t)], ALPHA1, ALPHA2)


def test_a_degree_that_falls_at_some_state_is_refused_there():
    """Below x₁ = 20 the function reads the position alone, above it the velocity, too."""
    h = Function("h", 1, lambda x, t: x[0] + jnp.where(x[0] > 20.0, x[2] * (x[0] - 20.0), 0.0))
    make = GeneralRows(DoubleIntegrator(), ALPHA1, ALPHA2)
    make([h], np.zeros(4))
    with pytest.raises(InvalidInputError, match="below the relative degree"):
        make([h], np.array([25.0, 0.0, 1.0, 0.0]))


def test_vanishing_gradients_and_kinks_are_reported_and_missing_ones_are_those_beside():
    parts = (lambda x, t, c=c: jnp.hypot(x[0] - c, x[1]) - 0.5 for c in (1.0, -1.0))
    model, make = SingleIntegrator(), GeneralRows(SingleIntegrator(), ALPHA1, ALPHA2)
    kink = Function("nearest", 1, minimum(*parts))
    flat = Function("flat", 1, lambda x, t: x[0] ** 2 + x[1] ** 2 - 1.0)
    sharp = Function("sharp", 1, lambda x, t: jnp.sqrt(x[0] ** 2 + x[1] ** 2) - 1.0)
    with pytest.warns(SafetyWarning, match="sharp: h is finite and its gradient is not"):
        rows = make((kink, flat, sharp), np.zeros(model.n))
    assert make.conditioning[0] < 0.5
    assert make.conditioning[1] == 0.0
    np.testing.assert_array_equal(rows.a[1], 0.0)
    assert rows.b[1] > 0.0  # inside, and no input helps: the status is VIOLATED
    np.testing.assert_allclose(rows.a[2], (1.0, 0.0), atol=1e-9)  # beside, along the first axis
    assert np.isfinite(rows.b[2])
    assert rows.h[2] == -1.0
    make((kink, flat, sharp), np.array([0.4, 0.3]))
    assert (make.conditioning > 0.2).all()


def test_a_value_that_is_not_finite_is_refused():
    h = Function("log", 1, lambda x, t: jnp.log(x[0]))
    with pytest.raises(InvalidInputError, match="expected finite h"):
        GeneralRows(SingleIntegrator(), ALPHA1, ALPHA2)([h], np.array([-1.0, 0.0]))


def test_minimum_and_maximum_are_those_of_the_values():
    parts = [
        Function("a", 1, lambda x, t: jnp.hypot(x[0] - 1.0, x[1]) - 1.0),
        lambda x, t: x[0],
        lambda x, t: x[1] + t,
    ]
    x, t = np.array([0.3, 0.8]), 0.1
    values = np.array([np.hypot(0.7, 0.8) - 1.0, 0.3, 0.9])

    def value(h):
        return Function("h", 1, h).h(x, t)

    assert value(minimum(*parts)) == pytest.approx(values.min())
    assert value(maximum(*parts)) == pytest.approx(values.max())


@pytest.mark.parametrize(
    "h",
    [
        lambda x, t: np.sin(x[0]),
        lambda x, t: x[0] if x[1] > 0 else x[1],
        lambda x, t: x,
        "x[0]",
    ],
)
def test_other_things_than_functions_of_jax_are_refused(h):
    with pytest.raises(HcbfError, match="expected"):
        Function("h", 1, h).h(np.zeros(2))


def test_a_model_in_numpy_is_refused_under_a_function_of_degree_2():
    model = ControlAffine(
        lambda x: np.array([x[1], np.sin(x[0])]), lambda x: np.array([[0.0], [1.0]]), n=2, n_u=1
    )
    with pytest.raises(InvalidInputError, match=r"expected jax\.numpy"):
        RowsKernel(model, [Function("h", 1, lambda x, t: x[0])], ALPHA1, ALPHA2)


def test_a_missing_jax_is_named_before_work_starts(monkeypatch):
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(MissingDependencyError, match=r"CHECKOUT\[jax\]"):
        Function("h", 1, lambda x, t: x[0])
