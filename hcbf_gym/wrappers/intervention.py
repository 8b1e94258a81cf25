"""InterventionPenalty: a reward that charges a policy for its filter's changes of the action."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.core import ActType, ObsType
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from hcbf_gym.arrays import Array, Info, Mask
from hcbf_gym.envs.infos import Reporter
from hcbf_gym.errors import InvalidInputError, finite_float
from hcbf_gym.wrappers.arguments import record
from hcbf_gym.wrappers.safety_filter import SafetyFilter
from hcbf_gym.wrappers.vector_safety_filter import VectorSafetyFilter


def _check_filtered(env: Any, wrapper: type) -> None:
    """Refuse an environment without a filter of the given class in it."""
    while env is not env.unwrapped:
        if isinstance(env, wrapper):
            return
        env = env.env
    raise InvalidInputError(f"environment: no safety filter in it, expected a {wrapper.__name__}")


class InterventionPenalty(gym.Wrapper[ObsType, ActType, ObsType, ActType], RecordConstructorArgs):
    """Adds ``−weight ‖u − u*‖`` to the reward, also as ``info["reward_intervention"]``.

    Args:
        env: an environment in a `SafetyFilter`.
        weight: reward per intervention [s²/m], not negative.

    Raises:
        InvalidInputError: if there is no filter, or the weight is negative or not finite.
    """

    def __init__(self, env: gym.Env[ObsType, ActType], weight: float = 0.01):
        record(self, env, gym.Env, weight=weight)
        _check_filtered(env, SafetyFilter)
        self.weight = finite_float("weight", weight, minimum=0.0)
        gym.Wrapper.__init__(self, env)

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[ObsType, Info]:
        """Reset the filtered environment; a reset charges nothing."""
        observation, info = self.env.reset(seed=seed, options=options)
        info["reward_intervention"] = np.float64(0.0)
        return observation, info

    def step(self, action: ActType) -> tuple[ObsType, float, bool, bool, Info]:
        """Step the filtered environment and charge the intervention."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        penalty = -self.weight * info["safety_filter"]["intervention"]
        info["reward_intervention"] = penalty
        return observation, float(reward) + penalty, terminated, truncated, info


class VectorInterventionPenalty(VectorWrapper, RecordConstructorArgs):
    """`InterventionPenalty` for the native vector environment in a `VectorSafetyFilter`."""

    def __init__(self, env: VectorEnv, weight: float = 0.01):
        record(self, env, VectorEnv, weight=weight)
        _check_filtered(env, VectorSafetyFilter)
        self.weight = finite_float("weight", weight, minimum=0.0)
        VectorWrapper.__init__(self, env)
        self._zeros = np.zeros(env.num_envs)
        self._reporter = Reporter(env, "reward_intervention")

    @property
    def autoreset_mode(self) -> AutoresetMode:
        """Gymnasium's autoreset mode of the environment."""
        return self.metadata["autoreset_mode"]

    def reset(
        self, *, seed: Any = None, options: dict[str, object] | None = None
    ) -> tuple[Any, Info]:
        """Reset the filtered environments; a reset charges nothing."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._reporter.at_reset(info, self._zeros, options)
        return observation, info

    def step(self, actions: Array) -> tuple[Any, Array, Mask, Mask, Info]:
        """Step the filtered environments and charge the interventions."""
        observation, reward, terminated, truncated, info = self.env.step(actions)
        intervention = info["safety_filter"]["intervention"]
        if "final_info" in info:  # of the environments that were reset within the step
            of_step = info["final_info"]["safety_filter"]["intervention"]
            intervention = np.where(info["_final_info"], of_step, intervention)
        penalty = -self.weight * intervention
        reward = reward + penalty
        ended = terminated | truncated
        self._reporter.at_step(info, penalty, lambda _: self._zeros, ended)
        return observation, reward, terminated, truncated, info
