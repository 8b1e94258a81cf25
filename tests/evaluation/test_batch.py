"""Episodes in a batch are those that run alone."""

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import policies, wrappers
from hcbf_gym.evaluation.batch import rollout_batch
from hcbf_gym.evaluation.rollouts import Case


@pytest.mark.parametrize("program", ["none", "lex-cbf-qp"])
def test_every_episode_of_a_batch_is_the_one_that_runs_alone(program):
    env = gym.make_vec("HCBF-Regions-v0", num_envs=4, scenario="random", autoreset_mode="Disabled")
    policy = policies.PDTracker.for_env(env)
    if program != "none":
        env = wrappers.VectorSafetyFilter(env, program)
    batch = rollout_batch(env, policy, seed=3)
    assert len(set(batch.steps)) > 1  # they end at different times
    for k in range(4):
        episode = Case("HCBF-Regions-v0", "random", "pd", program).run(seed=3 + k)
        summary, steps = episode.summary(), len(episode.reward)
        assert batch.steps[k] == steps
        np.testing.assert_allclose(batch.position[: steps + 1, k], episode.position, atol=1e-9)
        np.testing.assert_allclose(batch.min_h[k], summary["min_h"], atol=1e-9)
        np.testing.assert_allclose(batch.reward[:, k].sum(), summary["return"], atol=1e-9)
        np.testing.assert_allclose(batch.seconds_inside[k], summary["violation_seconds"], atol=1e-9)
        if_filtered = summary["intervention_rms"] if program != "none" else 0.0
        np.testing.assert_allclose(batch.intervention_rms[k], if_filtered, atol=1e-9)
        assert batch.terminated[k] == summary["reached"]
