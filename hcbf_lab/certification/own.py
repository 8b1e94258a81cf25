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
from hcbf_gym.evaluation.own_environment import least_reported, make, reading
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Plant, Uncertainty

CORNERS = 64
"""The most corners of U of which an attacker predicts the outcome."""
AHEAD = 0.3
"""How far an attacker predicts [s]."""
HELD = 0.04
"""How long an attacker keeps to what it has decided [s]: predicting takes time."""


@dataclass(frozen=True)
class OwnEpisode:
    """What to run."""

    source: str  # as `make` takes it
    # one of `attacks.ON_ANY_MODEL`, "searched" with parameters, or a policy as `policies.make`
    # takes it
    attack: str
    seed: int  # of the environment and the attack
    steps: int  # the most that it takes
    filter_options: Mapping[str, Any] | None = None  # arguments of `SafetyFilter`
    # of the searched attacker, as `attacks.Searched` takes them
    parameters: tuple[float, ...] | None = None
    uncertainty: Uncertainty | None = None  # what rows reserve; None is the plant's own
    scenario: str = "own"  # the name of the scenes in counts, which the environment draws

    def run(self) -> Outcome:
        """Run the episode to its end; a start counts in its least h where it is inside alone.

        Raises:
            InvalidInputError: if the function returns anything else, or there is no strict barrier.
        """
        env, plant = make(self.source)
        if self.uncertainty is not None:
            plant = reserving(plant, self.uncertainty)
        options: dict[str, Any] = {"program": "lex-cbf-qp"} | dict(self.filter_options or {})
        filtered = wrappers.SafetyFilter(env, plant=plant, **options)
        input_set = plant.input_set or filtered.input_set
        view = Foresight(self.source, plant, env.unwrapped, input_set)
        act = self._act(plant, view, filtered)
        try:
            observed = itertools.islice(samples(filtered, act, self.seed), self.steps + 1)
            outcome = judge(observed, view.look, plant.model, input_set)
        finally:
            filtered.close()
        vacuity.check_jumps(self.source, view.path, view.expected)
        return replace(outcome, first_h=view.first_h)

    def _act(self, plant: Plant, view: "Foresight", filtered: wrappers.SafetyFilter) -> Act:
        if self.parameters is None and not attacks.is_attack(self.attack):
            return policies.make(self.attack, filtered)
        attack = attacks.make(self.attack, self.seed, self.parameters)

        def act(observation: Any, info: Info) -> Any:
            u = attack.act(view)
            return u if plant.to_action is None else plant.to_action(u)

        return act


class Foresight:
    """What an attacker sees of any plant, an `attacks.View`: it predicts h by the model.

    Args:
        source: of the plant, for errors.
        plant: as the filter knows it.
        env: unwrapped.
        input_set: U.

    Attributes:
        path: of each sample (k,) the strict h's on the position.
        expected: of each step (k,) where the model would have taken them.
        first_h: the least of them at the reset, or what the environment reports of it.
    """

    def __init__(self, source: str, plant: Plant, env: Any, input_set: InputSet):
        self._source, self._plant, self._env = source, plant, env
        self._placing = Placing(1)
        every = input_set.vertices()
        self.corners: Array = every[:: -(-len(every) // CORNERS)]
        self.path: list[Array] = []
        self.expected: list[Array] = []
        self._now: Truth | None = None
        self._until, self._weights, self._best = -np.inf, (0.0, 0.0), self.corners[0]

    @property
    def now(self) -> Truth:
        """The newest truth."""
        assert self._now is not None
        return self._now

    @property
    def time(self) -> float:
        """Of the newest truth [s]."""
        return self.now.time

    def look(self, sample: Sample) -> Truth:
        """Read the truth behind a sample.

        Raises:
            InvalidInputError: if the number of barriers changes, or none is strict.
        """
        counted = len(self.path) * (self._plant.period or 0.0)
        found = _truth(self._plant, self._env, sample, counted, self._placing)
        h = found.along(found.x[None], np.array([found.time]))[0]
        if not self.path:
            self.first_h = found.h
            found = found._replace(**{
                name: least if (least := getattr(found, name)) < 0.0 else np.inf
                for name in ("h", "speed_h", "second_h")
            })  # fmt: skip
        elif len(h) != len(self.path[-1]):
            raise InvalidInputError(
                f"{self._source}: got {len(h)} strict barriers after {len(self.path[-1])}, "
                "expected their number to stay"
            )
        elif self._plant.period is not None:
            u = sample.info["safety_filter"]["u_safe"]
            there = self._plant.model.step(self.now.x, u, self._plant.period)
            self.expected.append(found.along(there[None], np.array([found.time]))[0])
        self.path.append(h)
        self._now = found
        return found

    def corner(self, rng: np.random.Generator) -> Array:
        """Return a random corner of U (n_u,)."""
        return rng.choice(self.corners)

    def push(
        self, nearest: float, second: float = 0.0, sideways: float = 0.0, speed: float = 0.0
    ) -> Array:
        """Return the corner of U that lowers nearest·h₁ + second·h₂ the most, `AHEAD` later.

        `sideways` and `speed` are not read: no edge is known of any model.
        """
        if self.time >= self._until or (nearest, second) != self._weights:
            now, model = self.now, self._plant.model
            x = np.array([model.step(now.x, u, AHEAD) for u in self.corners])
            h = np.sort(now.along(x, np.full(len(x), now.time + AHEAD)), axis=1)
            value = nearest * h[:, 0] + second * h[:, min(1, h.shape[1] - 1)]
            self._until, self._weights = self.time + HELD, (nearest, second)
            self._best = self.corners[int(value.argmin())]
        return self._best


def _truth(plant: Plant, env: Any, sample: Sample, counted: float, placing: Placing) -> Truth:
    """Return what a plant's readers return, and the infos' min_h where that is less."""
    now = reading(plant, env, sample, counted, placing)
    rank = np.array([condition.rank for condition in now.conditions], dtype=np.int64)
    if not ((rank == 1) & now.reads_position).any():
        raise InvalidInputError(
            f"certify: got {len(rank)} barriers and none of priority 1 on the state, "
            "expected at least one"
        )
    h = now.h
    if "min_h" in sample.info:
        h = np.minimum(h, least_reported(sample.info["min_h"], len(rank)))
    h = np.where(np.isfinite(h), h, -np.inf)
    return truth(now.x, now.time, h, rank, now.reads_position, now.along)
