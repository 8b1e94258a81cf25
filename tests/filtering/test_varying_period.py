"""Samples at times that vary are no alarm where the plant says so, whatever its model."""

import gymnasium as gym
import numpy as np
import pytest

import hcbf_gym
from hcbf_gym import models
from hcbf_gym.barriers import Disc
from hcbf_gym.models.input_sets import Box
from hcbf_gym.models.plant import Estimate, Reason

PERIOD = 0.02
FAR = Disc("far", 1, center=(90.0, 0.0), radius=1.0)


class Jittering(gym.Env):
    """A plant of any model that is sampled after times that vary."""

    def __init__(self, model, told):
        self.model, self.told = model, told
        self.action_space = gym.spaces.Box(-1.0, 1.0, (2,), np.float64)
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (model.n,), np.float64)
        self.plant = hcbf_gym.Plant(
            model, [FAR], lambda env, *_: env.sample(), Box.symmetric(1.0), period=PERIOD
        )

    def sample(self):
        return Estimate(self.x.copy(), self.time, elapsed=self.elapsed if self.told else None)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x, self.time, self.elapsed = np.full(self.model.n, 0.3), 0.0, None
        return self.x.copy(), {}

    def step(self, action):
        self.elapsed = self.np_random.uniform(0.2, 0.6) * PERIOD
        self.x, self.time = self.model.step(self.x, action, self.elapsed), self.time + self.elapsed
        return self.x.copy(), 0.0, False, False, {}


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("model", [models.DoubleIntegrator(), models.Unicycle()])
@pytest.mark.filterwarnings("ignore")
def test_a_varying_period_alarms_only_where_it_is_not_told(model, told):
    env = hcbf_gym.wrappers.SafetyFilter(Jittering(model, told), allow_late_inputs=True)
    env.reset(seed=0)
    rng, action, reasons = np.random.default_rng(0), np.zeros(2), set()
    for k in range(200):
        if k % 10 == 0:
            action = rng.uniform(-1.0, 1.0, 2)
        *_, info = env.step(action)
        reasons.add(int(info["safety_filter"]["reason"]))
    assert (reasons == {Reason.NONE}) == told
