"""An environment and a plant of the user's own, made by their function."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from hcbf_gym import loading
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import Barrier, Shapes
from hcbf_gym.barriers.many import each
from hcbf_gym.barriers.placing import Placing
from hcbf_gym.barriers.set import BarrierSet, Condition
from hcbf_gym.certificates import identified
from hcbf_gym.certificates import identity as identities
from hcbf_gym.errors import InvalidInputError, as_array
from hcbf_gym.evaluation.episode import Sample
from hcbf_gym.evaluation.vacuity import Strict
from hcbf_gym.models.plant import Estimate, Plant, read
from hcbf_gym.models.reduced_order import DoubleIntegrator


class Made(NamedTuple):
    """What a user's function returned."""

    env: gym.Env  # the environment
    plant: Plant  # what a filter must know of it


def make(source: str) -> Made:
    """Return a new environment and its plant, from ``module:function`` or ``file.py:function``.

    Raises:
        InvalidInputError: if there is no such function, or it returns anything else.
    """
    made = loading.function("environment", source)()
    if not (isinstance(made, tuple) and len(made) == 2 and isinstance(made[1], Plant)):
        raise InvalidInputError(
            f"{source}: got {made!r}, expected a function that returns (environment, plant)"
        )
    return Made(*made)


def identity(source: str) -> str:
    """Return the identity of the plant that a function makes; "" where each call makes another."""
    found = set()
    for made in (make(source), make(source)):
        found.add(identities.of(identified(made.plant, made.env.unwrapped)))
        made.env.close()
    return found.pop() if len(found) == 1 else ""


def barriers_of(source: str, seed: int) -> list[Barrier | Shapes]:
    """Return the barriers of a plant after the first reset, one by one, as pictures show them."""
    env, plant = make(source)
    observation, info = env.reset(seed=seed)
    barriers = read(plant.barriers, env.unwrapped, observation, info)
    env.close()
    return list(barriers.listed[0] if isinstance(barriers, BarrierSet) else each(barriers))


class Reading(NamedTuple):
    """A plant and its m ranked conditions at one sample, by its readers."""

    x: Array  # (n,) the state
    time: float  # [s]
    conditions: Sequence[Condition]  # name and rank of each
    reads_position: Mask  # (m,) which of the strict ones read the position
    h: Array  # (m,) their values
    along: Strict  # (x (j, n), t (j,)) → (j, m) their values elsewhere


def reading(plant: Plant, env: Any, sample: Sample, counted: float, placing: Placing) -> Reading:
    """Return what a plant's readers return for a sample.

    Args:
        plant: with the readers.
        env: unwrapped.
        sample: the newest.
        counted: the time where the plant's state has none [s].
        placing: since when shapes count in this episode.
    """
    observation, info = sample.observation, sample.info
    estimate = plant.state(env, observation, info)
    if not isinstance(estimate, Estimate):
        estimate = Estimate(estimate)
    x = np.asarray(estimate.x, dtype=np.float64)
    time = counted if estimate.time is None else float(estimate.time)
    barriers: Any = read(plant.barriers, env, observation, info)
    given = barriers if isinstance(barriers, BarrierSet) else BarrierSet([barriers])
    scene = placing.place(given, np.array([time]))
    along: Strict
    if isinstance(plant.model, DoubleIntegrator) and plant.model.n == 4:
        conditions, reads, along = scene.conditions(), scene.keeps_margin[0] > 0.0, scene.along
    else:
        listed: Any = given.listed[0]
        barriers = placing.as_of_zero(list(listed))
        conditions = [Condition(b.name, b.priority) for b in barriers]
        reads = np.array([b.reads_position for b in barriers], dtype=np.bool_)
        along = lambda x, t: np.array([  # noqa: E731
            [float(b.h(*one)) for b in barriers] for one in zip(x, t, strict=True)
        ])  # fmt: skip
    return Reading(x, time, conditions, reads, along(x[None], np.array([time]))[0], along)


def least_reported(reported: object, count: int) -> Array:
    """Return (count,) an environment's own min_h; NaN counts as entered.

    Raises:
        InvalidInputError: if it is not one real number for each barrier.
    """
    given = as_array("min_h", reported)
    if given.dtype.kind not in "fiu" or given.shape != (count,):
        raise InvalidInputError(
            f"environment: got min_h {reported!r} in the infos, expected {count} numbers, one for "
            "each barrier in its order"
        )
    return given.astype(np.float64)
