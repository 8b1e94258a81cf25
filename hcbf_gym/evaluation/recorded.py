"""One episode as it was recorded, for tables and pictures."""

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
from hcbf_gym.evaluation.own_environment import least_reported, reading
from hcbf_gym.models.plant import Plant
from hcbf_gym.models.reduced_order import DoubleIntegrator, SingleIntegrator
from hcbf_gym.models.vehicles import KinematicBicycle, Unicycle
from hcbf_gym.policies import Policy
from hcbf_gym.programs import FilterStatus

_REPORTED = ("u_nominal", "psi", "slack", "delta")
Positions = Callable[[Array], Any]
"""x (n,) → (2,) where the robot is seen from above [m]."""


@dataclass(frozen=True)
class Episode:
    """What one rollout recorded, k + 1 states and k steps, and how it ended."""

    time: Array  # (k + 1,) [s]
    state: Array  # (k + 1, n) of the reduced-order model
    position: Array  # (k + 1, 2) [m]; NaN where x and y are not known
    h: Array  # (k + 1, m) barrier values at the control times
    min_h: Array  # (k + 1, m) their least values since the control time before, as far as reported
    tracking_error: Array  # (k + 1,) ‖p_ref − p‖ [m]; NaN of an environment without a reference
    reward: Array  # (k,)
    u_nominal: Array  # (k, n_u) of the policy
    u: Array  # (k, n_u) what was applied
    psi: Array  # (k, m) what the filter's rows keep from falling below zero; NaN without a filter
    slack: Array  # (k, m) violation of the filter's rows; zeros without a filter
    delta: Array  # (k, m) the program's own relaxation; zeros without a filter
    status: Integers  # (k,) `FilterStatus`; NOMINAL without a filter
    # (k,) whether the robot stood though u* requested motion; None where the model has no velocity
    deadlock: Mask | None
    obstacle_force: Array  # (k, n) largest contact force with each box during the step [N]
    names: tuple[str, ...]  # of the m barriers
    priority: Integers  # (m,) of the barriers; 1 is strict
    fell: bool  # whether the robot fell
    # whether the goal was reached: for "track", within the scenario's goal radius at its own end;
    # None where the environment does not report it
    reached: bool | None
    task: str | None = None  # of the scene, "track" or "reach"; None of an environment of your own

    @property
    def intervention(self) -> Array:
        """(k,) ‖u − u*‖."""
        return np.linalg.norm(self.u - self.u_nominal, axis=1)

    def _relaxed_seconds(self) -> dict[str, float]:
        """Return rank → for how long a row of it was violated [s]; ranks without are left out."""
        seconds = np.diff(self.time)
        relaxed = {
            str(rank): float(seconds @ (self.slack[:, self.priority == rank] > 0.0).any(axis=1))
            for rank in np.unique(self.priority).tolist()
        }
        return {rank: time for rank, time in relaxed.items() if time > 0.0}

    def summary(self) -> dict[str, Any]:
        """Return the figures of the episode as plain numbers and lists.

        `status_counts` is of the filter's report; `outside_steps` counts the steps during which the
        true state was in a strict region.
        """
        error, time = self.tracking_error, self.time
        outside = (self.min_h[1:, self.priority == 1] < 0.0).any(axis=1)
        inside = (np.diff(time)[:, None] * (self.h[1:] < 0.0)).sum(axis=0)
        return {
            "min_h": self.min_h.min(axis=0).tolist(),
            "violation_seconds": inside.tolist(),
            "relaxed_seconds": self._relaxed_seconds(),
            "violation_depth": np.maximum(-self.min_h, 0.0).max(axis=0).tolist(),
            "tracking_rms": _known(np.sqrt(np.mean(error[1:] ** 2))),
            "final_error": _known(error[-1]),
            "return": float(self.reward.sum()),
            "seconds": float(time[-1] - time[0]),
            "fell": self.fell,
            "reached": self.reached,
            "task": self.task,
            "intervention_rms": float(np.sqrt(np.mean(self.intervention**2))),
            "status_counts": {
                status.name: int((self.status == status).sum()) for status in FilterStatus
            },
            "outside_steps": int(outside.sum()),
            "deadlock_share": None if self.deadlock is None else float(np.mean(self.deadlock)),
            "max_obstacle_force": float(self.obstacle_force.max(initial=0.0)),
        }


def _known(value: float) -> float | None:
    """Return a number; None for NaN, which JSON has not."""
    return None if np.isnan(value) else float(value)


def _walk(
    env: gym.Env, policy: Policy, seed: int, plant: Plant | None, steps: int | None
) -> tuple[list["_Look"], list[Sample]]:
    """Run an episode; return its samples, and what a user's plant or the environment shows."""
    looks: list[_Look] = []
    observed: list[Sample] = []
    placing = Placing(1)
    most = None if steps is None else steps + 1
    for sample in itertools.islice(samples(env, policy, seed), most):
        if plant is None:
            looks.append(_look(env.unwrapped, sample))
        else:
            looks.append(_look_own(plant, env, sample, looks, placing))
        observed.append(sample)
    if len(looks) < 2:
        raise InvalidInputError("rollout: got an episode without a step, expected one at least")
    return looks, observed


class _Look(NamedTuple):
    """What is recorded of one sample."""

    time: float
    x: Array
    h: Array
    min_h: Array
    conditions: tuple[Condition, ...]


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
        env: filtered or not.
        policy: (observation, info) → the environment's action.
        seed: of the environment.
        plant: of an environment of your own; None takes its filter's.
        steps: the most that the episode takes; None for as many as the environment does.
        positions: x (n,) → (2,) where the robot is [m]; None takes the first two entries of the
            planar models' states.

    Raises:
        InvalidInputError: if the environment has no plant, or no step was taken.
    """
    inner: Any = env.unwrapped
    own = not hasattr(inner, "barrier_set")
    if own and plant is None:
        plant = _plant_of(env)
    looks, observed = _walk(env, policy, seed, plant if own else None, steps)
    taken = observed[1:]
    x, m, last = np.array([look.x for look in looks]), len(looks[0].h), observed[-1].info
    reports = [one.info.get("safety_filter") or _unfiltered(one, plant, m) for one in taken]
    columns = {name: np.array([report[name] for report in reports]) for name in _REPORTED}
    error = np.array([one.info.get("tracking_error", np.nan) for one in observed])
    fell = bool(last.get("fallen", 0.0))
    if own:
        success = last.get("is_success", last.get("success"))
        reached, stood = None if success is None else bool(success), _stood(plant, reports)
    else:
        radius = inner.scenario.goal_radius
        reached = taken[-1].over and not fell and bool(error[-1] <= radius)
        stood = deadlocked(x[1:, 2:], columns["u_nominal"], error[1:], radius)
    names, ranks = zip(*looks[0].conditions, strict=True)
    return Episode(
        time=np.array([look.time for look in looks]),
        state=x,
        position=np.array([_seen_at(one, plant, positions, own) for one in x]),
        h=np.array([look.h for look in looks]),
        min_h=np.array([look.min_h for look in looks]),
        tracking_error=error,
        reward=np.array([float(one.reward) for one in taken]),
        u=np.array([report["u_safe"] for report in reports]),
        status=np.array([report["status"] for report in reports], dtype=np.int64),
        deadlock=stood,
        obstacle_force=np.array([one.info.get("obstacle_force", ()) for one in taken], np.float64),
        names=names,
        priority=np.array(ranks, dtype=np.int64),
        fell=fell,
        reached=reached,
        task=None if own else inner.scenario.task,
        **columns,
    )


def _stood(plant: Plant | None, reports: Sequence[Mapping[str, Any]]) -> Mask | None:
    """Return (k,) deadlocks by a filter, which knows the planar double integrator's velocity."""
    if plant is None or plant.model != DoubleIntegrator():
        return None
    return np.array([bool(report["deadlock"]) for report in reports])


def _plant_of(env: gym.Env) -> Plant:
    """Return the plant of the filter around an environment of the user's own."""
    around: Any = env
    while around is not None:
        if isinstance(getattr(around, "plant", None), Plant):
            return around.plant
        around = getattr(around, "env", None)
    raise InvalidInputError(
        f"rollout: got {env}, whose state and barriers no filter knows; expected plant=Plant(…)"
    )


def _look(inner: Any, sample: Sample) -> _Look:
    """Return what an environment of this package shows."""
    conditions = tuple(Condition(b.name, b.priority) for b in inner.barriers)
    h, min_h = sample.info["h"], sample.info["min_h"]
    return _Look(inner.time, inner.rom_state, h, min_h, conditions)


def _look_own(
    plant: Plant, env: gym.Env, sample: Sample, before: list[_Look], placing: Placing
) -> _Look:
    """Return what the plant of a user's environment shows."""
    counted = len(before) * (plant.period or CONTROL_DT)
    now = reading(plant, env.unwrapped, sample, counted, placing)
    if before and len(now.h) != len(before[0].h):
        raise InvalidInputError(
            f"rollout: got {len(now.h)} barriers after {len(before[0].h)}, expected their number "
            "to stay"
        )
    min_h = now.h
    if "min_h" in sample.info:
        min_h = np.minimum(now.h, least_reported(sample.info["min_h"], len(now.h)))
    return _Look(now.time, now.x, now.h, min_h, tuple(now.conditions))


def _unfiltered(sample: Sample, plant: Plant | None, m: int) -> dict[str, object]:
    """Return the report of a filter that changes nothing."""
    read = None if plant is None else plant.from_action
    u = np.asarray(sample.action if read is None else read(sample.action), dtype=np.float64)
    none = {"slack": np.zeros(m), "delta": np.zeros(m), "psi": np.full(m, np.nan)}
    return none | {
        "u_nominal": u, "u_safe": u, "status": FilterStatus.NOMINAL, "deadlock": 0.0
    }  # fmt: skip


def _seen_at(x: Array, plant: Plant | None, positions: Positions | None, own: bool) -> Array:
    """Return (2,) where a state is seen from above [m]; NaN where that is not known."""
    if positions is not None:
        return np.asarray(positions(x), dtype=np.float64)
    model = None if plant is None else plant.model
    planar = (
        isinstance(model, Unicycle | KinematicBicycle)
        or (isinstance(model, DoubleIntegrator) and model.n == 4)
        or (isinstance(model, SingleIntegrator) and model.n == 2)
    )
    return x[:2] if planar or not own else np.full(2, np.nan)
