import numpy as np
import pytest

from hcbf_gym._core import kalman_correct, kalman_predict
from hcbf_gym.arrays import attributes, record_type, words_of
from hcbf_gym.estimation.estimator import AXIS, A, D, P, S, V

DT = 0.002


@pytest.fixture
def model():
    """(1,) of the core's `kalman::Model`."""
    model = np.zeros(1, dtype=record_type("kalman.Model"))
    record = attributes(model)
    record.timestep = DT
    record.keep[:] = 1.0, 1.0, 0.999, 0.99, 0.98
    record.variance[:] = 0.0, 0.0, 0.01, 0.02, 0.03
    record.fix = 4e-4
    return model


@pytest.fixture
def estimate():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((AXIS, AXIS))
    return rng.standard_normal((AXIS, 4)), root @ root.T


def test_prediction_is_that_of_the_matrices(model, estimate):
    x, cov = estimate
    acceleration, var_acc = np.array([0.7, -1.2, 0.2, 0.3]), 0.5
    transition = np.diag(model["keep"][0])
    transition[V, A] = -DT
    transition[P, V], transition[P, A] = DT, -DT * DT
    drive = np.zeros(AXIS)
    drive[[P, V]] = DT * DT, DT
    noise = var_acc * np.outer(drive, drive)
    slow = model["variance"][0]
    noise += np.diag((1.0 - model["keep"][0] ** 2) * slow)
    expected_x = transition @ x + np.outer(drive, acceleration)
    expected_cov = transition @ cov @ transition.T + noise
    kalman_predict(words_of(model), x, cov, acceleration, var_acc)
    np.testing.assert_allclose(x, expected_x, atol=1e-13)
    np.testing.assert_allclose(cov, expected_cov, atol=1e-13)


@pytest.mark.parametrize("shown", [(P, D), (V, S)])
def test_correction_is_the_least_squares_answer(estimate, shown):
    x, cov = estimate
    z, variance = np.array([0.3, -0.8, 0.1, 0.5]), 0.2
    row = np.zeros(AXIS)
    row[list(shown)] = 1.0
    information = np.linalg.inv(cov) + np.outer(row, row) / variance
    prior = np.linalg.solve(cov, x)
    expected = np.linalg.solve(information, prior + np.outer(row, z) / variance)
    kalman_correct(x, cov, *shown, z, variance)
    np.testing.assert_allclose(x, expected, atol=1e-9)
    np.testing.assert_allclose(cov, np.linalg.inv(information), atol=1e-9)


def test_slow_errors_keep_their_variance_in_the_long_run(model):
    x, cov = np.zeros((AXIS, 4)), np.zeros((AXIS, AXIS))
    for _ in range(20_000):
        kalman_predict(words_of(model), x, cov, np.zeros(4), 0.0)
    np.testing.assert_allclose(np.diag(cov)[D:], [0.01, 0.02, 0.03], rtol=1e-6)
