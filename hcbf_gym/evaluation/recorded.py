"""The record of one episode, from which tables and pictures are made."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers.placing import Placing
from hcbf_gym.barriers.set import Condition
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.evaluation.episode import Sample, samples
from hcbf_gym.evaluation.measures import deadlocked
from hcbf_gym.evaluation.plant_reading import read_plant, reported_min_h
from hcbf_gym.models.plant import Plant
from hcbf_gym.models.reduced_order import DoubleIntegrator, SingleIntegrator
from hcbf_gym.models.vehicles import KinematicBicycle, Unicycle
from hcbf_gym.policies import Policy
from hcbf_gym.programs import FilterStatus

_REPORTED = ("u_nominal", "psi", "slack", "delta")  # fields of the filter's report and of `Episode`
Positions = Callable[[Array], Any]  # x (n,) → (2,) the robot's position in pictures [m]


@dataclass(frozen=True)
class Episode:
    """The record of an episode of k steps, with k + 1 samples, n states and m barriers."""

    time: Array  # (k + 1,) [s]
    state: Array  # (k + 1, n) of the reduced-order model
    position: Array  # (k + 1, 2) [m]; NaN where x and y are not known
    h: Array  # (k + 1, m) the barriers' values at the samples, in their units
    min_h: Array  # (k + 1, m) the least h since the sample before, as far as it is reported
    tracking_error: Array  # (k + 1,) ‖p_ref − p‖ [m]; NaN if the environment has no reference
    reward: Array  # (k,)
    u_nominal: Array  # (k, n_u) u*, the input of the policy
    u: Array  # (k, n_u) the applied input
    psi: Array  # (k, m) ψ, which the rows keep from falling below zero; NaN without a filter
    slack: Array  # (k, m) by how much the filter's rows were violated; zeros without a filter
    delta: Array  # (k, m) the program's own relaxation; zeros without a filter
    status: Integers  # (k,) `FilterStatus`; NOMINAL without a filter
    deadlock: Mask | None  # (k,) at rest though u* requested motion; None if v is not known
    obstacle_force: Array  # (k, b) the largest contact force with each box during a step [N]
    names: tuple[str, ...]  # (m,) the barriers' names
    priority: Integers  # (m,) the barriers' ranks; rank 1 is strict
    fell: bool  # whether the robot fell
    # whether the goal was reached, which for the task "track" is to end within the scenario's goal
    # radius; None if the environment does not report it
    reached: bool | None
    task: str | None = None  # the scene's, "track" or "reach"; None in an environment of your own

    @property
    def intervention(self) -> Array:
        """(k,) ‖u − u*‖, in the unit of u."""
        return np.linalg.norm(self.u - self.u_nominal, axis=1)

    def summary(self) -> dict[str, Any]:
        """Return the figures of the episode as plain numbers and lists, for JSON.

        Lists have one entry for each barrier. `outside_steps` counts the steps during which the
        true state was outside the strict safe set. A figure that is not known is None.
        """
        error, time = self.tracking_error, self.time
        is_outside = (self.min_h[1:, self.priority == 1] < 0.0).any(axis=1)
        violation_seconds = (np.diff(time)[:, None] * (self.h[1:] < 0.0)).sum(axis=0)
        return {
            "min_h": self.min_h.min(axis=0).tolist(),
            "violation_seconds": violation_seconds.tolist(),
            "relaxed_seconds": self._relaxed_seconds(),
            "violation_depth": np.maximum(-self.min_h, 0.0).max(axis=0).tolist(),
            "tracking_rms": _none_for_nan(np.sqrt(np.mean(error[1:] ** 2))),
            "final_error": _none_for_nan(error[-1]),
            "return": float(self.reward.sum()),
            "seconds": float(time[-1] - time[0]),
            "fell": self.fell,
            "reached": self.reached,
            "task": self.task,
            "intervention_rms": float(np.sqrt(np.mean(self.intervention**2))),
            "status_counts": {s.name: int((self.status == s).sum()) for s in FilterStatus},
            "outside_steps": int(is_outside.sum()),
            "deadlock_share": None if self.deadlock is None else float(np.mean(self.deadlock)),
            "max_obstacle_force": float(self.obstacle_force.max(initial=0.0)),
        }

    def _relaxed_seconds(self) -> dict[str, float]:
        """Return rank → how long a row of that rank was violated [s]; other ranks are left out."""
        step_seconds = np.diff(self.time)
        seconds_by_rank: dict[str, float] = {}
        for rank in np.unique(self.priority).tolist():
            is_relaxed = (self.slack[:, self.priority == rank] > 0.0).any(axis=1)
            if (seconds := float(step_seconds @ is_relaxed)) > 0.0:
                seconds_by_rank[str(rank)] = seconds
        return seconds_by_rank


def rollout(
    env: gym.Env,
    policy: Policy,
    seed: int,
    plant: Plant | None = None,
    steps: int | None = None,
    positions: Positions | None = None,
) -> Episode:
    """Run one episode to its end, in an environment of this package or in one of your own.

    Args:
        env: the environment, with a filter or without one.
        policy: (observation, info) → the environment's action.
        seed: the seed of the environment's reset.
        plant: the plant of an environment of your own; None takes that of the filter around it.
        steps: the number of steps after which to stop; None runs to the episode's end.
        positions: x (n,) → (2,) the robot's position [m]; None takes the first two entries of the
            planar models' states.

    Raises:
        InvalidInputError: if the environment has no plant, or no step was taken.
    """
    inner: Any = env.unwrapped
    is_own = not hasattr(inner, "barrier_set")
    if is_own and plant is None:
        plant = _plant_of_filter(env)
    instants = _record(env, policy, seed, plant if is_own else None, steps)
    reset = instants[0]
    after_steps = [instant.sample for instant in instants[1:]]
    reports = [
        sample.info.get("safety_filter") or _report_without_filter(sample, plant, len(reset.h))
        for sample in after_steps
    ]
    reported = {name: np.array([report[name] for report in reports]) for name in _REPORTED}
    x = np.array([instant.x for instant in instants])
    error = np.array([now.sample.info.get("tracking_error", np.nan) for now in instants])
    last = after_steps[-1]
    fell = bool(last.info.get("fallen", 0.0))
    if is_own:
        success = last.info.get("is_success", last.info.get("success"))
        reached, deadlock = None if success is None else bool(success), _deadlocks(plant, reports)
    else:
        radius = inner.scenario.goal_radius
        reached = last.over and not fell and bool(error[-1] <= radius)
        deadlock = deadlocked(x[1:, 2:], reported["u_nominal"], error[1:], radius)
    return Episode(
        time=np.array([instant.time for instant in instants]),
        state=x,
        position=np.array([_position(state, plant, positions, is_own) for state in x]),
        h=np.array([instant.h for instant in instants]),
        min_h=np.array([instant.min_h for instant in instants]),
        tracking_error=error,
        reward=np.array([float(sample.reward) for sample in after_steps]),
        u=np.array([report["u_safe"] for report in reports]),
        status=np.array([report["status"] for report in reports], dtype=np.int64),
        deadlock=deadlock,
        obstacle_force=np.array([s.info.get("obstacle_force", ()) for s in after_steps], float),
        names=tuple(condition.name for condition in reset.conditions),
        priority=np.array([condition.rank for condition in reset.conditions], dtype=np.int64),
        fell=fell,
        reached=reached,
        task=None if is_own else inner.scenario.task,
        **reported,
    )


class _Instant(NamedTuple):
    """The state of a plant and its m barriers at one sample."""

    sample: Sample
    time: float  # [s]
    x: Array  # (n,) the state of the reduced-order model
    h: Array  # (m,)
    min_h: Array  # (m,) the least h since the sample before, as far as it is reported
    conditions: Sequence[Condition]  # name and rank of each barrier


def _record(
    env: gym.Env, policy: Policy, seed: int, own_plant: Plant | None, steps: int | None
) -> list[_Instant]:
    """Run an episode of at least one step, and return its instants from the reset on.

    An environment of this package reports its state and barriers; others are read by `own_plant`.
    """
    instants: list[_Instant] = []
    placing = Placing(1)
    max_samples = None if steps is None else steps + 1  # the reset is a sample, too
    for sample in itertools.islice(samples(env, policy, seed), max_samples):
        if own_plant is None:
            instants.append(_instant(env.unwrapped, sample))
        else:
            instants.append(_own_instant(own_plant, env.unwrapped, sample, instants, placing))
    if len(instants) < 2:
        raise InvalidInputError("rollout: got an episode without a step, expected one at least")
    return instants


def _instant(inner: Any, sample: Sample) -> _Instant:
    """Return the instant of a sample, as an environment of this package reports it."""
    conditions = [Condition(b.name, b.priority) for b in inner.barriers]
    h, min_h = sample.info["h"], sample.info["min_h"]
    return _Instant(sample, inner.time, inner.rom_state, h, min_h, conditions)


def _own_instant(
    plant: Plant, inner: Any, sample: Sample, earlier: Sequence[_Instant], placing: Placing
) -> _Instant:
    """Return the instant of a sample after earlier ones, by the readers of a user's plant."""
    fallback_time = len(earlier) * (plant.period or CONTROL_DT)
    now = read_plant(plant, inner, sample, fallback_time, placing)
    if earlier and len(now.h) != len(earlier[0].h):
        raise InvalidInputError(
            f"rollout: got {len(now.h)} barriers after {len(earlier[0].h)}, expected their number "
            "to stay"
        )
    min_h = now.h
    if "min_h" in sample.info:
        min_h = np.minimum(now.h, reported_min_h(sample.info["min_h"], len(now.h)))
    return _Instant(sample, now.time, now.x, now.h, min_h, now.conditions)


def _plant_of_filter(env: gym.Env) -> Plant:
    """Return the plant of the filter around an environment of the user's own."""
    wrapper: Any = env
    while wrapper is not None:
        if isinstance(getattr(wrapper, "plant", None), Plant):
            return wrapper.plant
        wrapper = getattr(wrapper, "env", None)
    raise InvalidInputError(
        f"rollout: got {env}, whose state and barriers no filter knows; expected plant=Plant(…)"
    )


def _report_without_filter(sample: Sample, plant: Plant | None, m: int) -> dict[str, object]:
    """Return a filter's report for a step without a filter: u = u*, and no row was violated."""
    u = sample.action
    if plant is not None and plant.from_action is not None:
        u = plant.from_action(u)
    u = np.asarray(u, dtype=np.float64)
    rows = {"slack": np.zeros(m), "delta": np.zeros(m), "psi": np.full(m, np.nan)}
    return rows | {"u_nominal": u, "u_safe": u, "status": FilterStatus.NOMINAL, "deadlock": 0.0}


def _deadlocks(plant: Plant | None, reports: Sequence[Mapping[str, Any]]) -> Mask | None:
    """Return (k,) the deadlocks in a filter's reports; None for models without a velocity."""
    if plant is None or plant.model != DoubleIntegrator():
        return None
    return np.array([bool(report["deadlock"]) for report in reports])


def _position(x: Array, plant: Plant | None, positions: Positions | None, is_own: bool) -> Array:
    """Return the position (2,) of a state x (n,) [m]; NaN if it is not known."""
    if positions is not None:
        return np.asarray(positions(x), dtype=np.float64)
    model = None if plant is None else plant.model
    is_planar = (
        isinstance(model, Unicycle | KinematicBicycle)
        or (isinstance(model, DoubleIntegrator) and model.n == 4)
        or (isinstance(model, SingleIntegrator) and model.n == 2)
    )
    return x[:2] if is_planar or not is_own else np.full(2, np.nan)


def _none_for_nan(value: float) -> float | None:
    """Return a number, or None for NaN, which JSON does not have."""
    return None if np.isnan(value) else float(value)
