"""Rows for a held input: what they promise between two samples, of every shape."""

from dataclasses import replace

import numpy as np
import pytest
import readable
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks import random_conflicts as conflicts
from benchmarks.random_conflicts import Scenes
from hcbf_gym import _core
from hcbf_gym.barriers import (
    BarrierSet,
    BrakeClassK,
    Capsule,
    ConvexPolygon,
    Disc,
    Ellipse,
    HalfPlane,
    LinearClassK,
    LogClassK,
    RowSettings,
    SpeedLimit,
    rows,
    shapes,
)
from hcbf_gym.barriers.braking import check_limits
from hcbf_gym.barriers.planar_rows import planar_rows
from hcbf_gym.errors import InvalidInputError

U_MAX = 5.0 * np.sqrt(2.0)
ALPHAS = (LogClassK(), LinearClassK(3.0), LogClassK(2.0, 1.0, 0.4), BrakeClassK(0.5, 0.1))
CLASSES = {cls.kind: cls for cls in shapes.SHAPES}
SHAPES = (*CLASSES, "sharp polygon")


def shape(kind, rng, moving=True):
    velocity = tuple(rng.uniform(-0.5, 0.5, 2)) if moving else (0.0, 0.0)
    angle = rng.uniform(0.0, 2.0 * np.pi)
    if kind == "half-plane":
        return HalfPlane(kind, 1, (np.cos(angle), np.sin(angle)), rng.uniform(-1.0, 1.0))
    if kind == "disc":
        return Disc(kind, 1, (0.0, 0.0), 10.0 ** rng.uniform(-3.0, 0.5), velocity)
    if kind == "ellipse":
        return Ellipse(kind, 1, (0.0, 0.0), tuple(rng.uniform(0.05, 2.0, 2)), angle, velocity)
    if kind == "capsule":
        end = rng.uniform(0.05, 2.0) * np.array([np.cos(angle), np.sin(angle)])
        return Capsule(kind, 1, (0.0, 0.0), tuple(end), 10.0 ** rng.uniform(-3.0, 0.5), velocity)
    if kind not in ("convex-polygon", "sharp polygon"):
        size = rng.uniform(0.05, 1.5)
        return replace(CLASSES[kind](kind, 1).resized(size), velocity=velocity)
    corners = 3 if kind == "sharp polygon" else int(rng.integers(3, 9))
    turn = angle + 2.0 * np.pi * np.arange(corners) / corners
    squeeze = np.array([1.0, 0.15 if kind == "sharp polygon" else rng.uniform(0.3, 1.0)])
    vertices = rng.uniform(0.05, 1.5) * squeeze * np.column_stack([np.cos(turn), np.sin(turn)])
    return ConvexPolygon(kind, 1, tuple(map(tuple, vertices)), velocity)


def states_near(barriers, rng, n):
    """Return states (n, 4), most of them within centimetres of the barriers' edges."""
    border = rng.normal(0.0, 2.0, (n, 2))
    zeros = np.zeros(n)
    for _ in range(60):  # walk down (or up) the gradient to the edge
        x = np.column_stack([border, np.zeros((n, 2))])
        h, sensed = barriers.sense(x, zeros)
        border -= 0.7 * h * sensed[:, 0, 1:3]
    off = 10.0 ** rng.uniform(-5.0, 0.0, (n, 1))
    x = np.column_stack([border + off * sensed[:, 0, 1:3], rng.normal(0.0, 1.0, (n, 2))])
    x[:, 2:] *= 10.0 ** rng.uniform(-3.0, 0.3, (n, 1))
    return x


def inputs_on_the_row(a, b, rng):
    """Yield inputs within ‖u‖ ≤ U_MAX that just meet the row, with any sideways part, or exceed it.

    Yields:
        u (n, 2) and whether such an input exists (n,).
    """
    norm = np.maximum(np.linalg.norm(a, axis=1), 1e-12)
    unit = a / norm[:, None]
    across = np.stack((-unit[:, 1], unit[:, 0]), axis=1)
    lowest = b / norm
    for share in (-1.0, -0.4, 0.0, 0.4, 1.0):
        for surplus in (0.0, 1.0):
            level = np.maximum(lowest, -U_MAX) + surplus * rng.uniform(0.0, 5.0, len(b))
            room = np.sqrt(np.maximum(0.0, U_MAX**2 - level**2))
            yield level[:, None] * unit + share * room[:, None] * across, np.abs(level) <= U_MAX


def least_and_after(barriers, x, t, u, how):
    """Return the least h while u is held, finely sampled, and ψ at the end."""
    least, end = barriers.values(x, t), x.copy()
    conflicts.advance(barriers, end, t, u, how.period, 100, least)
    return least[:, 0], end, psi(barriers, end, t + how.period, how)


def psi(barriers, x, t, how, margin=0.0, rate=0.0):
    rows = planar_rows(barriers, x, t, how, np.full(barriers.kind.shape, margin), rate)
    return rows.alpha2_psi[:, 0] / how.alpha2.gain


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), period=st.sampled_from([0.002, 0.02, 0.1]))
@pytest.mark.parametrize("alpha1", ALPHAS, ids=str)
@pytest.mark.parametrize("kind", SHAPES)
def test_an_input_that_meets_the_row_keeps_psi_and_h_until_the_next_sample(
    kind, alpha1, seed, period
):
    rng = np.random.default_rng(seed)
    n, gain = 100, rng.uniform(0.02, 1.0) / period
    how = RowSettings(alpha1, LinearClassK(gain), period, U_MAX)
    barriers = BarrierSet([(shape(kind, rng),)] * n)
    x, t = states_near(barriers, rng, n), np.zeros(n)
    start, rows = psi(barriers, x, t, how), planar_rows(barriers, x, t, how)
    rounding = max(0.0, 0.5 * U_MAX * period**2)  # kept in addition around corners, at most
    looked_at = 0
    for u, exists in inputs_on_the_row(rows.a[:, 0], rows.b[:, 0], rng):
        least, _, after = least_and_after(barriers, x, t, u, how)
        promised = exists & (start >= 0.0) & (rows.h[:, 0] >= rounding)
        looked_at += promised.sum()
        assert (least[promised] >= -1e-14).all()
        assert (after[promised] >= (1.0 - gain * period) * start[promised] - 1e-11).all()
    assert looked_at >= 50


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6))
@pytest.mark.parametrize("kind", SHAPES)
def test_a_margin_that_grows_is_kept_with_its_rate(kind, seed):
    rng = np.random.default_rng(seed)
    n, how = 100, RowSettings(period=0.02, u_max=U_MAX)
    barriers = BarrierSet([(shape(kind, rng),)] * n)
    x, t = states_near(barriers, rng, n), np.zeros(n)
    margin, rate = rng.uniform(0.0, 0.1), rng.uniform(-0.3, 0.3)
    rows = planar_rows(barriers, x, t, how, np.full((n, 1), margin), rate)
    start = psi(barriers, x, t, how, margin, rate)
    looked_at = 0
    for u, exists in inputs_on_the_row(rows.a[:, 0], rows.b[:, 0], rng):
        _, end, _ = least_and_after(barriers, x, t, u, how)
        grown = margin + 0.02 * rate
        after = psi(barriers, end, t + 0.02, how, grown, rate)
        promised = exists & (start >= 0.0) & (rows.h[:, 0] - margin >= 0.002)
        looked_at += promised.sum()
        assert (after[promised] >= (1.0 - 10.0 * 0.02) * start[promised] - 1e-11).all()
        assert (barriers.values(end, t + 0.02)[promised, 0] >= grown - 1e-14).all()
    assert looked_at >= 10


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10**6), v_max=st.floats(0.3, 3.0), margin=st.sampled_from([0.0, 0.05]))
def test_a_speed_limit_holds_while_any_input_that_meets_its_row_is_held(seed, v_max, margin):
    rng = np.random.default_rng(seed)
    alpha = LinearClassK(rng.uniform(0.02, 1.0) / 0.02)
    n, how = 200, RowSettings(period=0.02, u_max=U_MAX, alpha_speed=alpha)
    barriers = BarrierSet([(SpeedLimit("cap", 1, v_max, margin),)] * n)
    check_limits(barriers, 0.02, U_MAX)
    heading, fill = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(0.0, 1.0, n) ** 0.2
    fill[0] = 0.1  # one is slow, whatever is drawn
    highest = np.sqrt(v_max**2 - 2.0 * v_max * margin)
    speed = fill * highest
    velocity = speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
    x, t = np.column_stack([np.zeros((n, 2)), velocity]), np.zeros(n)
    rows = planar_rows(barriers, x, t, how)
    looked_at = 0
    for u, exists in inputs_on_the_row(rows.a[:, 0], rows.b[:, 0], rng):
        least, _, _ = least_and_after(barriers, x, t, u, how)
        looked_at += exists.sum()
        assert (least[exists] >= margin - 1e-12).all()
    assert looked_at >= n
    brake = -velocity / 0.02
    brake *= np.minimum(1.0, U_MAX / np.maximum(np.linalg.norm(brake, axis=1), 1e-9))[:, None]
    assert (np.sum(rows.a[:, 0] * brake, axis=1) >= rows.b[:, 0] - 1e-9).all()
    far = speed + 0.02 * U_MAX <= highest  # no input passes the limit within the period
    assert far.any()
    assert (rows.b[far, 0] < 0.0).all()  # so that coasting is allowed


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10**6), period=st.sampled_from([None, 0.005, 0.02, 0.1]))
def test_the_compiled_rows_equal_the_readable_ones(seed, period):
    rng = np.random.default_rng(seed)
    scene = [shape(kind, rng) for kind in SHAPES] + [SpeedLimit("cap", 1, 1.2, 0.1)]
    limits = None if seed % 2 else ((-5.0, -3.0), (4.0, 5.0))
    alphas = ALPHAS[seed % len(ALPHAS)], LinearClassK(2.0)
    how = RowSettings(*alphas, period, U_MAX, limits, LinearClassK(3.0))
    x, t = rng.normal(0.0, 1.0, 4), rng.uniform(0.0, 2.0)
    margin, rate = rng.uniform(0.0, 0.1, len(scene)), rng.uniform(-0.1, 0.1, len(scene))
    quickening = rng.uniform(0.0, 0.3, len(scene))
    compiled = planar_rows(
        BarrierSet([scene]), x[None], np.array([t]), how, margin[None], rate[None], quickening
    )
    for k, barrier in enumerate(scene):
        made = readable.held_row if how.held else readable.usual_row
        expected = made(barrier, x, t, how, margin[k], rate[k], quickening[k])
        found = [numbers[0, k] for numbers in (compiled.a, compiled.b, compiled.h)]
        found.append(compiled.alpha2_psi[0, k])
        for number, readable_one in zip(found, expected, strict=True):
            np.testing.assert_allclose(number, readable_one, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", [kind for kind in SHAPES if kind != "ellipse"])
def test_the_row_tends_to_the_usual_one_as_the_hold_becomes_short(kind):
    rng = np.random.default_rng(3)
    barriers = BarrierSet([(shape(kind, rng, moving=False), SpeedLimit("cap", 1, 1.2))])
    x, t = np.array([[2.0, 1.7, -0.7, 0.4]]), np.zeros(1)
    usual = RowSettings(alpha2=LinearClassK(2.0), alpha_speed=LinearClassK(3.0))
    expected = planar_rows(barriers, x, t, usual).b
    gaps = [
        abs(planar_rows(barriers, x, t, replace(usual, period=p, u_max=U_MAX)).b - expected)
        for p in (1e-2, 1e-3, 1e-4)
    ]
    assert (gaps[1] <= 0.2 * gaps[0] + 1e-9).all()
    assert (gaps[2] <= 0.2 * gaps[1] + 1e-9).all()


@pytest.mark.parametrize("gain", [2.0, 10.0, 25.0])
@pytest.mark.parametrize("kind", SHAPES)
def test_braking_meets_every_row_of_a_standing_region(kind, gain):
    rng = np.random.default_rng(5)
    n, how = 2000, RowSettings(alpha2=LinearClassK(gain), period=0.02, u_max=U_MAX)
    barriers = BarrierSet([(shape(kind, rng, moving=False),) for _ in range(n)])
    x, t = states_near(barriers, rng, n), np.zeros(n)
    x[:, 2:] *= np.minimum(1.0, 1.0 / np.linalg.norm(x[:, 2:], axis=1))[:, None]
    rows = planar_rows(barriers, x, t, how)
    safe = (psi(barriers, x, t, how) >= 0.0) & (rows.h[:, 0] >= 0.0015)
    assert safe.sum() > 300
    out = rows.a[:, 0] / np.sum(rows.a[:, 0] ** 2, axis=1)[:, None]
    u = -5.0 * x[:, 2:] + 0.25 * out * U_MAX / 2.0  # brake, and turn away from a corner
    assert (np.sum(rows.a[:, 0] * u, axis=1) >= rows.b[:, 0])[safe].all()


@pytest.mark.parametrize(
    "make",
    [
        lambda: RowSettings(period=0.2001, u_max=1.0),  # 0.2 s is one over the slope of α₁
        lambda: RowSettings(alpha1=LinearClassK(30.0), period=0.05, u_max=1.0),
        lambda: RowSettings(BrakeClassK(4.5, 0.08), period=0.02, u_max=1.0),
        lambda: RowSettings(alpha_speed=LinearClassK(51.0), period=0.02, u_max=1.0),
        lambda: RowSettings(period=0.02),
        lambda: RowSettings(period=-0.02, u_max=1.0),
        lambda: check_limits(BarrierSet([[SpeedLimit("cap", 1, 0.1)]]), 0.02, 7.0),
    ],
)
def test_settings_under_which_no_row_can_hold_are_refused(make):
    assert RowSettings(period=0.2, u_max=1.0).held
    with pytest.raises(InvalidInputError, match="expected"):
        make()


@pytest.mark.parametrize("kind", SHAPES)
def test_a_larger_alpha2_requests_no_more_where_psi_is_not_negative(kind):
    rng = np.random.default_rng(7)
    n, gains = 2000, np.sort(rng.uniform(0.1, 50.0, 8))
    barriers = BarrierSet([(shape(kind, rng),)] * n)
    x, t = states_near(barriers, rng, n), np.zeros(n)
    hows = [RowSettings(alpha2=LinearClassK(gain), period=0.02, u_max=U_MAX) for gain in gains]
    safe = psi(barriers, x, t, hows[0]) >= 0.0
    requested = [planar_rows(barriers, x, t, how).b[safe, 0] for how in hows]
    assert safe.sum() > 300
    assert (np.diff(requested, axis=0) <= 0.0).all()


def test_psi_is_reported_beside_its_alpha2():
    barriers = BarrierSet([[shape(kind, np.random.default_rng(0)) for kind in SHAPES]])
    x, t = np.array([[2.0, 1.0, 0.3, -0.2]]), np.zeros(1)
    how = RowSettings(period=0.02, u_max=U_MAX)
    a, out = np.empty((1, len(SHAPES), 2)), np.empty((4, 1, len(SHAPES)))
    _core.planar_rows(
        barriers.kind, barriers.parameters, np.zeros((3, 1, len(SHAPES))), x, t, how.packed, a, out
    )
    np.testing.assert_allclose(out[rows.ALPHA2_PSI], how.alpha2.gain * out[rows.PSI])


def test_an_episode_is_the_same_in_any_chunk():
    whole, *parts = (
        conflicts.run(Scenes("pd", "lex", "held", 3, *part)) for part in ((0, 6), (0, 4), (4, 2))
    )
    assert whole == parts[0] + parts[1]


@pytest.mark.parametrize("policy", conflicts.POLICIES)
def test_lex_enters_no_priority_whose_rows_can_be_met(policy):
    summary = conflicts.summary(conflicts.run(Scenes(policy, "lex", "held", 7, 0, 20)))
    assert summary["entered_though_met"] == [0, 0, 0, 0]
    assert summary["entered"][0] == 0.0
    assert summary["least_clearance"] >= 0.0
    assert summary["conflict"] == 1.0
    bare = conflicts.summary(conflicts.run(Scenes(policy, "none", "held", 7, 0, 20)))
    assert bare["entered"][0] > 0.2
