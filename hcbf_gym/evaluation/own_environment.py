"""Loads a user's own environment and its plant, both of which a function of the user returns."""

from contextlib import closing
from typing import NamedTuple

import gymnasium as gym

from hcbf_gym import loading
from hcbf_gym.barriers import Barrier, Shapes
from hcbf_gym.barriers.many import each
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.certificates import identified
from hcbf_gym.certificates.identity import of as hash_of
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.plant import Plant, read


class EnvironmentAndPlant(NamedTuple):
    """A new environment, and the plant with which a filter reads it."""

    env: gym.Env
    plant: Plant


def make(source: str) -> EnvironmentAndPlant:
    """Call a user's function, ``module:function`` or ``file.py:function``.

    Raises:
        InvalidInputError: if there is no such function, or it returns anything else.
    """
    returned = loading.function("environment", source)()
    is_pair = isinstance(returned, tuple) and len(returned) == 2
    if not (is_pair and isinstance(returned[1], Plant)):
        raise InvalidInputError(
            f"{source}: got {returned!r}, expected a function that returns (environment, plant)"
        )
    return EnvironmentAndPlant(*returned)


def plant_hash(source: str) -> str:
    """Return a hash of the plant that a function makes; "" if two calls make different plants."""
    hashes = set()
    for env, plant in (make(source), make(source)):
        with closing(env):
            hashes.add(hash_of(identified(plant, env.unwrapped)))
    return hashes.pop() if len(hashes) == 1 else ""


def barriers_of(source: str, seed: int) -> list[Barrier | Shapes]:
    """Return each barrier of a function's plant after a reset by the seed, for pictures."""
    env, plant = make(source)
    with closing(env):
        observation, info = env.reset(seed=seed)
        barriers = read(plant.barriers, env.unwrapped, observation, info)
    return list(barriers.listed[0] if isinstance(barriers, BarrierSet) else each(barriers))
