"""The task that every environment poses: its clock and reference, observation, reward and infos.

Functions compute for N robots at once; a single environment calls them with N = 1.
"""

from collections.abc import Callable

import numpy as np
from gymnasium import spaces

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Info, Mask
from hcbf_gym.barriers import Barrier, SpeedLimit
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.scenarios import Hooks, Moment, Scenario
from hcbf_gym.scenarios.hooks import checked_result

CONTROL_DT = _core.CONTROL_DT  # time between two actions [s]
PHYSICS_DT = _core.PHYSICS_DT  # time between two evaluations of the barriers [s]
SUBSTEPS = _core.SUBSTEPS  # evaluations of the barriers between two actions
MAX_EPISODE_STEPS = 1000  # control steps after which registered environments truncate an episode

REWARD_TERMS = {
    "track": ("reward_tracking", "reward_effort"),
    "reach": ("reward_progress", "reward_goal", "reward_effort"),
}
"""The terms that sum to the reward, by task."""
REWARD_OWN = "reward_own"  # the only term where a family of scenes defines the reward


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
    """Return (N, n) the observation that a family's hook defines, or (N, 8 + 4 m) the usual one.

    The usual one is ``p_ref − p, v_ref − v, v, a_ref``, then per barrier ``h, ∇h/‖∇h‖, ∂h/∂t``.

    Args:
        hooks: the family's hooks.
        x: (N, 4) position [m] and velocity [m/s].
        reference: (N, 6) position, velocity and acceleration.
        sensed: (N, m, 4) the scene's conditions as `BarrierSet.sense` returns them.
    """
    if hooks.observe is not None:
        return checked_result("observe", hooks.observe(x, reference, sensed), len(x), axes=2)
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
        distance_after: (N,) ‖p_ref − p‖ after the step [m].
        reached: (N,) whether the goal is reached.
        u: (N, 2) the applied acceleration [m/s²].
    """
    terms = np.empty((3, len(u)))
    _core.task_terms(distance_before, distance_after, reached, u, terms)
    effort, progress, goal_bonus = terms
    values = (-distance_after, effort) if task == "track" else (progress, goal_bonus, effort)
    return dict(zip(REWARD_TERMS[task], values, strict=True))


def costs_of(min_h: Array, scene: BarrierSet, ranks: int) -> tuple[Array, Array]:
    """Return the costs (N,), and by rank (N, R) [m], of the least h (N, m) in a step.

    A speed limit is a condition of rank 1 and has no metres. A rank beyond R counts with R.
    """
    cost, costs = np.empty(len(min_h)), np.empty((len(min_h), ranks))
    _core.task_costs(min_h, scene.kind, scene.priority, cost, costs)
    return cost, costs


def step_info(
    h: Array, min_h: Array, scene: BarrierSet, ranks: int, error: Array, success: Mask
) -> dict[str, Array]:
    """Return the infos that every step reports, each with a leading axis N.

    Args:
        h: (N, m) barrier values at the step's end.
        min_h: (N, m) their least values over its physics steps.
        scene: the barriers.
        ranks: R, the number of ranks that `costs` has.
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


def reset_info(
    task: str, h: Array, scene: BarrierSet, ranks: int, error: Array, hooks: Hooks
) -> dict[str, Array]:
    """Return the infos of a reset: `step_info` without motion, and the reward's terms, zero."""
    info = step_info(h, h.copy(), scene, ranks, error, np.zeros(len(h), dtype=np.bool_))
    terms = REWARD_TERMS[task] if hooks.reward is None else (REWARD_OWN,)
    return info | {term: np.zeros(len(h)) for term in terms}


def replaced_by_hooks(
    hooks: Hooks, moment: Moment, terms: dict[str, Array], costs: Array
) -> tuple[dict[str, Array], Array]:
    """Return the reward's terms and the costs by rank, those of a family's hooks where it has some.

    Args:
        hooks: the family's hooks.
        moment: the N robots at the end of the step.
        terms: name → (N,) the usual terms of the reward.
        costs: (N, R) the usual costs.
    """
    if hooks.reward is not None:
        reward = checked_result("reward", hooks.reward(moment), len(moment.x), axes=1)
        terms = {REWARD_OWN: reward}
    return terms, costs if hooks.costs is None else own_costs(hooks.costs, moment)


def own_costs(hook: Callable[[Moment], Array], moment: Moment) -> Array:
    """Return the costs (N, k) that a family's hook computes for a step or a reset."""
    return checked_result("costs", hook(moment), len(moment.x), axes=2)


def without_batch_axis(info: dict[str, Array]) -> Info:
    """Return the infos of the only environment in a batch of one, as arrays and float64 numbers."""
    return {key: value[0] for key, value in info.items()}
