"""What happens when a state is NaN, in both cores: it is replaced, and the plant is braked."""

import warnings

import gymnasium as gym
import numpy as np
import pytest

import hcbf_gym
from hcbf_gym import models
from hcbf_gym.barriers import Disc
from hcbf_gym.models.plant import Reason
from hcbf_gym.programs import FilterStatus

STARTS = {
    "planar": (models.DoubleIntegrator(), [0.0, 0.0, 0.5, 0.0]),
    "general": (models.Unicycle(), [0.0, 0.0, 0.0]),
}


class Moving(gym.Env):
    """A plant that reports one state again and again."""

    def __init__(self, model, state):
        self.action_space = gym.spaces.Box(-1.0, 1.0, (model.n_u,), np.float64)
        self.observation_space = gym.spaces.Box(-9.0, 9.0, (model.n,), np.float64)
        self.x = np.array(state)

    def reset(self, *, seed=None, options=None):
        return self.x.copy(), {}

    def step(self, action):
        return self.x.copy(), 0.0, False, False, {}


@pytest.mark.parametrize("core", STARTS)
def test_a_state_that_is_nan_is_not_accepted_and_the_plant_is_brought_to_rest(core):
    model, state = STARTS[core]
    plant = hcbf_gym.Plant(
        model, [Disc("region", 1, (5.0, 0.0), 1.0)], lambda env, *_: env.x.copy(), period=0.1
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env = hcbf_gym.wrappers.SafetyFilter(
            Moving(model, state), plant=plant, allow_late_inputs=True
        )
        env.reset(seed=0)
        env.step(np.ones(model.n_u))  # the state that comes back is still a good one
        env.unwrapped.x[:] = np.nan
        env.step(np.ones(model.n_u))  # this step reads the good one; the next one reads NaN
        *_, info = env.step(np.ones(model.n_u))
    report = info["safety_filter"]
    assert (report["status"], report["reason"]) == (FilterStatus.BACKUP, Reason.STATE)
    # under the input that it had got, 0.5 m/s had become 0.6, and then 0.7
    expected = {"planar": [-1.0, 0.0], "general": [0.0, 0.0]}[core]
    assert report["u_safe"] == pytest.approx(expected, abs=1e-9)
