"""What both environments share: time steps, observation, reward and the infos of a step."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from gymnasium import spaces

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Info, Integers, Mask
from hcbf_gym.barriers import Barrier, SpeedLimit
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, as_array, count, floats
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.scenarios import Hooks, Moment, Scenario

CONTROL_DT = _core.CONTROL_DT
"""Time between two actions [s]."""
PHYSICS_DT = _core.PHYSICS_DT
"""Time between two looks at the barriers [s], and one physics step of the full model."""
SUBSTEPS = _core.SUBSTEPS
MAX_EPISODE_STEPS = 1000

REWARD_TERMS = {
    "track": ("reward_tracking", "reward_effort"),
    "reach": ("reward_progress", "reward_goal", "reward_effort"),
}
"""What sums to the reward, by task."""


def action_space(input_set: InputSet) -> spaces.Box:
    """Return the smallest float32 Box around U [m/s²]."""
    corners = input_set.vertices().astype(np.float32)
    return spaces.Box(corners.min(axis=0), corners.max(axis=0))


def observation_space(observation: Array) -> spaces.Box:
    """Return the unbounded float64 Box of observations (N, n)."""
    return spaces.Box(-np.inf, np.inf, shape=observation.shape[1:], dtype=np.float64)


def barriers_of(scenario: Scenario, v_max: float | None) -> tuple[Barrier, ...]:
    """Return the scenario's barriers, then the environment's own strict speed limit, if any."""
    if v_max is None:
        return scenario.conditions
    return (*scenario.conditions, SpeedLimit("speed limit", 1, v_max))


def reference_table(scenario: Scenario) -> Array:
    """Return (k, 6) position, velocity and acceleration at the control times up to the goal."""
    steps = int(np.ceil(scenario.reference.duration / CONTROL_DT))
    times = CONTROL_DT * np.arange(steps + 1)
    return np.array(
        [
            np.concatenate([*scenario.reference(t), scenario.reference.acceleration(t)])
            for t in times
        ]
    )


def observe(x: Array, reference: Array, sensed: Array) -> Array:
    """Return (N, 8 + 4 m) what a policy sees.

    ``p_ref − p, v_ref − v, v, a_ref``, then per barrier ``h, ∇h/‖∇h‖, ∂h/∂t``.

    Args:
        x: (N, 4) position [m] and velocity [m/s].
        reference: (N, 6) position, velocity and acceleration of the reference.
        sensed: (N, m, 4) what `BarrierSet.sense` returns of the barriers that a policy sees.
    """
    of_barriers = sensed.reshape(len(x), -1)
    return np.hstack([reference[:, :4] - x, x[:, 2:], reference[:, 4:], of_barriers])


def reward_terms(
    task: str, distance_before: Array, distance_after: Array, reached: Mask, u: Array
) -> dict[str, Array]:
    """Return the terms (N,) that sum to the reward.

    track: ``−‖p_ref − p‖``; reach: the distance to the goal that the step gained, and a bonus when
    it is reached; both: ``−10⁻³ ‖u‖²``.

    Args:
        task: "track" or "reach".
        distance_before: (N,) to the reference's position before the step [m].
        distance_after: (N,) to the reference's position after it [m].
        reached: (N,) whether the goal is reached.
        u: (N, 2) the applied acceleration [m/s²].
    """
    effort, gained, bonus = each = np.empty((3, len(u)))
    _core.task_terms(distance_before, distance_after, reached, u, each)
    terms = (-distance_after, effort) if task == "track" else (gained, bonus, effort)
    return dict(zip(REWARD_TERMS[task], terms, strict=True))


class Ranked(NamedTuple):
    """What costs are counted by, of N scenes.

    Attributes:
        kind: (N, m) of the conditions, see `barriers.layout`.
        priority: (N, m) of the conditions; 1 is strict.
        ranks: R, how many ranks an environment tells apart.
    """

    kind: Integers
    priority: Integers
    ranks: int

    @classmethod
    def of(cls, scenes: BarrierSet, ranks: int | None = None) -> "Ranked":
        """Return what costs in these scenes are counted by; R is their last rank if not given."""
        last = int(scenes.priority.max(initial=1)) if ranks is None else ranks
        return cls(scenes.kind, scenes.priority, last)


def step_info(
    h: Array, min_h: Array, ranked: Ranked, tracking_error: Array, success: Mask
) -> dict[str, Array]:
    """Return the infos that every step carries, each with a leading axis N.

    Args:
        h: (N, m) barrier values at the step's end.
        min_h: (N, m) their least values over its physics steps.
        ranked: what costs are counted by.
        tracking_error: (N,) ‖p_ref − p‖ [m].
        success: (N,) whether the robot stands at the goal and the reference has ended.
    """
    cost, costs = costs_of(min_h, *ranked)
    return {
        "h": h,
        "min_h": min_h,
        "violation": np.maximum(0.0, -h),
        "cost": cost,
        "costs": costs,
        "tracking_error": tracking_error,
        "is_success": success.astype(np.float64),
    }


def costs_of(least: Array, kind: Integers, priority: Integers, ranks: int) -> tuple[Array, Array]:
    """Return the costs (N,), and by rank (N, R) [m], of the least h (N, m) in a step.

    A speed limit is a condition of rank 1 and has no metres. A rank beyond R counts with R.

    Args:
        least: the least values.
        kind: as `Ranked` has it.
        priority: as `Ranked` has it.
        ranks: as `Ranked` has it.
    """
    cost, costs = np.empty(len(least)), np.empty((len(least), ranks))
    _core.task_costs(least, kind, priority, cost, costs)
    return cost, costs


def reset_info(
    task: str, h: Array, ranked: Ranked, tracking_error: Array, hooks: Hooks
) -> dict[str, Array]:
    """Return the infos of a reset: those of a step that moved nothing and earned nothing.

    Args:
        task: "track" or "reach".
        h: (N, m) barrier values.
        ranked: what costs are counted by.
        tracking_error: (N,) ‖p_ref − p‖ [m].
        hooks: of a family, which may have a reward of its own.
    """
    info = step_info(h, h.copy(), ranked, tracking_error, np.zeros(len(h), dtype=np.bool_))
    terms = REWARD_TERMS[task] if hooks.reward is None else (REWARD_OWN,)
    return info | {term: np.zeros(len(h)) for term in terms}


REWARD_OWN = "reward_own"
"""The only term of a family's own reward."""


def observed(hooks: Hooks, x: Array, reference: Array, seen: Array) -> Array:
    """Return (N, n) the observation of a family's own; see `Hooks`."""
    assert hooks.observe is not None
    return answer("observe", hooks.observe(x, reference, seen), len(x), 2)


def judged(
    hooks: Hooks, moment: Moment, terms: dict[str, Array], costs: Array
) -> tuple[dict[str, Array], Array]:
    """Return the reward's terms and the costs of a step: a family's own where it has some."""
    n = len(moment.x)
    if hooks.reward is not None:
        terms = {REWARD_OWN: answer("reward", hooks.reward(moment), n, 1)}
    if hooks.costs is not None:
        costs = answer("costs", hooks.costs(moment), n, 2)
    return terms, costs


def answer(hook: str, given: object, n: int, axes: int) -> Array:
    """Return what a hook returned for N robots, copied.

    Raises:
        InvalidInputError: if it is no array of finite numbers with so many axes, the first N.
    """
    array = as_array(f"hook {hook}", given)
    if array.dtype.kind not in "fiub" or array.ndim != axes or len(array) != n:
        expected = f"({n},)" if axes == 1 else f"({n}, …)"
        raise InvalidInputError(
            f"hook {hook}: got shape {array.shape} of {array.dtype}, expected {expected} of numbers"
        )
    array = array.astype(np.float64)
    if not np.isfinite(array).all():
        raise InvalidInputError(f"hook {hook}: got {array.tolist()}, expected finite numbers")
    return array


def first(info: dict[str, Array]) -> Info:
    """Return the infos of environment 0: arrays, and numbers as NumPy's float64."""
    return {key: value[0] for key, value in info.items()}


def check_action(action: object, shape: tuple[int, ...]) -> Array:
    """Return the action as float64.

    Raises:
        InvalidInputError: if it is no array of 32 or 64 bits, has another shape, or an entry is NaN
            or infinite.
    """
    array = floats("action", action, shape).astype(np.float64, copy=False)
    if not _core.are_finite(array):
        raise InvalidInputError(f"action: got {array.tolist()}, expected finite accelerations")
    return array


def check_seed(seed: object) -> int | None:
    """Return the seed of a reset; None goes on.

    Raises:
        InvalidInputError: if it is neither None nor an integer from 0 on.
    """
    return None if seed is None else count("seed", seed, minimum=0, maximum=np.inf)


def check_seeds(seed: object, n: int) -> list[int | None]:
    """Return a seed for each of N environments.

    Args:
        seed: of environment 0, the others follow; or one for each.
        n: N.

    Raises:
        InvalidInputError: if there are not N of them, or one is none.
    """
    if isinstance(seed, Sequence) and not isinstance(seed, str | bytes):
        if len(seed) != n:
            raise InvalidInputError(f"seed: got {len(seed)} seeds, expected {n}")
        return [check_seed(one) for one in seed]
    first = check_seed(seed)
    return [None if first is None else first + i for i in range(n)]


def check_started(started: bool) -> None:
    """Refuse a step before the first reset.

    Raises:
        InvalidInputError: if there was no reset.
    """
    if not started:
        raise InvalidInputError("step: the episode has not begun, expected env.reset(seed=…) first")
