"""Samples at times that vary are no alarm where the plant reports them, whatever its model."""

import numpy as np
import pytest

import hcbf_gym
from hcbf_gym import Estimate, models
from hcbf_gym.barriers import Disc
from hcbf_gym.models import Box, Reason
from hcbf_gym.programs import FilterStatus
from tests.worlds import World

PERIOD = 0.02
FAR = Disc("far", 1, center=(90.0, 0.0), radius=1.0)


class Jittering(World):
    """A plant of any model that is sampled after times that vary."""

    def __init__(self, model, reported):
        super().__init__(model, PERIOD, 1.0, np.full(model.n, 0.3))
        self.reported = reported
        self.plant = hcbf_gym.Plant(
            model, [FAR], lambda env, *_: env.sample(), Box.symmetric(1.0), period=PERIOD
        )

    def sample(self):
        return Estimate(self.x.copy(), self.time, elapsed=self.elapsed if self.reported else None)

    def reset(self, *, seed=None, options=None):
        self.time, self.elapsed = 0.0, None
        return super().reset(seed=seed)

    def advance(self, u):
        self.elapsed = self.np_random.uniform(0.2, 0.6) * PERIOD
        self.time += self.elapsed
        return self.model.step(self.x, u, self.elapsed)


@pytest.mark.parametrize("reported", [True, False])
@pytest.mark.parametrize("model", [models.DoubleIntegrator(), models.Unicycle()])
@pytest.mark.filterwarnings("ignore")
def test_a_varying_period_alarms_only_where_it_is_not_reported(model, reported):
    env = hcbf_gym.wrappers.SafetyFilter(Jittering(model, reported), allow_late_inputs=True)
    env.reset(seed=0)
    rng, action, reasons = np.random.default_rng(0), np.zeros(2), set()
    for k in range(200):
        if k % 10 == 0:
            action = rng.uniform(-1.0, 1.0, 2)
        *_, info = env.step(action)
        reasons.add(int(info["safety_filter"]["reason"]))
    assert (reasons == {Reason.NONE}) == reported


@pytest.mark.parametrize("age", [0.0, np.inf])
@pytest.mark.parametrize("elapsed", [2e4, 1e160, 1e306])
@pytest.mark.parametrize("solver", [None, "daqp"])
@pytest.mark.parametrize("model", [models.DoubleIntegrator(), models.Unicycle()])
@pytest.mark.filterwarnings("ignore")
def test_a_time_between_samples_that_is_none_brakes_and_no_model_carries_a_state_away(
    model, solver, elapsed, age
):
    env = Jittering(model, reported=True)
    env = hcbf_gym.wrappers.SafetyFilter(env, solver=solver, allow_late_inputs=True)
    env.reset(seed=0)
    env.step(np.ones(2))
    x = env.unwrapped.x.copy()
    env.unwrapped.sample = lambda: Estimate(x, age=age, elapsed=elapsed)
    for _ in range(4):
        *_, info = env.step(np.ones(2))
        report = info["safety_filter"]
        assert report["status"] == FilterStatus.BACKUP
        assert np.isfinite(report["u_safe"]).all()
    env.unwrapped.sample = lambda: Estimate(x)  # time counts in periods
    *_, info = env.step(np.ones(2))
    assert info["safety_filter"]["reason"] in (Reason.NONE, Reason.CLOCK)


@pytest.mark.filterwarnings("ignore")
def test_a_state_that_would_be_carried_beyond_all_bounds_is_not_known():
    model = models.DoubleIntegrator()
    env = hcbf_gym.wrappers.SafetyFilter(Jittering(model, reported=True))
    env.reset(seed=0)
    env.unwrapped.sample = lambda: Estimate(np.array([9.9e3, 0.0, 9.9e3, 0.0]), elapsed=0.02)
    env.step(np.ones(2))
    env.unwrapped.sample = lambda: Estimate(np.zeros(4), age=np.inf, elapsed=9e3)
    for _ in range(4):
        *_, info = env.step(np.ones(2))
        assert info["safety_filter"]["status"] == FilterStatus.BACKUP
        np.testing.assert_array_equal(info["safety_filter"]["u_safe"], 0.0)
