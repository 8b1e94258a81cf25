"""One attacked episode, and what it says of the promise that rank 1 is never entered."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from scipy.stats import chi2

from hcbf_gym import wrappers
from hcbf_gym.arrays import Array
from hcbf_gym.envs.body import Footprint
from hcbf_gym.errors import LoweredWarning
from hcbf_gym.evaluation import attacks, stakes
from hcbf_gym.evaluation.rollouts import make_policy
from hcbf_gym.models.plant import FIRST_ALARM, Plant, Uncertainty
from hcbf_gym.models.reduced_order import DoubleIntegrator
from hcbf_gym.programs import FilterStatus

CONSISTENT = tuple(chi2.ppf([0.025, 0.975], 4).tolist())
"""The 95 % band of the NEES of position and velocity at one instant."""


@dataclass(frozen=True)
class AttackedEpisode:
    """What to run.

    Args:
        attack: what `attacks.make` takes, or a policy's name ("pd", "ppo", …).
        scenario: its name, or a scene as a dict.
        seed: of the environment and the attack.
        env: the id of an environment of this package.
        env_options: further arguments of the environment.
        filter_options: arguments of `SafetyFilter`.
        parameters: of an attack that has some.
        inside: a wrapper between the filter and the environment; None for none.
        uncertainty: what rows reserve; None is the plant's own.
    """

    attack: str
    scenario: Any
    seed: int
    env: str = "HCBF-A1Regions-v0"
    env_options: Mapping[str, Any] | None = None
    filter_options: Mapping[str, Any] | None = None
    parameters: tuple[float, ...] | None = None
    inside: Callable[[gym.Env], gym.Env] | None = None
    uncertainty: Uncertainty | None = None

    def run(self) -> "Outcome":
        """Run the episode to its end."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LoweredWarning)
            env = gym.make(self.env, scenario=self.scenario, **(self.env_options or {}))
        env = env if self.inside is None else self.inside(env)
        options: dict[str, Any] = {"program": "lex-cbf-qp"} | dict(self.filter_options or {})
        if self.uncertainty is not None:
            plant: Plant = env.unwrapped.plant  # type: ignore[attr-defined]
            own = self.uncertainty._replace(body=plant.uncertainty.body)
            options["plant"] = replace(plant, uncertainty=own)
        env = wrappers.SafetyFilter(env, **options)
        try:
            with warnings.catch_warnings(record=True) as raised:
                warnings.simplefilter("always")
                outcome = self._rollout(env)
            warned = any("does not apply" in str(one.message) for one in raised)
            return replace(outcome, warned=warned)
        finally:
            env.close()

    def _rollout(self, env: gym.Env) -> "Outcome":
        observation, info = env.reset(seed=self.seed)
        inner: Any = env.unwrapped
        wanted = wants(self.attack, env, self.seed, self.parameters)
        strict = [k for k, b in enumerate(inner.barriers) if b.priority == 1]
        position = [k for k in strict if inner.barriers[k].reads_position]
        speed = [k for k in strict if not inner.barriers[k].reads_position]
        second = [k for k, b in enumerate(inner.barriers) if b.priority == 2]
        least = np.asarray(info["min_h"]).copy()
        first_h = float(least[position].min())
        body = np.asarray(info.get("min_body_h", np.full(len(least), np.inf)))
        counts = np.zeros(len(FilterStatus), dtype=np.int64)
        margins, errors, changed, reach = [], [], False, 0.0
        footprint = (
            Footprint(inner.model, inner.model.body(1).name) if "min_body_h" in info else None
        )
        terminated = truncated = pressed = False
        steps = 0

        def strict_h(x: Array, t: Array) -> Array:
            return inner.barrier_set.along(x, t)[:, position]

        while not (terminated or truncated):
            u_nominal = wanted(observation, info)
            x, time = inner.truth, float(inner.time)
            observation, _, terminated, truncated, info = env.step(u_nominal)
            report = info["safety_filter"]
            now = inner.barrier_set.values(inner.truth[None], np.array([inner.time]))[0]
            least = np.minimum(least, np.minimum(info["min_h"], now))
            steps += 1
            pressed = pressed or stakes.pressed(
                DoubleIntegrator(), inner.plant.input_set, x, time, strict_h, report
            )
            body = np.minimum(body, info.get("min_body_h", np.inf))
            counts[int(report["status"])] += 1
            margins.append(report["margin"][position].max())
            changed = changed or bool(report["intervention"] > 1e-3)
            if inner.estimate.covariance is not None:
                errors.append(_error(inner))
            if footprint is not None:
                reach = max(reach, footprint.reach(inner.data))
        fell = bool(info.get("fallen", 0.0))
        return Outcome(
            least_h=float(least[position].min()),
            least_speed_h=float(least[speed].min()) if speed else np.inf,
            least_second_h=float(least[second].min()) if second else np.inf,
            least_body_h=float(body[position].min()),
            fell=fell,
            reached=bool(terminated) and bool(info["is_success"]),
            seconds=float(inner.time),
            qp_failures=int(info.get("qp_failures", 0)),
            status_counts=[int(count) for count in counts],
            median_margin=float(np.median(margins)),
            changed=changed,
            reach=reach,
            first_h=first_h,
            alarm=alarm_of(info),
            steps=steps,
            pressed=pressed,
            **_consistency(errors),
        )


def wants(
    name: str, env: gym.Env, seed: int, parameters: tuple[float, ...] | None = None
) -> Callable[[Any, dict[str, Any]], Array]:
    """Return (observation, info) → u* (2,) [m/s²] of an attack or of a policy.

    Args:
        name: what `attacks.make` takes, or a policy's.
        env: under its filter; attacks see its truth.
        seed: of an attack.
        parameters: of an attack that has some.

    Raises:
        UnknownNameError: if there is neither an attack nor a policy of that name.
    """
    if parameters is None and name not in attacks.ATTACKS and ":" not in name:
        policy = make_policy(name, env)
        return lambda observation, info: np.asarray(policy(observation, info), dtype=np.float64)
    attack = attacks.make(name, seed, parameters)
    return lambda observation, info: attack.wants(attacks.look(env))


@dataclass(frozen=True)
class Outcome:
    """What one episode showed; every h is the truth's, at every physics step.

    Attributes:
        least_h: least h of the strict barriers on the position [m].
        least_speed_h: of the strict speed limit [m/s].
        least_second_h: of the barriers of priority 2 [m].
        least_body_h: of the strict barriers for the robot's body [m]; infinite for a point.
        fell: whether the robot fell.
        reached: whether it reached the goal.
        seconds: how long it took [s].
        qp_failures: task-space QPs without a solution.
        status_counts: steps in each `FilterStatus`.
        median_margin: of the largest margin of a strict row on the position [m].
        changed: whether the filter changed u.
        reach: the greatest horizontal distance of the body from the trunk's centre [m].
        first_h: least h of the strict barriers at the reset [m].
        alarm: the `Reason` that stood at the end, where it is an alarm; 0 for none.
        steps: how many it took.
        pressed: whether the filter had to change an input that would have entered.
        position_error: root mean square of the estimated position's error [m]; None where the
            state is known.
        nees: mean of eᵀP⁻¹e of position and velocity; 4 of an estimator that knows its errors.
        nees_inside: share of the instants at which it lies in its 95 % band.
        warned: whether the filter said that the environment does not apply what it chose.
    """

    least_h: float
    least_speed_h: float
    least_second_h: float
    least_body_h: float
    fell: bool
    reached: bool
    seconds: float
    qp_failures: int
    status_counts: Sequence[int]
    median_margin: float
    changed: bool
    reach: float = 0.0
    first_h: float = np.inf
    alarm: int = 0
    steps: int = 0
    pressed: bool = False
    position_error: float | None = None
    nees: float | None = None
    nees_inside: float | None = None
    warned: bool = False


def alarm_of(info: Mapping[str, Any]) -> int:
    """Return the `Reason` of an alarm that a filter's report tells of; 0 for none."""
    reason = int(info["safety_filter"]["reason"])
    return reason if reason >= FIRST_ALARM else 0


class _Error(NamedTuple):
    """Of an estimate at one instant: the squared error of the position [m²], and the NEES."""

    position: float
    nees: float


def _error(env: Any) -> _Error:
    estimate = env.estimate
    error = estimate.model + estimate.lag - env.truth  # the body's estimate beside the body
    nees = error @ np.linalg.solve(estimate.covariance, error)
    return _Error(float(error[:2] @ error[:2]), float(nees))


def _consistency(errors: Sequence[_Error]) -> dict[str, Any]:
    """Return the fields of an outcome that tell of an estimator; none where there was none."""
    if not errors:
        return {}
    position, nees = np.array(errors).T
    inside = (nees >= CONSISTENT[0]) & (nees <= CONSISTENT[1])
    return {
        "position_error": float(np.sqrt(position.mean())),
        "nees": float(nees.mean()),
        "nees_inside": float(inside.mean()),
    }
