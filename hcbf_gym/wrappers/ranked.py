"""RankedObservation: observations with the conditions' ranks, of one length in all scenes."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector.utils import batch_space

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.errors import InvalidInputError, count
from hcbf_gym.wrappers.arguments import record

SLOTS = 27  # the number of conditions of the largest family of random scenes
MAX_SLOTS = 100_000
FAR = 5.0  # unit of lengths, and distance at which a condition is no longer present [m]
HEAD, SENSED, SLOT = 8, 4, 6
"""Entries of an observation before its conditions, of one condition, and of a slot."""


class RankedObservation(gym.ObservationWrapper, RecordConstructorArgs):
    """Lists the conditions nearest first, each with its presence and its rank, in fixed slots.

    It has 8 + 6 K entries in every scene: the state and the reference with lengths in units of 5 m,
    then K slots of (present, rank, h in units of 5 m, unit gradient (2,), ∂h/∂t [m/s]). A slot
    without a condition nearer than 5 m is zero.

    Args:
        env: an environment of this package, possibly wrapped.
        slots: K, the number of slots.

    Raises:
        InvalidInputError: if K is below 1, or the environment is not of this package.
    """

    def __init__(self, env: gym.Env, slots: int = SLOTS):
        record(self, env, gym.Env, slots=slots)
        gym.ObservationWrapper.__init__(self, env)
        self.slots = slots
        self.observation_space = _space(env.unwrapped, slots)

    def observation(self, observation: Array) -> Array:
        """Return the ranked observation (8 + 6 K,) of an observation (8 + 4 m,)."""
        inner: Any = self.unwrapped
        return ranked(observation[None], inner.barrier_set.priority, self.slots)[0]


class VectorRankedObservation(gym.vector.VectorObservationWrapper, RecordConstructorArgs):
    """`RankedObservation` for the native vector environment, possibly in vector wrappers."""

    def __init__(self, env: gym.vector.VectorEnv, slots: int = SLOTS):
        record(self, env, gym.vector.VectorEnv, slots=slots)
        gym.vector.VectorObservationWrapper.__init__(self, env)
        self.slots = slots
        self.single_observation_space = _space(env.unwrapped, slots)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def observations(self, observations: Array) -> Array:
        """Return the ranked observations (N, 8 + 6 K) of observations (N, 8 + 4 m)."""
        inner: Any = self.unwrapped
        return ranked(observations, inner.barrier_set.priority, self.slots)


def ranked(observation: Array, priority: Integers, slots: int) -> Array:
    """Return the ranked observations (N, 8 + 6 K); see `RankedObservation`.

    Args:
        observation: (N, 8 + 4 m) observations of this package's environments.
        priority: (N, ≥ m) ranks of the conditions.
        slots: K, the number of slots.
    """
    n, m = len(observation), (observation.shape[1] - HEAD) // SENSED
    sensed = observation[:, HEAD:].reshape(n, m, SENSED)
    robots = np.arange(n)[:, None]
    nearest = np.argsort(sensed[..., 0], axis=1, kind="stable")[:, :slots]
    h = sensed[robots, nearest, 0]
    ranked_observation = np.zeros((n, HEAD + SLOT * slots))
    ranked_observation[:, :HEAD] = observation[:, :HEAD]
    ranked_observation[:, :2] /= FAR  # the position error
    filled = ranked_observation[:, HEAD:].reshape(n, slots, SLOT)[:, : nearest.shape[1]]
    filled[..., 0] = 1.0
    filled[..., 1] = priority[robots, nearest]
    filled[..., 2] = np.clip(h / FAR, -1.0, 1.0)
    filled[..., 3:] = sensed[robots, nearest, 1:]
    filled[~(h < FAR)] = 0.0
    return ranked_observation


def _space(inner: Any, slots: int) -> spaces.Box:
    """Return the unbounded Box (8 + 6 K,); refuse other environments and numbers of slots."""
    if not hasattr(inner, "barrier_set"):
        raise InvalidInputError(
            f"ranked observation: got {inner}, expected an environment of this package"
        )
    count("slots", slots, maximum=MAX_SLOTS)
    return spaces.Box(-np.inf, np.inf, (HEAD + SLOT * slots,), np.float64)
