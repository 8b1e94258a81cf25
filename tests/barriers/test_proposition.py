"""Regions are not entered without a report: what the rows reserve, and how hard they brake."""

import numpy as np
import pytest
import readable
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks import proposition
from benchmarks.proposition import Draw, Start
from hcbf_gym import _core
from hcbf_gym.barriers import (
    BarrierSet,
    ConvexPolygon,
    Disc,
    Ellipse,
    HalfPlane,
    LogClassK,
    SpeedLimit,
)
from hcbf_gym.models import Box, Uncertainty
from tests.worlds import with_others

PLAIN = Draw(0.02, LogClassK(), 2.0, Box.symmetric(5.0), 0.0, 0.0, "exact", (), False, "lex-cbf-qp")
WALL = HalfPlane("wall", 1, (-1.0, 0.0), 0.0)


@pytest.mark.parametrize("axes", [(0.6, 0.4), (1.0, 0.2)])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_body_that_is_pressed_round_the_tip_of_an_ellipse_enters_nothing(axes, side):
    region = Ellipse("ellipse", 1, (0.0, 0.0), axes)
    way = Start(region, np.array([1.1 * axes[0] + 0.5, 0.0, 0.0, 0.0]), seconds=3.0)

    def round_the_tip(x):
        inwards = -x[:2] / np.linalg.norm(x[:2])
        return 5.0 * (inwards + 0.3 * side * np.array([-inwards[1], inwards[0]]))

    least, silent = proposition.follow(PLAIN._replace(body=0.46), way, round_the_tip)
    assert least >= 0.0
    assert not silent


@pytest.mark.parametrize("period", [0.02, 0.1])
@pytest.mark.parametrize("size", [0.02, 0.05, 0.1])
@pytest.mark.parametrize("known", ["dead reckoning", "accelerating"])
def test_dead_reckoning_that_is_off_by_all_that_is_reserved_enters_nothing(known, size, period):
    way = Start(WALL, np.array([-1.5, 0.0, 0.0, 0.0]), seconds=4.0, size=size)
    drawn = PLAIN._replace(known=known, period=period)
    least, silent = proposition.follow(drawn, way, lambda x: np.array([5.0, 0.0]))
    assert not silent
    assert least >= 0.0 or known == "accelerating"


@pytest.mark.parametrize("period", [0.01, 0.02, 0.05])
@pytest.mark.parametrize(
    ("away", "speed"), [(0.4, 1.5), (0.1, 0.5), (0.05, 0.4), (0.3, 1.2), (0.23, 1.48)]
)
def test_what_u_can_stop_is_stopped(away, speed, period):
    spare = away - speed**2 / (2.0 * 5.0)
    assert spare > 0.0
    for region in (WALL, Disc("disc", 1, (0.5, 0.0), 0.5)):
        way = Start(region, np.array([-away, 0.0, speed, 0.0]), seconds=3.0)
        drawn = PLAIN._replace(period=period)
        least, silent = proposition.follow(drawn, way, lambda x: np.array([5.0, 0.0]))
        assert least >= 0.0
        assert not silent


def test_random_scenes_are_entered_only_with_a_report():
    found = [proposition.walk(seed, 20) for seed in range(3)]
    assert sum(one["silent"] for one in found) == 0
    assert sum(one["entered"] for one in found) < sum(one["reported"] for one in found)


NOTHING = np.zeros((1, 4)), np.zeros((1, 4, 4))
SHAPES = with_others(
    Disc("disc", 1, (0.0, 0.0), 1.0),
    Ellipse("ellipse", 1, (0.0, 0.0), (2.0, 0.2), 0.3),
    ConvexPolygon("triangle", 1, ((-1.0, -1.0), (1.0, -0.5), (0.0, 1.0))),
)


def reserved(scenes, uncertainty, x, model, lag, covariance):
    """Return (4, 1, m) what the rows of one state reserve."""
    out, zero = np.zeros((4, *scenes.kind.shape)), np.zeros(1)
    numbers = np.array(uncertainty, dtype=float), scenes.kind, scenes.parameters
    _core.margins_reserved(*numbers, x, zero, model, lag, covariance, zero, 0.0, out)
    return out


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_body_nearer_than_the_model_that_the_row_reads_is_kept_for(seed):
    rng = np.random.default_rng(seed)
    scenes = BarrierSet([SHAPES])
    model, lag = np.zeros((1, 4)), np.zeros((1, 4))
    model[0, :2], lag[0, :2] = rng.uniform(-4.0, 4.0, 2), rng.uniform(-0.5, 0.5, 2)
    margin, *_ = reserved(scenes, Uncertainty(), model, model, lag, NOTHING[1])
    body = model + lag
    h_model, h_body = scenes.values(model, np.zeros(1)), scenes.values(body, np.zeros(1))
    assert (h_body >= h_model - margin - 1e-12).all()
    none, *_ = reserved(scenes, Uncertainty(), body, model, lag, NOTHING[1])
    np.testing.assert_allclose(none, 0.0, atol=1e-12)


def test_a_speed_limit_keeps_for_the_largest_error_of_the_velocity():
    scenes = BarrierSet([(SHAPES[0], SpeedLimit("cap", 1, 1.0))])
    x, covariance = np.array([[3.0, 0.0, 0.1, 0.0]]), np.zeros((1, 4, 4))
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    covariance[0, 2:, 2:] = turn @ np.diag([0.04, 0.0001]) @ turn.T
    margin, *_ = reserved(scenes, Uncertainty(confidence=4.0), x, x, NOTHING[0], covariance)
    assert margin[0, 1] == pytest.approx(readable.reserved(4.0, 0.2))
