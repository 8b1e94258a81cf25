"""A batch brakes the plants that are unknown; any other batch is refused."""

import warnings

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import wrappers
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.plant import Estimate, Reason
from hcbf_gym.programs import FilterStatus


def test_the_native_batch_brakes_the_plants_that_are_not_known_and_no_other(monkeypatch):
    envs = gym.make_vec("HCBF-Regions-v0", num_envs=4, scenario="random")
    envs = wrappers.VectorSafetyFilter(envs)
    alone = gym.make_vec("HCBF-Regions-v0", num_envs=4, scenario="random")
    alone = wrappers.VectorSafetyFilter(alone)
    rng = np.random.default_rng(0)
    for each in (envs, alone):
        each.reset(seed=3)
    for step in range(60):
        u = rng.uniform(-5.0, 5.0, (4, 2))
        if step == 20:
            inner = envs.unwrapped
            estimate = type(inner).estimate.fget

            def broken(env, estimate=estimate):
                x, t = estimate(env)[:2]
                return Estimate(np.where(np.arange(4)[:, None] == 2, np.nan, x), t)

            monkeypatch.setattr(type(inner), "estimate", property(broken))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            report = envs.step(u)[4]["safety_filter"]
        with monkeypatch.context() as patch:
            if step >= 20:
                patch.setattr(type(inner), "estimate", property(estimate))
            other = alone.step(u)[4]["safety_filter"]
        known = np.array([True, True, step < 20, True])
        np.testing.assert_array_equal(report["u_safe"][known], other["u_safe"][known])
        np.testing.assert_array_equal(report["status"] == FilterStatus.BACKUP, ~known)
        np.testing.assert_array_equal(report["reason"], np.where(known, 0, Reason.STATE))
    assert np.linalg.norm(envs.unwrapped.rom_state[2, 2:]) <= 1e-9


def test_single_environments_that_are_joined_are_refused_with_the_remedy():
    joined = gym.make_vec("HCBF-Regions-v0", num_envs=2, vectorization_mode="sync")
    with pytest.raises(InvalidInputError, match="put a SafetyFilter on each"):
        wrappers.VectorSafetyFilter(joined)


@pytest.mark.parametrize("states", [2, 5])
def test_weights_of_another_number_of_states_are_refused(states):
    envs = gym.make_vec("HCBF-Regions-v0", num_envs=3, scenario="random")
    with pytest.raises(InvalidInputError, match=f"{states} states, expected 3"):
        wrappers.VectorSafetyFilter(envs, "h-cbf-qp", gamma0=np.ones((states, 2)))
