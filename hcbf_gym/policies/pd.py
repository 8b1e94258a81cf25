"""The paper's feedback controller, and the protocol of policies."""

from dataclasses import dataclass
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from hcbf_gym.arrays import Array, Info
from hcbf_gym.errors import InvalidInputError, finite_array, finite_float, flag, instance, reals


class Policy(Protocol):
    """A function of an observation and its info that returns a nominal acceleration u*."""

    def __call__(self, observation: Array, info: Info) -> NDArray[Any]:
        """Return u* (…, 2) [m/s²]."""
        ...


KP, KD = 2.0, 3.0
"""The gains that the paper leaves open [1/s², 1/s]: a damping ratio of K_d / (2 √K_p) = 1.06."""


def pd_law(position_error: Array, velocity_error: Array, kp: float = KP, kd: float = KD) -> Array:
    """Return ``K_p (p_ref − p) + K_d (v_ref − v)`` (…, 2) [m/s²] of errors in [m] and [m/s]."""
    return kp * position_error + kd * velocity_error


@dataclass(frozen=True)
class PDTracker:
    """The paper's feedback controller, ``u* = K_p (p_ref − p) + K_d (v_ref − v)``.

    It takes one observation or a batch.

    Args:
        low: (2,) least acceleration [m/s²].
        high: (2,) greatest acceleration [m/s²].
        kp: K_p [1/s²], not negative.
        kd: K_d [1/s], not negative.
        feed_forward: whether to add the reference's acceleration.

    Raises:
        InvalidInputError: if a gain is negative or not finite, or the bounds are no pairs.

    Source: equation (2) of the paper, which leaves the gains open.
    """

    low: Array
    high: Array
    kp: float = KP
    kd: float = KD
    feed_forward: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "low", finite_array("low", self.low, (2,)))
        object.__setattr__(self, "high", finite_array("high", self.high, (2,)))
        flag("feed_forward", self.feed_forward)
        finite_float("kp", self.kp, minimum=0.0)
        finite_float("kd", self.kd, minimum=0.0)

    @classmethod
    def for_env(cls, env: gym.Env | gym.vector.VectorEnv, **gains: Any) -> "PDTracker":
        """Return the controller for an environment of this package, single or vector.

        Args:
            env: the environment, whose action space bounds u*.
            gains: the arguments kp, kd and feed_forward.

        Raises:
            InvalidInputError: if the actions are no accelerations, or a wrapper changes actions or
                observations.
        """
        space = _action_space(env)
        if not isinstance(space, spaces.Box) or space.shape != (2,):
            raise InvalidInputError(f"action space: got {space}, expected a Box of shape (2,)")
        return cls(space.low.astype(np.float64), space.high.astype(np.float64), **gains)

    def __call__(self, observation: Array, info: Info) -> NDArray[np.float32]:
        """Return u* (…, 2) [m/s²], within the bounds."""
        observation = reals("observation", observation)
        if observation.ndim == 0 or observation.shape[-1] < 8:
            raise InvalidInputError(
                f"observation: got shape {observation.shape}, expected (…, 8 + 4 m)"
            )
        u = pd_law(observation[..., 0:2], observation[..., 2:4], self.kp, self.kd)
        if self.feed_forward:
            u = u + observation[..., 6:8]
        return np.clip(u, self.low, self.high).astype(np.float32)


_OBSERVATION_WRAPPERS = (gym.ObservationWrapper, gym.vector.VectorObservationWrapper)


def _action_space(env: Any) -> spaces.Space:
    """Return the space of one robot's actions; refuse wrappers that change spaces."""
    inner = instance("env", env, gym.Env, gym.vector.VectorEnv).unwrapped
    inner_spaces = (inner.action_space, inner.observation_space)
    while env is not inner:
        has_spaces_of_inner = (env.action_space, env.observation_space) == inner_spaces
        if isinstance(env, _OBSERVATION_WRAPPERS) or not has_spaces_of_inner:
            raise InvalidInputError(
                f"environment: got {type(env).__name__}, which changes actions or observations; "
                f"expected those of {inner}"
            )
        env = env.env
    if isinstance(inner, gym.vector.SyncVectorEnv):
        return _action_space(inner.envs[0])
    if isinstance(inner, gym.vector.VectorEnv):
        return inner.single_action_space
    return inner.action_space
