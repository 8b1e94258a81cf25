"""Observations with ranks, of one length in all random scenes."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector.utils import batch_space

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.errors import InvalidInputError, count
from hcbf_gym.wrappers.arguments import record

SLOTS = 27
"""As many conditions as the largest family of random scenes has."""
MOST_SLOTS = 100_000
FAR = 5.0
"""Unit of lengths, and from where on a condition does not count as present [m]."""
HEAD, SENSED, SLOT = 8, 4, 6
"""Entries of an observation before its conditions, of one condition, and of a slot."""


class RankedObservation(gym.ObservationWrapper, RecordConstructorArgs):
    """Lists the conditions nearest first, each with its presence and its rank, in fixed slots.

    It has 8 + 6 K entries in every scene: the state and the reference with lengths in units of 5 m,
    then K slots of (present, rank, h in units of 5 m, unit gradient (2,), ∂h/∂t [m/s]). A slot
    without a condition nearer than 5 m is zero.

    Args:
        env: an environment of this package, possibly wrapped.
        slots: K.

    Raises:
        InvalidInputError: if K is below 1, or the environment is another one.
    """

    def __init__(self, env: gym.Env, slots: int = SLOTS):
        record(self, env, gym.Env, slots=slots)
        gym.ObservationWrapper.__init__(self, env)
        self.slots = slots
        self.observation_space = _space(env.unwrapped, slots)

    def observation(self, observation: Array) -> Array:
        """Return (8 + 6 K,) of an observation (8 + 4 m,)."""
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
        """Return (N, 8 + 6 K) of observations (N, 8 + 4 m)."""
        inner: Any = self.unwrapped
        return ranked(observations, inner.barrier_set.priority, self.slots)


def ranked(observation: Array, priority: Integers, slots: int) -> Array:
    """Return (N, 8 + 6 K) of observations (N, 8 + 4 m).

    Args:
        observation: as the environments of this package give it.
        priority: (N, ≥ m) of the conditions.
        slots: K.
    """
    n, m = len(observation), (observation.shape[1] - HEAD) // SENSED
    sensed = observation[:, HEAD:].reshape(n, m, SENSED)
    h, rank = sensed[..., 0], priority[:, :m]
    nearest = np.argsort(h, axis=1, kind="stable")[:, :slots]
    rows = np.arange(n)[:, None]
    near = h[rows, nearest] < FAR
    out = np.zeros((n, HEAD + SLOT * slots))
    out[:, :HEAD] = observation[:, :HEAD]
    out[:, :2] /= FAR
    found = out[:, HEAD:].reshape(n, slots, SLOT)[:, : nearest.shape[1]]
    found[..., 0] = 1.0
    found[..., 1] = rank[rows, nearest]
    found[..., 2] = np.clip(h[rows, nearest] / FAR, -1.0, 1.0)
    found[..., 3:] = sensed[rows, nearest, 1:]
    found[~near] = 0.0
    return out


def _space(inner: Any, slots: int) -> spaces.Box:
    if not hasattr(inner, "barrier_set"):
        raise InvalidInputError(
            f"ranked observation: got {inner}, expected an environment of this package"
        )
    count("slots", slots, maximum=MOST_SLOTS)
    return spaces.Box(-np.inf, np.inf, (HEAD + SLOT * slots,), np.float64)
