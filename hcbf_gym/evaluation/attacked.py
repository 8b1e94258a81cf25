"""One attacked episode, and its outcome for rank 1, judged by the true state."""

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
"""The band that holds 95 % of the NEES of an estimator whose covariance is right.

The NEES, the normalised estimation error squared, is eᵀP⁻¹e at one instant, where e is the error
of position and velocity (4,) and P the estimator's covariance of it."""
_CHANGED_INPUT = 1e-3  # ‖u − u*‖ above which a step counts as changed by the filter [m/s²]


@dataclass(frozen=True)
class AttackedEpisode:
    """An episode of an environment of this package, driven by an attack or a policy."""

    attack: str  # the name of an attack as in `attacks.make`, or of a policy as in `policies.make`
    scenario: Any  # a name, or a scene as a dict
    seed: int  # seeds the environment and the attack
    env: str = "HCBF-A1Regions-v0"  # the id of an environment of this package
    env_options: Mapping[str, Any] | None = None  # further arguments of the environment
    filter_options: Mapping[str, Any] | None = None  # arguments of `SafetyFilter`
    parameters: tuple[float, ...] | None = None  # of the attack; None takes its default ones
    inside: Callable[[gym.Env], gym.Env] | None = None  # wraps the environment below the filter
    uncertainty: Uncertainty | None = None  # decides the rows' margins; None takes the plant's

    def run(self) -> "Outcome":
        """Run the episode to its end, and return its outcome."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LoweredWarning)
            plugins.load()  # which may register the environment
            env = gym.make(self.env, scenario=self.scenario, **(self.env_options or {}))
        if self.inside is not None:
            env = self.inside(env)
        options: dict[str, Any] = {"program": "lex-cbf-qp"} | dict(self.filter_options or {})
        if self.uncertainty is not None:
            plant: Plant = env.unwrapped.plant  # type: ignore[attr-defined]
            options["plant"] = reserving(plant, self.uncertainty)
        env = wrappers.SafetyFilter(env, **options)
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                outcome = self._run_filtered(env)
            warned = any("does not apply" in str(warning.message) for warning in caught)
            return replace(outcome, warned=warned)
        finally:
            env.close()

    def _run_filtered(self, env: gym.Env) -> "Outcome":
        """Run the episode; collect the estimator's errors and the body's reach after each step."""
        inner: Any = env.unwrapped
        act = policy_of(self.attack, env, self.seed, self.parameters)
        errors: list[EstimationError] = []
        reaches = [0.0]

        def watched_samples() -> Iterator[Sample]:
            episode = samples(env, act, self.seed)
            reset = next(episode)
            footprint = None
            if "min_body_h" in reset.info:  # the whole body has to stay outside
                footprint = Footprint(inner.model, inner.model.body(1).name)
            yield reset
            for sample in episode:
                if inner.estimate.covariance is not None:
                    errors.append(_estimation_error(inner))
                if footprint is not None:
                    reaches.append(footprint.reach(inner.data))
                yield sample

        plant = inner.plant
        outcome = judge(watched_samples(), truth_of(inner), plant.model, plant.input_set)
        return replace(outcome, reach=max(reaches), **_consistency(errors))


def policy_of(
    name: str, env: gym.Env, seed: int, parameters: tuple[float, ...] | None = None
) -> Act:
    """Return the policy or the attack of a name, as (observation, info) → u* (2,) [m/s²].

    An attack ignores the observation: it observes the true state of the environment.

    Raises:
        UnknownNameError: if there is neither an attack nor a policy of that name.
    """
    if parameters is None and not attacks.is_attack(name):
        return in_double(policies.make(name, env))
    attack = attacks.make(name, seed, parameters)
    return lambda observation, info: attack.act(attacks.observe(env))


@dataclass(frozen=True)
class Outcome:
    """The outcome of one episode. Each h is of the true state, the least over all physics steps."""

    least_h: float  # least h of the strict barriers on the position [m, or the unit of h]
    least_speed_h: float = np.inf  # of the strict speed limit [m/s]; infinite where there is none
    least_second_h: float = np.inf  # of the barriers of priority 2 [m]
    least_body_h: float = np.inf  # of the strict barriers for the whole body [m]; else infinite
    first_h: float = np.inf  # least h of the strict barriers on the position, at the reset [m]
    fell: bool = False  # whether the robot fell, if its environment reports it
    reached: bool = False  # whether the robot reached the goal, if its environment reports it
    seconds: float = 0.0  # the episode's duration [s]
    steps: int = 0  # the number of its control steps
    qp_failures: int = 0  # task-space QPs without a solution
    status_counts: Sequence[int] = ()  # steps in each `FilterStatus`
    median_margin: float = 0.0  # over steps, of the largest margin of a strict position row [m]
    changed: bool = False  # whether the filter changed an input
    pressed: bool = False  # whether it prevented an entry, see `vacuity.prevents_entry`
    alarm: int = 0  # the `Reason` at the end, if it is an alarm; 0 for none
    warned: bool = False  # whether the filter warned that the environment does not apply its input
    reach: float = 0.0  # the greatest horizontal distance of the body from the trunk's centre [m]
    position_error: float | None = None  # RMS error of the estimate [m]; None if the state is known
    nees: float | None = None  # the mean NEES; 4 for an estimator of the right covariance
    nees_inside: float | None = None  # share of the instants at which the NEES is in `CONSISTENT`


class Truth(NamedTuple):
    """The true state of a plant with m ranked conditions at one sample.

    Each h is the least since the sample before, if that is reported; infinite for no condition.
    """

    x: Array  # (n,) the state
    time: float  # [s]
    h: float  # least h of the strict conditions on the position
    speed_h: float  # least h of the other strict conditions
    second_h: float  # least h of the conditions of priority 2
    position: Mask  # (m,) which conditions are strict and read the position
    along: vacuity.Strict  # (x (j, n), t (j,)) → (j, k) h of those k conditions at j other states


def truth(
    x: Array, time: float, h: Array, rank: Integers, reads_position: Mask, along: vacuity.Strict
) -> Truth:
    """Return the truth at one sample.

    Args:
        x: (n,) the state.
        time: the time of that state [s].
        h: (m,) of each condition, the least since the sample before if that is reported.
        rank: (m,) the rank of each condition.
        reads_position: (m,) which conditions read the position.
        along: (x (j, n), t (j,)) → (j, m) h of all conditions at j other states.
    """
    is_strict = rank == 1
    position = is_strict & reads_position
    return Truth(
        x=x,
        time=time,
        h=float(h[position].min()),
        speed_h=float(h[is_strict & ~position].min(initial=np.inf)),
        second_h=float(h[rank == 2].min(initial=np.inf)),
        position=position,
        along=lambda x, t: along(x, t)[:, position],
    )


def truth_of(env: Any) -> Callable[[Sample], Truth]:
    """Return a function that reads the truth of an unwrapped environment of this package."""

    def read_truth(sample: Sample) -> Truth:
        x, time, scene = env.truth, float(env.time), env.barrier_set
        h = np.minimum(sample.info["min_h"], scene.values(x[None], np.array([time]))[0])
        rank = np.array([barrier.priority for barrier in env.barriers])
        reads_position = np.array([barrier.reads_position for barrier in env.barriers])
        return truth(x, time, h, rank, reads_position, scene.along)

    return read_truth


def judge(
    observed: Iterable[Sample],
    read_truth: Callable[[Sample], Truth],
    model: ReducedOrderModel,
    input_set: InputSet,
) -> Outcome:
    """Return the outcome of an episode, from the truth and the filter's reports.

    Args:
        observed: the episode's samples, from the reset on.
        read_truth: returns the truth at the newest sample.
        model: the plant's reduced-order model.
        input_set: U, the set of the plant's inputs.
    """
    remaining = iter(observed)
    sample = next(remaining)
    current = read_truth(sample)
    first_h = current.h
    least = _h_to_judge(sample, current)
    counts = np.zeros(len(FilterStatus), dtype=np.int64)
    margins: list[float] = []
    changed = pressed = False
    for sample in remaining:
        previous, current = current, read_truth(sample)
        report = sample.info["safety_filter"]
        least = np.minimum(least, _h_to_judge(sample, current))
        counts[int(report["status"])] += 1
        margins.append(report["margin"][current.position].max())
        changed = changed or bool(report["intervention"] > _CHANGED_INPUT)
        pressed = pressed or vacuity.prevents_entry(
            model, input_set, previous.x, previous.time, previous.along, report
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
        seconds=current.time,
        steps=int(counts.sum()),
        qp_failures=int(info.get("qp_failures", 0)),
        status_counts=counts.tolist(),
        median_margin=float(np.median(margins)),
        changed=changed,
        pressed=pressed,
        alarm=alarm_of(info),
    )


def _h_to_judge(sample: Sample, current: Truth) -> Array:
    """Return the least h on position, speed, of rank 2 and of the body; infinite where none is."""
    body = sample.info.get("min_body_h")
    body_h = np.inf if body is None else float(np.min(body[current.position]))
    return np.array([current.h, current.speed_h, current.second_h, body_h])


def reserving(plant: Plant, uncertainty: Uncertainty) -> Plant:
    """Return the plant with another uncertainty, in which its body's extent remains."""
    return replace(plant, uncertainty=uncertainty._replace(body=plant.uncertainty.body))


def alarm_of(info: Info) -> int:
    """Return the `Reason` of an alarm in a filter's report; 0 for none."""
    reason = int(info["safety_filter"]["reason"])
    return reason if FIRST_ALARM <= reason != Reason.UNVERIFIED else 0


class EstimationError(NamedTuple):
    """The error of an estimated state at one instant."""

    position_squared: float  # [m²]
    nees: float  # of position and velocity


def _estimation_error(env: Any) -> EstimationError:
    """Return the error of an environment's estimate of its body's state."""
    estimate = env.estimate
    error = estimate.model + estimate.lag - env.truth
    nees = error @ np.linalg.solve(estimate.covariance, error)
    return EstimationError(float(error[:2] @ error[:2]), float(nees))


def _consistency(errors: Sequence[EstimationError]) -> dict[str, Any]:
    """Return the fields of `Outcome` about an estimator; none if there were no errors to read."""
    if not errors:
        return {}
    position, nees = np.array(errors).T
    inside = (nees >= CONSISTENT[0]) & (nees <= CONSISTENT[1])
    return {
        "position_error": float(np.sqrt(position.mean())),
        "nees": float(nees.mean()),
        "nees_inside": float(inside.mean()),
    }
