"""A decision held for several steps, against the steps themselves."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

from hcbf_gym import wrappers
from hcbf_gym.errors import InvalidInputError

ID = "HCBF-Regions-v0"


def filtered(limit=57):
    env = gym.make(ID, scenario="random", max_episode_steps=limit)
    return wrappers.SafetyFilter(env, program="lex-cbf-qp")


def test_a_held_decision_is_the_sum_and_the_worst_of_its_steps():
    held, plain = wrappers.HoldAction(filtered(), 5), filtered()
    held.reset(seed=3)
    plain.reset(seed=3)
    lengths = []
    for u in np.random.default_rng(0).uniform(-5, 5, (20, 2)):
        observation, reward, terminated, truncated, info = held.step(u)
        infos, rewards, ended = [], [], False
        while len(infos) < 5 and not ended:
            expected, gained, *ends, step = plain.step(u)
            infos.append(step)
            rewards.append(gained)
            ended = any(ends)
        lengths.append(len(infos))
        np.testing.assert_array_equal(observation, expected)
        assert reward == pytest.approx(sum(rewards))
        assert info["cost"] == pytest.approx(sum(step["cost"] for step in infos))
        assert info["reward_effort"] == pytest.approx(sum(s["reward_effort"] for s in infos))
        np.testing.assert_array_equal(info["min_h"], np.min([s["min_h"] for s in infos], axis=0))
        np.testing.assert_array_equal(info["h"], infos[-1]["h"])
        reports, report = [s["safety_filter"] for s in infos], info["safety_filter"]
        assert report["status"] == max(r["status"] for r in reports)
        np.testing.assert_allclose(report["u_safe"], np.mean([r["u_safe"] for r in reports], 0))
        assert report["intervention"] == pytest.approx(
            np.mean([r["intervention"] for r in reports])
        )
        if ended:
            break
    assert (terminated, truncated) == (False, True)
    assert lengths == [5] * 11 + [2]  # 57 steps


def test_it_is_rebuilt_from_its_spec():
    env = wrappers.HoldAction(filtered(), 5)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert again.get_wrapper_attr("steps") == 5
    assert again.spec == env.spec


@pytest.mark.parametrize("steps", [0, -1, 2.5, True, "5"])
def test_a_hold_that_cannot_be_is_refused(steps):
    with pytest.raises(InvalidInputError, match="whole number"):
        wrappers.HoldAction(filtered(), steps)


def test_the_vector_form_names_where_it_belongs():
    with pytest.raises(InvalidInputError, match="Disabled"):
        wrappers.VectorHoldAction(gym.make_vec(ID, num_envs=2), 5)
    with pytest.raises(InvalidInputError, match="before they are joined"):
        wrappers.VectorHoldAction(SyncVectorEnv([filtered]), 5)
