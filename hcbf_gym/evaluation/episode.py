"""The loop of an episode, over which recorders, judges and films iterate."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from hcbf_gym.arrays import Array, Info

Act = Callable[[Any, Info], Any]  # (observation, info) → action, or those of N environments


class Sample(NamedTuple):
    """The values that an environment returned at its reset or after a step.

    Those of a vector environment have N entries. `action` is None at the reset.
    """

    observation: Any
    info: Info
    action: Any = None
    reward: Any = 0.0
    terminated: Any = False
    truncated: Any = False

    @property
    def over(self) -> bool:
        """Whether the episode, or that of every environment, has ended."""
        return bool(np.all(np.logical_or(self.terminated, self.truncated)))


def in_double(policy: Act) -> Callable[..., Array]:
    """Return the policy with its inputs as float64, in which environments compute."""
    return lambda observation, info: np.asarray(policy(observation, info), dtype=np.float64)


def samples(
    env: gym.Env | gym.vector.VectorEnv,
    act: Act,
    seed: Any,
    options: Mapping[str, object] | None = None,
) -> Iterator[Sample]:
    """Yield the samples of an episode, from its reset to its end; the environment stays open.

    An action is computed when the next sample is requested, so a loop may change the plant between
    two steps, and may stop at any.

    Args:
        env: an environment, or a vector environment that does not reset itself.
        act: (observation, info) → action.
        seed: the seed of the reset, or one for each of a vector environment's.
        options: the options of the reset.
    """
    observation, info = env.reset(seed=seed, options=None if options is None else dict(options))
    sample = Sample(observation, info)
    yield sample
    while not sample.over:
        action = act(sample.observation, sample.info)
        observation, reward, terminated, truncated, info = env.step(action)
        sample = Sample(observation, info, action, reward, terminated, truncated)
        yield sample
