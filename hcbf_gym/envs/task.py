"""What all environments share: time steps, observation, reward and the infos of a step."""

from collections.abc import Sequence

import numpy as np
from gymnasium import spaces

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Info, Mask
from hcbf_gym.barriers import Barrier, SpeedLimit
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, as_array, count, floats
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.scenarios import Hooks, Moment, Scenario

CONTROL_DT = _core.CONTROL_DT
"""Time between two actions [s]."""
PHYSICS_DT = _core.PHYSICS_DT
"""Time between two evaluations of the barriers [s], and one physics step of the full model."""
SUBSTEPS = _core.SUBSTEPS
MAX_EPISODE_STEPS = 1000

REWARD_TERMS = {
    "track": ("reward_tracking", "reward_effort"),
    "reach": ("reward_progress", "reward_goal", "reward_effort"),
}
"""The terms that sum to the reward, by task."""
REWARD_OWN = "reward_own"
"""The only term of a family's own reward."""


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
    reference = scenario.reference
    steps = int(np.ceil(reference.duration / CONTROL_DT))
    times = CONTROL_DT * np.arange(steps + 1)
    return np.array([np.concatenate([*reference(t), reference.acceleration(t)]) for t in times])


def observe(hooks: Hooks, x: Array, reference: Array, sensed: Array) -> Array:
    """Return (N, n) what a policy sees: a family's own observation, or (N, 8 + 4 m) the usual one.

    ``p_ref − p, v_ref − v, v, a_ref``, then per barrier ``h, ∇h/‖∇h‖, ∂h/∂t``.

    Args:
        hooks: of the family.
        x: (N, 4) position [m] and velocity [m/s].
        reference: (N, 6) position, velocity and acceleration.
        sensed: (N, m, 4) of the barriers that a policy sees, see `BarrierSet.sense`.
    """
    if hooks.observe is not None:
        return answer("observe", hooks.observe(x, reference, sensed), len(x), 2)
    barriers = sensed.reshape(len(x), -1)
    return np.hstack([reference[:, :4] - x, x[:, 2:], reference[:, 4:], barriers])


def reward_terms(
    task: str, distance_before: Array, distance_after: Array, reached: Mask, u: Array
) -> dict[str, Array]:
    """Return the terms (N,) that sum to the reward.

    track: ``−‖p_ref − p‖``; reach: the distance to the goal that the step gained, and a bonus when
    it is reached; both: ``−10⁻³ ‖u‖²``.

    Args:
        task: "track" or "reach".
        distance_before: (N,) ‖p_ref − p‖ before the step [m].
        distance_after: (N,) after it [m].
        reached: (N,) whether the goal is reached.
        u: (N, 2) the applied acceleration [m/s²].
    """
    effort, gained, bonus = each = np.empty((3, len(u)))
    _core.task_terms(distance_before, distance_after, reached, u, each)
    terms = (-distance_after, effort) if task == "track" else (gained, bonus, effort)
    return dict(zip(REWARD_TERMS[task], terms, strict=True))


def step_info(
    h: Array, min_h: Array, scene: BarrierSet, ranks: int, error: Array, success: Mask
) -> dict[str, Array]:
    """Return the infos that every step reports, each with a leading axis N.

    Args:
        h: (N, m) barrier values at the step's end.
        min_h: (N, m) their least values over its physics steps.
        scene: the barriers.
        ranks: R, how many ranks costs have.
        error: (N,) ‖p_ref − p‖ [m].
        success: (N,) whether the robot is at the goal and the reference has ended.
    """
    cost, costs = costs_of(min_h, scene, ranks)
    return {
        "h": h,
        "min_h": min_h,
        "violation": np.maximum(0.0, -h),
        "cost": cost,
        "costs": costs,
        "tracking_error": error,
        "is_success": success.astype(np.float64),
    }


def costs_of(least: Array, scene: BarrierSet, ranks: int) -> tuple[Array, Array]:
    """Return the costs (N,), and by rank (N, R) [m], of the least h (N, m) in a step.

    A speed limit is a condition of rank 1 and has no metres. A rank beyond R counts with R.
    """
    cost, costs = np.empty(len(least)), np.empty((len(least), ranks))
    _core.task_costs(least, scene.kind, scene.priority, cost, costs)
    return cost, costs


def reset_info(
    task: str, h: Array, scene: BarrierSet, ranks: int, error: Array, hooks: Hooks
) -> dict[str, Array]:
    """Return the infos of a reset: `step_info` of no motion, and the reward's terms, zero."""
    info = step_info(h, h.copy(), scene, ranks, error, np.zeros(len(h), dtype=np.bool_))
    terms = REWARD_TERMS[task] if hooks.reward is None else (REWARD_OWN,)
    return info | {term: np.zeros(len(h)) for term in terms}


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
    """Return a copy of what a hook returned for N robots.

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
        InvalidInputError: if it is no array of 32 or 64 bits of this shape with finite entries.
    """
    array = floats("action", action, shape).astype(np.float64, copy=False)
    if not _core.are_finite(array):
        raise InvalidInputError(f"action: got {array.tolist()}, expected finite accelerations")
    return array


def check_seed(seed: object) -> int | None:
    """Return the seed of a reset, None or an integer from 0 on."""
    return None if seed is None else count("seed", seed, minimum=0, maximum=np.inf)


def check_seeds(seed: object, n: int) -> list[int | None]:
    """Return a seed for each of N environments: one for each, or consecutive ones from one.

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
    """Refuse a step before the first reset."""
    if not started:
        raise InvalidInputError("step: the episode has not begun, expected env.reset(seed=…) first")
