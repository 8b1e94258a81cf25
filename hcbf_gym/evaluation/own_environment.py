"""An environment of the user's own with its plant, which a function of theirs makes."""

from collections.abc import Sequence
from functools import partial
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
from hcbf_gym.certificates import identity as plant_identity
from hcbf_gym.errors import InvalidInputError, as_array
from hcbf_gym.evaluation.episode import Sample
from hcbf_gym.evaluation.vacuity import Strict
from hcbf_gym.models.plant import Estimate, Plant, read
from hcbf_gym.models.reduced_order import DoubleIntegrator


class Made(NamedTuple):
    """A new environment, and the plant with which a filter reads it."""

    env: gym.Env
    plant: Plant


def make(source: str) -> Made:
    """Call a user's function, ``module:function`` or ``file.py:function``.

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
    """Return the identity of the plant that a function makes; "" if each call makes another."""
    identities = set()
    for env, plant in (make(source), make(source)):
        identities.add(plant_identity.of(identified(plant, env.unwrapped)))
        env.close()
    return identities.pop() if len(identities) == 1 else ""


def barriers_of(source: str, seed: int) -> list[Barrier | Shapes]:
    """Return each barrier of a function's plant after a reset by the seed, for pictures."""
    env, plant = make(source)
    observation, info = env.reset(seed=seed)
    barriers = read(plant.barriers, env.unwrapped, observation, info)
    env.close()
    return list(barriers.listed[0] if isinstance(barriers, BarrierSet) else each(barriers))


class Reading(NamedTuple):
    """The state of a plant and its m ranked conditions at one sample, as its readers return it."""

    x: Array  # (n,) the state
    time: float  # [s]
    conditions: Sequence[Condition]  # (m,) name and rank of each condition
    reads_position: Mask  # (m,) which of the strict conditions read the position
    h: Array  # (m,) the values of the conditions
    along: Strict  # (x (j, n), t (j,)) → (j, m) their values at j other states and times


def reading(plant: Plant, env: Any, sample: Sample, counted: float, placing: Placing) -> Reading:
    """Read the state and the conditions of a plant at a sample.

    Args:
        plant: the plant, whose readers are called.
        env: the unwrapped environment.
        sample: the newest sample.
        counted: the time if the plant's state has none [s].
        placing: the times from which the shapes of this episode move.
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
        along = partial(_evaluate, barriers)
    return Reading(x, time, conditions, reads, along(x[None], np.array([time]))[0], along)


def _evaluate(barriers: Sequence[Barrier], x: Array, t: Array) -> Array:
    """Return (j, m) h of m barriers at j states x (j, n) and their times t (j,)."""
    pairs = zip(x, t, strict=True)
    return np.array([[float(barrier.h(*pair)) for barrier in barriers] for pair in pairs])


def least_reported(reported: object, count: int) -> Array:
    """Return (count,) the min_h that an environment of the user's own reports in its infos.

    Raises:
        InvalidInputError: if it is not one real number for each barrier.
    """
    min_h = as_array("min_h", reported)
    if min_h.dtype.kind not in "fiu" or min_h.shape != (count,):
        raise InvalidInputError(
            f"environment: got min_h {reported!r} in the infos, expected {count} numbers, one for "
            "each barrier in its order"
        )
    return min_h.astype(np.float64)
