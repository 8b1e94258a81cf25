"""Attacked episodes of a user's own environment, whatever its model is."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hcbf_gym import policies, wrappers
from hcbf_gym.arrays import Array, Info
from hcbf_gym.barriers.placing import Placing
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.evaluation import attacks, vacuity
from hcbf_gym.evaluation.attacked import Outcome, Truth, judge, reserving, truth
from hcbf_gym.evaluation.episode import Act, Sample, samples
from hcbf_gym.evaluation.own_environment import make
from hcbf_gym.evaluation.plant_reading import read_plant, reported_min_h
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Plant, Uncertainty

MAX_CORNERS = 64  # an attacker predicts the effect of at most so many corners of U
PREDICTION_TIME = 0.3  # how far ahead an attacker predicts [s]
DECISION_PERIOD = 0.04  # how long an attacker holds an input [s], because predicting takes time


@dataclass(frozen=True)
class OwnEpisode:
    """An episode of a user's own environment, which an attack or a policy drives."""

    source: str  # of environment and plant, as `own_environment.make` takes it
    # one of `attacks.ON_ANY_MODEL`, "searched" with parameters, or a policy as `policies.make`
    # takes it
    attack: str
    seed: int  # of the environment and of the attack
    steps: int  # the greatest number of control steps
    filter_options: Mapping[str, Any] | None = None  # arguments of `SafetyFilter`
    # of the searched attacker, as `attacks.Searched` takes them
    parameters: tuple[float, ...] | None = None
    uncertainty: Uncertainty | None = None  # the rows' margins; None takes the plant's own
    scenario: str = "own"  # the name under which the environment's scenes are counted

    def run(self) -> Outcome:
        """Run the episode to its end.

        The state at the reset counts in the outcome's least h only if it is inside a region.

        Raises:
            InvalidInputError: if the source does not return an environment and its plant, or the
                plant has no strict barrier.
        """
        env, plant = make(self.source)
        if self.uncertainty is not None:
            plant = reserving(plant, self.uncertainty)
        options: dict[str, Any] = {"program": "lex-cbf-qp"} | dict(self.filter_options or {})
        filtered = wrappers.SafetyFilter(env, plant=plant, **options)
        input_set = plant.input_set or filtered.input_set
        view = PredictiveView(self.source, plant, env.unwrapped, input_set)
        act = self._act(plant, view, filtered)
        try:
            observed = itertools.islice(samples(filtered, act, self.seed), self.steps + 1)
            outcome = judge(observed, view.look, plant.model, input_set)
        finally:
            filtered.close()
        vacuity.check_jumps(self.source, view.observed_h, view.predicted_h)
        return replace(outcome, first_h=view.first_h)

    def _act(self, plant: Plant, view: "PredictiveView", filtered: wrappers.SafetyFilter) -> Act:
        """Return (observation, info) → action, of the policy or of the attack."""
        if self.parameters is None and not attacks.is_attack(self.attack):
            return policies.make(self.attack, filtered)
        attack = attacks.make(self.attack, self.seed, self.parameters)

        def act(observation: Any, info: Info) -> Any:
            u = attack.act(view)
            return u if plant.to_action is None else plant.to_action(u)

        return act


class PredictiveView:
    """An `attacks.View` of any plant, which predicts the strict h's on the position by its model.

    Args:
        source: of environment and plant, for errors.
        plant: with the readers of state and barriers.
        env: the unwrapped environment.
        input_set: U.

    Attributes:
        observed_h: (k,) the strict h's on the position at each sample.
        predicted_h: (k,) the same after each step as the model predicts it.
        first_h: the least of them at the reset, or less if the environment reports less.
    """

    def __init__(self, source: str, plant: Plant, env: Any, input_set: InputSet):
        self._source, self._plant, self._env = source, plant, env
        self._placing = Placing(1)
        vertices = input_set.vertices()
        stride = -(-len(vertices) // MAX_CORNERS)  # rounded up
        self.corners: Array = vertices[::stride]
        self.observed_h: list[Array] = []
        self.predicted_h: list[Array] = []
        self._now: Truth | None = None
        self._held_until = -np.inf
        self._held_weights = (0.0, 0.0)
        self._held_corner = self.corners[0]

    @property
    def now(self) -> Truth:
        """The newest truth."""
        assert self._now is not None
        return self._now

    @property
    def time(self) -> float:
        """The time of the newest truth [s]."""
        return self.now.time

    def look(self, sample: Sample) -> Truth:
        """Return the truth at a sample, and record the h's that it shows.

        Raises:
            InvalidInputError: if the number of strict barriers changes, or none is strict.
        """
        elapsed = len(self.observed_h) * (self._plant.period or 0.0)
        newest = _truth(self._plant, self._env, sample, elapsed, self._placing)
        h = newest.along(newest.x[None], np.array([newest.time]))[0]
        if not self.observed_h:
            self.first_h = newest.h
            newest = newest._replace(
                h=_infinite_outside(newest.h),
                speed_h=_infinite_outside(newest.speed_h),
                second_h=_infinite_outside(newest.second_h),
            )
        elif len(h) != len(self.observed_h[-1]):
            raise InvalidInputError(
                f"{self._source}: got {len(h)} strict barriers after {len(self.observed_h[-1])}, "
                "expected their number to stay"
            )
        elif self._plant.period is not None:
            u = sample.info["safety_filter"]["u_safe"]
            predicted_x = self._plant.model.step(self.now.x, u, self._plant.period)
            self.predicted_h.append(newest.along(predicted_x[None], np.array([newest.time]))[0])
        self.observed_h.append(h)
        self._now = newest
        return newest

    def corner(self, rng: np.random.Generator) -> Array:
        """Return a random corner of U (n_u,)."""
        return rng.choice(self.corners)

    def push(
        self, nearest: float, second: float = 0.0, sideways: float = 0.0, speed: float = 0.0
    ) -> Array:
        """Return the corner of U (n_u,) that lowers nearest·h₁ + second·h₂ the most.

        h is predicted over `PREDICTION_TIME`, and the corner is held for `DECISION_PERIOD`.
        `sideways` and `speed` have no effect, because a general model has no known edge.
        """
        if self.time >= self._held_until or (nearest, second) != self._held_weights:
            now, model = self.now, self._plant.model
            x = np.array([model.step(now.x, u, PREDICTION_TIME) for u in self.corners])
            h = np.sort(now.along(x, np.full(len(x), now.time + PREDICTION_TIME)), axis=1)
            second_h = h[:, min(1, h.shape[1] - 1)]
            value = nearest * h[:, 0] + second * second_h
            self._held_until = self.time + DECISION_PERIOD
            self._held_weights = nearest, second
            self._held_corner = self.corners[int(value.argmin())]
        return self._held_corner


def _infinite_outside(h: float) -> float:
    """Return h if it is negative, else infinity, which never becomes an episode's least h."""
    return h if h < 0.0 else np.inf


def _truth(plant: Plant, env: Any, sample: Sample, elapsed: float, placing: Placing) -> Truth:
    """Return the truth at a sample by the plant's readers, with the infos' min_h if it is less.

    Raises:
        InvalidInputError: if no strict barrier reads the position.
    """
    now = read_plant(plant, env, sample, elapsed, placing)
    rank = np.array([condition.rank for condition in now.conditions], dtype=np.int64)
    if not ((rank == 1) & now.reads_position).any():
        raise InvalidInputError(
            f"certify: got {len(rank)} barriers and none of priority 1 on the state, "
            "expected at least one"
        )
    h = now.h
    if "min_h" in sample.info:
        h = np.minimum(h, reported_min_h(sample.info["min_h"], len(rank)))
    h = np.where(np.isfinite(h), h, -np.inf)  # an h that is not finite counts as entered
    return truth(now.x, now.time, h, rank, now.reads_position, now.evaluate_at)
