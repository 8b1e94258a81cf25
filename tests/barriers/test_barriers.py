"""Barriers, their derivatives, and the rows they make."""

import numpy as np
import pytest
import readable
from hypothesis import given, settings
from hypothesis import strategies as st

from hcbf_gym import HcbfError
from hcbf_gym.barriers import (
    Barrier,
    BarrierSet,
    BrakeClassK,
    Capsule,
    ConvexPolygon,
    Disc,
    Ellipse,
    GeneralRows,
    HalfPlane,
    LinearClassK,
    LogClassK,
    RowSettings,
    SpeedLimit,
)
from hcbf_gym.barriers.planar_rows import planar_rows
from hcbf_gym.models import DoubleIntegrator, KinematicBicycle, SingleIntegrator, Unicycle
from tests.worlds import with_others

BARRIERS: list[Barrier] = with_others(
    HalfPlane("wall", 1, normal=(0.6, 0.8), offset=-0.3),
    Disc("disc", 1, center=(0.5, -0.2), radius=0.7),
    Disc("moving disc", 2, center=(-1.0, 0.4), radius=0.5, velocity=(0.3, -0.7)),
    Ellipse("ellipse", 2, center=(0.1, 0.3), semi_axes=(1.5, 0.4), angle=0.7, velocity=(-0.2, 0.1)),
    ConvexPolygon("square", 3, vertices=((-1, -1), (1, -1), (1, 1), (-1, 1)), velocity=(0.1, 0.2)),
    Capsule("capsule", 2, start=(-0.5, -0.4), end=(0.7, 0.3), radius=0.3, velocity=(0.2, -0.1)),
)
BARRIERS.append(SpeedLimit("cap", 1, v_max=1.2, margin=0.1))
MODELS = (
    SingleIntegrator(),
    DoubleIntegrator(),
    DoubleIntegrator(drag=0.4),
    Unicycle(),
    KinematicBicycle(),
)
ALPHA1, ALPHA2 = LogClassK(), LinearClassK(2.0)

states = st.lists(st.floats(-3, 3), min_size=4, max_size=4).map(np.array)


@pytest.mark.parametrize("barrier", BARRIERS, ids=lambda b: b.name)
def test_jet_matches_finite_differences(barrier):
    rng, eps = np.random.default_rng(0), 1e-5
    for _ in range(50):
        x, t = rng.uniform(-3, 3, 4), rng.uniform(0, 2)
        jet = barrier.jet(x, t)
        steps = eps * np.eye(4)
        gradient = [(barrier.h(x + s, t) - barrier.h(x - s, t)) / (2 * eps) for s in steps]
        hessian = [
            (barrier.jet(x + s, t).gradient - barrier.jet(x - s, t).gradient) / (2 * eps)
            for s in steps
        ]
        ahead, behind = barrier.jet(x, t + eps), barrier.jet(x, t - eps)
        np.testing.assert_allclose(jet.gradient, gradient, atol=1e-6)
        np.testing.assert_allclose(jet.hessian, hessian, atol=1e-4)
        assert jet.rate == pytest.approx((ahead.h - behind.h) / (2 * eps), abs=1e-6)
        assert jet.rate_rate == pytest.approx((ahead.rate - behind.rate) / (2 * eps), abs=1e-4)
        np.testing.assert_allclose(
            jet.gradient_rate, (ahead.gradient - behind.gradient) / (2 * eps), atol=1e-4
        )


@pytest.mark.parametrize("shape", BARRIERS[:-1], ids=lambda b: b.name)
def test_a_compiled_shape_is_the_readable_one(shape):
    rng, eps = np.random.default_rng(0), 1e-9
    special = shape.outline() if isinstance(shape, ConvexPolygon) else [shape.anchor]
    special = () if isinstance(shape, Capsule) else special  # on its segment either side is right
    for q in (*rng.uniform(-3, 3, (300, 2)), *special):
        for got, expected in zip(shape.planar_jet(q), readable.jet(shape, q), strict=True):
            np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12)
        reach = rng.uniform(eps, 0.5)
        if shape.h(np.array([*q, 0.0, 0.0])) > eps:
            expected = readable.core(shape, q, reach)
            np.testing.assert_allclose(shape.core(q, reach), expected, rtol=1e-12)


@pytest.mark.parametrize("model", MODELS, ids=str)
def test_row_is_psi_dot_plus_alpha2_psi_along_the_models_flow(model):
    rng, eps = np.random.default_rng(1), 1e-6
    make = GeneralRows(model, ALPHA1, ALPHA2)
    barriers = tuple(b for b in BARRIERS if b.reads_position or model.velocity_at == 2)

    def psi(barrier, x, t):
        jet = barrier.jet(x, t)
        if make.reach(barrier).degree == 1:
            return jet.h - getattr(barrier, "margin", 0.0)
        return jet.gradient @ model.f(x) + jet.rate + ALPHA1(jet.h)

    for _ in range(30):
        x, t, u = rng.uniform(-2, 2, model.n), rng.uniform(0, 1), rng.uniform(-5, 5, 2)
        rows = make(barriers, x, t)
        x_dot = model.f(x) + model.g(x) @ u
        for k, barrier in enumerate(barriers):
            flow = (
                psi(barrier, x + eps * x_dot, t + eps) - psi(barrier, x - eps * x_dot, t - eps)
            ) / (2 * eps)
            expected = flow + ALPHA2(psi(barrier, x, t))
            assert rows.a[k] @ u - rows.b[k] == pytest.approx(expected, abs=2e-4, rel=1e-5)
            assert rows.alpha2_psi is not None
            assert rows.alpha2_psi[k] == pytest.approx(ALPHA2(psi(barrier, x, t)))


@given(states, st.floats(0, 5), st.floats(0, 0.1))
@settings(max_examples=200, deadline=None)
def test_compiled_rows_equal_the_readable_ones(x, t, margin):
    alphas, of_speed = (ALPHA1, ALPHA2), LinearClassK(3.0)
    make = GeneralRows(DoubleIntegrator(), *alphas, alpha_speed=of_speed)
    readable = make(BARRIERS, x, t, margin)
    settings = RowSettings(*alphas, alpha_speed=of_speed)
    barrier_set = BarrierSet([BARRIERS, BARRIERS])
    compiled = planar_rows(barrier_set, np.stack([x, x]), np.array([t, t]), settings, margin)
    for field, expected in zip(compiled, readable, strict=True):
        for i in range(2):
            np.testing.assert_allclose(field[i], expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        barrier_set.values(x[None].repeat(2, 0), np.full(2, t))[1], readable.h, atol=1e-12
    )


@given(states)
@settings(max_examples=100, deadline=None)
def test_what_a_policy_sees_is_h_its_unit_gradient_and_its_rate(x):
    h, sensed = BarrierSet([BARRIERS]).sense(x[None], np.array([0.5]))
    for k, barrier in enumerate(BARRIERS[:-1]):
        jet = barrier.jet(x, 0.5)
        unit = jet.gradient[:2] / np.linalg.norm(jet.gradient[:2])
        np.testing.assert_allclose(sensed[0, k], [jet.h, *unit, jet.rate], atol=1e-9)
        assert h[0, k] == pytest.approx(jet.h, abs=1e-12)


def test_a_region_has_a_gradient_even_at_its_centre():
    for barrier in (Disc("d", 1), Ellipse("e", 1)):
        assert np.linalg.norm(barrier.jet(np.zeros(4)).gradient) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Disc("d", 1, radius=-1.0),
        lambda: Disc("d", 0),
        lambda: Disc("", 1),
        lambda: Disc("d", 1.5),
        lambda: Disc("d", 1, center=(np.nan, 0.0)),
        lambda: Disc("d", 1, center=(0.0, 0.0, 0.0)),
        *(lambda s=s: HalfPlane("w", 1, normal=(s, s)) for s in (0.0, 1.0, 1.1, 1e200, 1e308)),
        lambda: Ellipse("e", 1, semi_axes=(1.0, 0.0)),
        lambda: ConvexPolygon("p", 1, vertices=((0, 0), (0, 1), (1, 0))),
        lambda: ConvexPolygon("p", 1, vertices=((0, 0), (1, 0))),
        lambda: SpeedLimit("s", 1, v_max=0.0),
        lambda: SpeedLimit("s", 1, v_max=1.0, margin=1.0),
        lambda: LinearClassK(-1.0),
        lambda: LogClassK(phi3=0.0),
        lambda: DoubleIntegrator(drag=-1.0),
    ],
)
def test_bad_barriers_are_refused_with_what_was_expected(make):
    with pytest.raises(HcbfError, match="expected"):
        make()


@given(st.floats(-50, 50), st.floats(1e-3, 5))
def test_class_k_increases_has_its_derivative_and_its_inverse(h, step):
    for alpha in (LogClassK(), LogClassK(0.3, 2.0, 0.7), LinearClassK(3.0), BrakeClassK(4.5, 0.1)):
        assert alpha(0.0) == 0.0
        assert alpha(h + step) > alpha(h)
        assert alpha.inverse(alpha(h)) == pytest.approx(h, rel=1e-9, abs=1e-9)
        slope = (alpha(h + 1e-6) - alpha(h - 1e-6)) / 2e-6
        assert alpha.derivative(h) == pytest.approx(slope, rel=1e-3)
        assert 0.0 < alpha.derivative(abs(h) + step) <= alpha.derivative(h) <= alpha.derivative(0.0)
        assert alpha.scaled(0.7)(h) == pytest.approx(0.7 * alpha(h))
        assert alpha.stretched(0.7)(h) == pytest.approx(alpha(0.7 * h))
