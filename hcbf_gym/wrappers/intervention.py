"""Rewards that charge a policy for what its safety filter had to change."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv, VectorWrapper
from numpy.typing import NDArray

from hcbf_gym.errors import InvalidInputError, finite_float
from hcbf_gym.wrappers.safety_filter import SafetyFilter, VectorSafetyFilter

Array = NDArray[np.float64]


def _check_filtered(env: Any, kind: type) -> None:
    """Refuse an environment without a filter.

    Raises:
        InvalidInputError: if no wrapper of the given kind is found.
    """
    while env is not env.unwrapped:
        if isinstance(env, kind):
            return
        env = env.env
    raise InvalidInputError(f"environment: got no safety filter, expected one in {kind.__name__}")


class InterventionPenalty(gym.Wrapper, RecordConstructorArgs):
    """Adds ``−weight ‖u − u*‖`` to the reward, also as ``info["reward_intervention"]``.

    Args:
        env: an environment in a `SafetyFilter`.
        weight: [s²/m], not negative.

    Raises:
        InvalidInputError: if there is no filter, or the weight is negative or not finite.
    """

    def __init__(self, env: gym.Env, weight: float = 0.01):
        _check_filtered(env, SafetyFilter)
        self.weight = finite_float("weight", weight, minimum=0.0)
        RecordConstructorArgs.__init__(self, weight=weight)
        gym.Wrapper.__init__(self, env)

    def step(self, action: Array) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Step the filtered environment and charge the intervention."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        penalty = -self.weight * info["safety_filter"]["intervention"]
        info["reward_intervention"] = penalty
        return observation, float(reward) + penalty, terminated, truncated, info


class VectorInterventionPenalty(VectorWrapper, RecordConstructorArgs):
    """`InterventionPenalty` for the native vector environment.

    Args:
        env: an environment in a `VectorSafetyFilter`.
        weight: [s²/m], not negative.

    Raises:
        InvalidInputError: if there is no filter, or the weight is negative or not finite.
    """

    def __init__(self, env: VectorEnv, weight: float = 0.01):
        _check_filtered(env, VectorSafetyFilter)
        self.weight = finite_float("weight", weight, minimum=0.0)
        RecordConstructorArgs.__init__(self, weight=weight)
        VectorWrapper.__init__(self, env)

    def step(self, actions: Array) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step the filtered environments and charge the interventions."""
        observation, reward, terminated, truncated, info = self.env.step(actions)
        penalty = -self.weight * info["safety_filter"]["intervention"]
        info["reward_intervention"] = penalty
        info["_reward_intervention"] = np.ones(self.num_envs, dtype=np.bool_)
        return observation, reward + penalty, terminated, truncated, info
