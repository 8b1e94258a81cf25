import numpy as np
import pytest
from scipy.stats import chi2

from hcbf_gym._core import trunk_velocity
from hcbf_gym.arrays import packed
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.estimation import PRESETS, Estimator, Sensors
from hcbf_gym.locomotion.records import LEGS
from hcbf_gym.robots.reader import read_robot

BASE = [0, 1, 19, 20]


def run(estimator, walk, seed):
    """Return (k, 4) the errors of the estimates and (k, 4, 4) their reported covariance."""
    estimator.reset(walk[0], np.random.default_rng(seed))
    errors, covariances = [], []
    for truth in walk[1:]:
        estimator.tick(truth)
        known = estimator.estimate
        errors.append(known.x - truth[BASE])
        covariances.append(known.covariance)
    return np.array(errors), np.array(covariances)


def make(legs, source, timestep=0.002):
    return Estimator(legs, read_robot().foot_radius, source, timestep)


@pytest.mark.physics
@pytest.mark.parametrize(
    "source", [*PRESETS, {"drift": 0.05, "drift_time": 2.0}, {"yaw": 0.06, "slip": 0.01}]
)
def test_the_covariance_is_honest(legs, walk, source):
    runs, estimator = 40, make(legs, source)
    nees = np.empty(runs)
    for seed in range(runs):
        errors, covariances = run(estimator, walk, seed)
        errors, covariances = errors[500::50], covariances[500::50]
        scaled = np.linalg.solve(covariances, errors[..., None])[..., 0]
        nees[seed] = (errors * scaled).sum(axis=1).mean()
    # errors of one run hang together: at least as many degrees of freedom as runs count
    low, high = chi2.ppf([0.025, 0.975], 4 * runs) / runs
    assert low <= nees.mean() <= high


def test_a_late_fix_counts_as_if_it_had_come_at_once(legs, walk):
    sure = {"rate": 20.0, "slip": 10.0}  # a wide gate: which feet count must not depend on fixes
    late, prompt = make(legs, sure | {"delay": 0.04}), make(legs, sure | {"delay": 0.0})
    late.reset(walk[0], np.random.default_rng(3))
    prompt.reset(walk[0], np.random.default_rng(3))
    compared = 0
    for k, truth in enumerate(walk[1:], start=1):
        late.tick(truth)
        prompt.tick(truth)
        if k % 25 == 20:  # the late fix has just come, no newer one has been taken
            np.testing.assert_allclose(late.estimate.x, prompt.estimate.x, atol=1e-9)
            np.testing.assert_allclose(
                late.estimate.covariance, prompt.estimate.covariance, atol=1e-12
            )
            compared += 1
        elif k > 25 and k % 25 == 5:
            assert late.estimate.covariance[0, 0] > prompt.estimate.covariance[0, 0]
    assert compared == 60


def test_uncertainty_of_position_grows_between_fixes(legs, walk):
    _, covariances = run(make(legs, {"rate": 4.0, "delay": 0.0}), walk, seed=0)
    position = covariances[:, 0, 0]
    arrivals = np.arange(1, len(position) + 1) % 125 == 0
    steps = np.diff(position)
    assert arrivals[1:].sum() == len(walk[1:]) // 125 > 5
    assert (steps[~arrivals[1:]] > 0.0).all()
    assert (steps[arrivals[1:]] < 0.0).all()


def test_covariances_are_symmetric_and_positive(legs, walk):
    _, covariances = run(make(legs, "uwb"), walk, seed=0)
    np.testing.assert_array_equal(covariances, covariances.transpose(0, 2, 1))
    assert (np.linalg.eigvalsh(covariances) > 0.0).all()


def test_standing_feet_show_the_velocity_of_the_trunk(legs, walk):
    touching, errors = np.zeros(4, dtype=np.int64), []
    radius = read_robot().foot_radius
    for truth in walk:
        touching = np.where(truth[37:] > 0.0, touching + 1, 0)
        for leg in np.flatnonzero(touching > 5):
            shown, _ = trunk_velocity(packed(legs, LEGS), radius, leg, truth)
            errors.append(np.linalg.norm(shown - truth[19:21]))
    assert np.median(errors) < 0.015
    assert np.quantile(errors, 0.99) < 0.08


def test_the_output_is_the_estimate_and_the_sensed(legs, walk):
    estimator = make(legs, "lidar")
    estimator.reset(walk[0], np.random.default_rng(0))
    output = np.array([estimator.tick(truth) for truth in walk[1:]])
    np.testing.assert_array_equal(output[-1, BASE], estimator.estimate.x)
    noise = output - walk[1:]
    chosen = estimator.sensors
    assert np.std(noise[:, 7:19]) == pytest.approx(chosen.encoder, rel=0.05)
    rate = np.sqrt(2.0) * chosen.encoder / 0.002
    assert np.std(noise[:, 25:37]) == pytest.approx(rate, rel=0.05)
    assert np.std(noise[:, 22:25]) == pytest.approx(chosen.gyroscope * np.sqrt(250.0), rel=0.05)
    np.testing.assert_allclose(np.linalg.norm(output[:, 3:7], axis=1), 1.0, atol=1e-12)
    np.testing.assert_array_equal(output[:, [2, 21]], walk[1:, [2, 21]])
    assert 0.0 < np.mean(noise[:, 37:] != 0.0) < 0.01


def test_the_heading_error_has_the_declared_spread(legs, walk):
    estimator = make(legs, {"yaw": 0.02})
    errors = []
    for seed in range(200):
        output = estimator.reset(walk[0], np.random.default_rng(seed))
        errors.append(estimator.estimate.yaw - 0.3)
        assert output[3:7] != pytest.approx(walk[0, 3:7], abs=1e-9)
    assert np.std(errors) == pytest.approx(0.02, rel=0.15)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("gps", "expected one of.*motion-capture"),
        ({"rates": 1.0}, "unknown field"),
        ({"rate": 0.0}, "rate: got 0.0"),
        ({"noise": float("nan")}, "noise"),
        ({"delay": 5.0}, "delay: got 5.0"),
        ({"contact": 0.7}, "contact: got 0.7"),
        ([1.0], "mapping"),
    ],
)
def test_bad_sensors_are_refused(legs, source, message):
    with pytest.raises(InvalidInputError, match=message):
        make(legs, source)


def test_a_tick_before_a_reset_is_refused(legs, walk):
    with pytest.raises(InvalidInputError, match="reset"):
        make(legs, Sensors()).tick(walk[0])
