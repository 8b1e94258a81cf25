"""The PD policy acts only where it can read what it sees and the actions are accelerations."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers import FrameStackObservation, NormalizeObservation, RescaleAction

from hcbf_gym import policies, wrappers
from hcbf_gym.errors import InvalidInputError

ID = "HCBF-Regions-v0"


def rescaled(env):
    return RescaleAction(env, np.float32(-1), np.float32(1))


@pytest.mark.parametrize(
    "wrap", [rescaled, NormalizeObservation, lambda env: FrameStackObservation(env, 3)]
)
@pytest.mark.parametrize("joined", [False, True])
def test_it_refuses_what_it_cannot_read(wrap, joined):
    env = wrap(gym.make(ID))
    with pytest.raises(InvalidInputError, match="changes actions or observations"):
        policies.PDTracker.for_env(SyncVectorEnv([lambda: env]) if joined else env)


def test_it_refuses_another_kind_of_environment():
    with pytest.raises(InvalidInputError, match="Box of shape"):
        policies.PDTracker.for_env(gym.make("CartPole-v1"))


def test_filters_holds_and_limits_do_not_disturb_it():
    filtered = wrappers.SafetyFilter(gym.make(ID, max_episode_steps=5), program="lex-cbf-qp")
    env = wrappers.HoldAction(wrappers.InterventionPenalty(filtered), 2)
    plain = policies.PDTracker.for_env(gym.make(ID))
    for other in (env, SyncVectorEnv([lambda: env]), gym.make_vec(ID, num_envs=2)):
        policy = policies.PDTracker.for_env(other)
        np.testing.assert_array_equal(policy.low, plain.low)
        np.testing.assert_array_equal(policy.high, plain.high)
