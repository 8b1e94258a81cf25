"""What rows keep for what is uncertain, from the state that they read."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hcbf_gym import _core
from hcbf_gym.barriers import ConvexPolygon, Disc, Ellipse, SpeedLimit
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.models.plant import Uncertainty

NOTHING = np.zeros((1, 4)), np.zeros((1, 4, 4))
SHAPES = (
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
    assert margin[0, 1] == pytest.approx(4.0 * 0.2)
