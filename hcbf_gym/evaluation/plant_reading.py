"""Reads the state and the conditions of a user's plant at one sample of an episode."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import Barrier
from hcbf_gym.barriers.placing import Placing
from hcbf_gym.barriers.set import BarrierSet, Condition
from hcbf_gym.errors import InvalidInputError, as_array
from hcbf_gym.evaluation.episode import Sample
from hcbf_gym.evaluation.vacuity import Strict
from hcbf_gym.models.plant import Estimate, Plant, read
from hcbf_gym.models.reduced_order import DoubleIntegrator, ReducedOrderModel


class RankedConditions(NamedTuple):
    """The m ranked conditions of a plant at one sample, with moving shapes as of time 0."""

    conditions: Sequence[Condition]  # (m,) name and rank of each condition
    # (m,) whether a condition of rank 1 reads the position; callers ignore the entry of other ranks
    reads_position: Mask
    evaluate_at: Strict  # (x (j, n), t (j,)) → (j, m) their values at j states and times [s]


class PlantReading(NamedTuple):
    """The state of a plant and its m conditions at one sample, as its readers return it."""

    x: Array  # (n,) the state
    time: float  # [s]
    h: Array  # (m,) the values of the conditions at this state and time
    conditions: Sequence[Condition]  # (m,) this field and the next two are of `RankedConditions`
    reads_position: Mask
    evaluate_at: Strict


def read_plant(
    plant: Plant, env: Any, sample: Sample, fallback_time: float, placing: Placing
) -> PlantReading:
    """Read the state and the conditions of a plant at a sample.

    Args:
        plant: the plant, whose readers are called.
        env: the unwrapped environment.
        sample: the newest sample.
        fallback_time: the time of the sample if the plant's state has none [s].
        placing: the times from which the shapes of this episode move.
    """
    observation, info = sample.observation, sample.info
    estimate = plant.state(env, observation, info)
    if not isinstance(estimate, Estimate):
        estimate = Estimate(estimate)
    x = np.asarray(estimate.x, dtype=np.float64)
    time = fallback_time if estimate.time is None else float(estimate.time)
    barriers: Any = read(plant.barriers, env, observation, info)
    scene = barriers if isinstance(barriers, BarrierSet) else BarrierSet([barriers])
    placed_scene = placing.place(scene, np.array([time]))
    # The core evaluates a scene of the planar double integrator at many states in one call. Only
    # this model has `Shapes`, an element with several conditions. Barriers of any other model are
    # single objects, and the core's batch takes no state but (position, velocity) in the plane.
    if is_planar_double_integrator(plant.model):
        of_plant = _planar_conditions(placed_scene)
    else:
        of_plant = _general_conditions(cast("Sequence[Barrier]", scene.listed[0]), placing)
    h = of_plant.evaluate_at(x[None], np.array([time]))[0]
    return PlantReading(x, time, h, *of_plant)


def is_planar_double_integrator(model: ReducedOrderModel) -> bool:
    """Return whether a model's state is (position, velocity) in the plane."""
    return isinstance(model, DoubleIntegrator) and model.n == 4


def _planar_conditions(placed_scene: BarrierSet) -> RankedConditions:
    """Return the conditions of scene 0, of which each place in the set's arrays is one."""
    reads_position = placed_scene.keeps_margin[0] > 0.0  # 1 for strict ones on the position, else 0
    return RankedConditions(placed_scene.conditions(), reads_position, placed_scene.along)


def _general_conditions(given: Sequence[Barrier], placing: Placing) -> RankedConditions:
    """Return one condition for each barrier that `placing` has just placed."""
    barriers = placing.moved_to_time_zero(list(given))
    return RankedConditions(
        [Condition(barrier.name, barrier.priority) for barrier in barriers],
        np.array([barrier.reads_position for barrier in barriers], dtype=np.bool_),
        partial(_evaluate, barriers),
    )


def _evaluate(barriers: Sequence[Barrier], x: Array, t: Array) -> Array:
    """Return (j, m) h of m barriers at j states x (j, n) and their times t (j,)."""
    pairs = zip(x, t, strict=True)
    return np.array([[float(barrier.h(*pair)) for barrier in barriers] for pair in pairs])


def reported_min_h(reported: object, count: int) -> Array:
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
