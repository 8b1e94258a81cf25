"""One attacked episode, and whether rank 1 was entered in it."""

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from scipy.stats import chi2

from hcbf_gym import plugins, policies, wrappers
from hcbf_gym._core import FIRST_ALARM, Reason
from hcbf_gym.arrays import Array, Info, Integers, Mask
from hcbf_gym.envs.body import Footprint
from hcbf_gym.errors import LoweredWarning
from hcbf_gym.evaluation import attacks, vacuity
from hcbf_gym.evaluation.episode import Act, Sample, in_double, samples
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Plant, Uncertainty
from hcbf_gym.models.reduced_order import ReducedOrderModel
from hcbf_gym.programs import FilterStatus

CONSISTENT = tuple(chi2.ppf([0.025, 0.975], 4).tolist())
"""The 95 % band of the NEES of position and velocity at one instant."""


@dataclass(frozen=True)
class AttackedEpisode:
    """What to run."""

    attack: str  # what `attacks.make` takes, or a policy as `policies.make` takes it
    scenario: Any  # its name, or a scene as a dict
    seed: int  # of the environment and the attack
    env: str = "HCBF-A1Regions-v0"  # the id of an environment of this package
    env_options: Mapping[str, Any] | None = None  # further arguments of the environment
    filter_options: Mapping[str, Any] | None = None  # arguments of `SafetyFilter`
    parameters: tuple[float, ...] | None = None  # of an attack that has some
    # a wrapper between the filter and the environment; None for none
    inside: Callable[[gym.Env], gym.Env] | None = None
    uncertainty: Uncertainty | None = None  # what rows reserve; None is the plant's own

    def run(self) -> "Outcome":
        """Run the episode to its end."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LoweredWarning)
            plugins.load()  # which may register the environment
            env = gym.make(self.env, scenario=self.scenario, **(self.env_options or {}))
        env = env if self.inside is None else self.inside(env)
        options: dict[str, Any] = {"program": "lex-cbf-qp"} | dict(self.filter_options or {})
        if self.uncertainty is not None:
            plant: Plant = env.unwrapped.plant  # type: ignore[attr-defined]
            options["plant"] = reserving(plant, self.uncertainty)
        env = wrappers.SafetyFilter(env, **options)
        try:
            with warnings.catch_warnings(record=True) as raised:
                warnings.simplefilter("always")
                outcome = self._judged(env)
            warned = any("does not apply" in str(one.message) for one in raised)
            return replace(outcome, warned=warned)
        finally:
            env.close()

    def _judged(self, env: gym.Env) -> "Outcome":
        """Run the episode in a filtered environment, with what its estimator and its body did."""
        inner: Any = env.unwrapped
        act = policy_of(self.attack, env, self.seed, self.parameters)
        errors: list[tuple[float, float]] = []
        reaches = [0.0]

        def observed() -> Iterator[Sample]:
            footprint = None
            for sample in samples(env, act, self.seed):
                if sample.action is None:
                    if "min_body_h" in sample.info:
                        footprint = Footprint(inner.model, inner.model.body(1).name)
                else:
                    if inner.estimate.covariance is not None:
                        errors.append(_error(inner))
                    if footprint is not None:
                        reaches.append(footprint.reach(inner.data))
                yield sample

        outcome = judge(observed(), truth_of(inner), inner.plant.model, inner.plant.input_set)
        return replace(outcome, reach=max(reaches), **_consistency(errors))


def policy_of(
    name: str, env: gym.Env, seed: int, parameters: tuple[float, ...] | None = None
) -> Act:
    """Return (observation, info) → u* (2,) [m/s²] of a policy or of an attack on the truth.

    Raises:
        UnknownNameError: if there is neither an attack nor a policy of that name.
    """
    if parameters is None and not attacks.is_attack(name):
        return in_double(policies.make(name, env))
    attack = attacks.make(name, seed, parameters)
    return lambda observation, info: attack.act(attacks.observe(env))


@dataclass(frozen=True)
class Outcome:
    """What one episode showed; every h is the truth's, at every physics step that is reported."""

    least_h: float  # least h of the strict barriers on the position [m, or the unit of h]
    least_speed_h: float = np.inf  # of the strict speed limit [m/s]; infinite where there is none
    least_second_h: float = np.inf  # of the barriers of priority 2 [m]
    # of the strict barriers for the robot's body [m]; infinite for a point
    least_body_h: float = np.inf
    first_h: float = np.inf  # least h of the strict barriers on the position at the reset [m]
    fell: bool = False  # whether the robot fell, as far as its environment reports it
    reached: bool = False  # whether it reached the goal, in the same sense
    seconds: float = 0.0  # how long it took [s]
    steps: int = 0  # how many it took
    qp_failures: int = 0  # task-space QPs without a solution
    status_counts: Sequence[int] = ()  # steps in each `FilterStatus`
    median_margin: float = 0.0  # of the largest margin of a strict row on the position [m]
    changed: bool = False  # whether the filter changed u
    pressed: bool = False  # whether the filter had to change an input that would have entered
    alarm: int = 0  # the `Reason` that stood at the end, where it is an alarm; 0 for none
    warned: bool = False  # whether the filter warned that the environment does not apply its input
    reach: float = 0.0  # the greatest horizontal distance of the body from the trunk's centre [m]
    # root mean square of the estimated position's error [m]; None where the state is known
    position_error: float | None = None
    # mean of eᵀP⁻¹e of position and velocity; 4 of an estimator that knows its errors
    nees: float | None = None
    nees_inside: float | None = None  # share of the instants at which it lies in its 95 % band


class Truth(NamedTuple):
    """A plant and its ranked conditions at one sample, as they are."""

    x: Array  # (n,) the state
    time: float  # [s]
    # least h of the strict conditions on the position since the sample before, where less is
    # reported than now holds
    h: float
    speed_h: float  # of the other strict conditions; infinite where there are none
    second_h: float  # of those of priority 2, or infinite
    position: Mask  # (m,) which conditions are strict and read the position
    along: vacuity.Strict  # (x (j, n), t (j,)) → (j, k) the h's of those elsewhere


def truth(
    x: Array, time: float, h: Array, rank: Integers, reads_position: Mask, along: vacuity.Strict
) -> Truth:
    """Return the truth at one sample.

    Args:
        x: (n,) the state.
        time: [s].
        h: (m,) of each condition, the least since the sample before where that is reported.
        rank: (m,) of the conditions.
        reads_position: (m,) which of them do.
        along: (x (j, n), t (j,)) → (j, m) the h's elsewhere.
    """
    strict, second = rank == 1, rank == 2
    position = strict & reads_position
    return Truth(
        x, time, float(h[position].min()), float(h[strict & ~position].min(initial=np.inf)),
        float(h[second].min(initial=np.inf)), position, lambda x, t: along(x, t)[:, position],
    )  # fmt: skip


def truth_of(env: Any) -> Callable[[Sample], Truth]:
    """Return what reads the truth of an environment of this package, unwrapped."""

    def look(sample: Sample) -> Truth:
        x, time, scene = env.truth, float(env.time), env.barrier_set
        h = np.minimum(sample.info["min_h"], scene.values(x[None], np.array([time]))[0])
        rank = np.array([b.priority for b in env.barriers])
        reads = np.array([b.reads_position for b in env.barriers])
        return truth(x, time, h, rank, reads, scene.along)

    return look


def judge(
    observed: Iterable[Sample],
    look: Callable[[Sample], Truth],
    model: ReducedOrderModel,
    input_set: InputSet,
) -> Outcome:
    """Return what the truth and the filter's reports show of an episode.

    Args:
        observed: its samples, from the reset on.
        look: reads the truth behind the newest sample.
        model: of the plant.
        input_set: U.
    """
    following = iter(observed)
    sample = next(following)
    now = look(sample)
    first_h, body = now.h, _body_h(sample, now)
    least = np.array([now.h, now.speed_h, now.second_h, body])
    counts = np.zeros(len(FilterStatus), dtype=np.int64)
    margins, changed, pressed = [], False, False
    for sample in following:
        before, now = now, look(sample)
        report = sample.info["safety_filter"]
        least = np.minimum(least, [now.h, now.speed_h, now.second_h, _body_h(sample, now)])
        counts[int(report["status"])] += 1
        margins.append(report["margin"][now.position].max())
        changed = changed or bool(report["intervention"] > 1e-3)
        pressed = pressed or vacuity.prevents_entry(
            model, input_set, before.x, before.time, before.along, report
        )
    info = sample.info
    least_h, speed_h, second_h, body_h = least.tolist()
    return Outcome(
        least_h=least_h,
        least_speed_h=speed_h,
        least_second_h=second_h,
        least_body_h=body_h,
        first_h=first_h,
        fell=bool(info.get("fallen", 0.0)),
        reached=bool(sample.terminated) and bool(info.get("is_success", 0.0)),
        seconds=now.time,
        steps=int(counts.sum()),
        qp_failures=int(info.get("qp_failures", 0)),
        status_counts=counts.tolist(),
        median_margin=float(np.median(margins)),
        changed=changed,
        pressed=pressed,
        alarm=alarm_of(info),
    )


def _body_h(sample: Sample, now: Truth) -> float:
    """Return the least strict h of the robot's body; infinite for a point."""
    body = sample.info.get("min_body_h")
    return np.inf if body is None else float(np.min(body[now.position]))


def reserving(plant: Plant, uncertainty: Uncertainty) -> Plant:
    """Return a plant whose rows reserve other margins, but for its body's."""
    return replace(plant, uncertainty=uncertainty._replace(body=plant.uncertainty.body))


def alarm_of(info: Info) -> int:
    """Return the `Reason` of an alarm in a filter's report; 0 for none."""
    reason = int(info["safety_filter"]["reason"])
    return reason if FIRST_ALARM <= reason != Reason.UNVERIFIED else 0


def _error(env: Any) -> tuple[float, float]:
    """Return the squared error of an estimated position [m²], and the NEES."""
    estimate = env.estimate
    error = estimate.model + estimate.lag - env.truth  # the body's estimate beside the body
    nees = error @ np.linalg.solve(estimate.covariance, error)
    return float(error[:2] @ error[:2]), float(nees)


def _consistency(errors: Sequence[tuple[float, float]]) -> dict[str, Any]:
    """Return the fields of an outcome about an estimator; none where there was none."""
    if not errors:
        return {}
    position, nees = np.array(errors).T
    inside = (nees >= CONSISTENT[0]) & (nees <= CONSISTENT[1])
    return {
        "position_error": float(np.sqrt(position.mean())),
        "nees": float(nees.mean()),
        "nees_inside": float(inside.mean()),
    }
