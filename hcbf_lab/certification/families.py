"""Families of episodes: from a seed to one attacked episode, with shares of scenes and policies."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from hcbf_gym import loading, policies, records, scenarios
from hcbf_gym.errors import (
    CoverageWarning,
    InvalidInputError,
    UnknownNameError,
    choose,
    finite_float,
)
from hcbf_gym.evaluation import environments
from hcbf_gym.evaluation.attacked import AttackedEpisode
from hcbf_gym.evaluation.attacks import ATTACKS, ON_ANY_MODEL
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.policies import learned
from hcbf_lab.certification import own
from hcbf_lab.certification.exact_path import EachMillisecond
from hcbf_lab.certification.mixture import SCENES, A1Mixture

STREAM = 41  # sets a family's draws apart from those that the environment makes with the same seed
GUIDED = " guided"  # what ends the name of a policy that has guidance in the filter
SEARCHED = "searched"
"""The attack with parameters, which a search sets; it belongs to no certificate."""

_MEANS = {
    "rows": "on its default rows",
    "gatekeeper": "with verified manoeuvres for strict conditions",
}
"""What satisfies a filter's strict conditions, in words."""

Shares = tuple[tuple[str, float], ...]


Episode = AttackedEpisode | own.OwnEpisode


class Seen(NamedTuple):
    """What one episode showed, as far as a certificate reads it."""

    policy: str  # its name
    scene: str  # the family of its scene
    least_h: float  # of the strict conditions on the position, or of the body's [unit of h]
    least_speed_h: float  # of a strict speed limit [m/s]; infinite where there is none
    first_h: float  # least strict h at the reset
    fell: bool  # whether the robot fell
    alarm: int = 0  # the last `Reason` that was an alarm; 0 for none
    steps: int = 0  # how many it took
    pressed: bool = False  # whether the filter had to change an input that would have entered

    @property
    def entered(self) -> bool:
        """Whether a condition of rank 1 was broken."""
        return not (self.least_h >= 0.0 and self.least_speed_h >= 0.0)


HOSTILE = tuple((name, 1.0) for name in ATTACKS)  # every attack alike
FRIENDLY = (("pd", 1.0), ("pd guided", 1.0), *((name, 0.5) for name in learned.names()))
"""Policies that want to arrive."""


@dataclass(frozen=True)
class SceneFamily:
    """Attacked episodes of one of this package's environments in random scenes."""

    env: str  # its id
    options: Mapping[str, Any] = field(default_factory=dict)  # further arguments of it
    # families of scenes, with the weight of each
    scenes: Shares = tuple((name, 1.0) for name in SCENES)
    policies: Shares = (*HOSTILE, *FRIENDLY)  # attacks and policies, with the weight of each
    # least and greatest strict cap on the speed [m/s]: in a third of the episodes each of the two,
    # else one between them; None for the scene's own
    caps: tuple[float, float] | None = None
    steps: int = 1000  # the most that an episode takes
    program: str = "lex-cbf-qp"  # of the filter
    strict: str = "rows"  # what satisfies the filter's strict conditions

    def __post_init__(self) -> None:
        object.__setattr__(self, "scenes", _shares("scenes", self.scenes))
        object.__setattr__(self, "policies", _shares("policies", self.policies))
        for name, _ in self.scenes:
            if scenarios.family_of(name) is None:
                raise UnknownNameError(
                    f"unknown family of scenes: got {name!r}, expected one of "
                    f"{scenarios.families()}, or file.py:name or module:name of your own"
                )
        if self.caps is not None:
            low, high = (finite_float("caps", cap, minimum=0.0) for cap in self.caps)
            if low > high:
                raise InvalidInputError(f"caps: got {low} to {high} m/s, expected a range")
            object.__setattr__(self, "caps", (low, high))

    def episode(self, seed: int) -> AttackedEpisode:
        """Return the episode that a seed decides."""
        rng = np.random.default_rng([STREAM, seed])
        policy, scene = _drawn(rng, self.policies), _drawn(rng, self.scenes)
        options = {"max_episode_steps": self.steps} | dict(self.options)
        if self.caps is not None:
            low, high = self.caps
            options["v_max"] = (low, high, float(rng.uniform(low, high)))[rng.integers(3)]
        guidance = {"guidance": "geodesic"} if policy.endswith(GUIDED) else {}
        return AttackedEpisode(
            policy.removesuffix(GUIDED), scene, seed, self.env, options,
            {"program": self.program, "strict": self.strict} | guidance,
            inside=EachMillisecond if self._exact else None,
        )  # fmt: skip

    @property
    def _exact(self) -> bool:
        """Whether the robot is its model, so that its path between two samples is known."""
        return self.env == "HCBF-Regions-v0"

    def certifies(self, declared: Mapping[str, object]) -> dict[str, Any]:
        """Return what a plant must declare to be the one of these episodes."""
        scenes = [family.identity for family in self._families]
        wanted = dict(declared) | {"scene": {"any of": scenes}}
        if self.caps is not None:
            wanted["v_max"] = {"from": self.caps[0], "to": self.caps[1]}
        return wanted

    @property
    def words(self) -> tuple[str, ...]:
        """What it is, in sentences."""
        options = ", ".join(f"{k}={v!r}" for k, v in self.options.items())
        looks = "millisecond" if self._exact else "physics step"
        cap = "each scene's own cap on the speed"
        if self.caps is not None:
            low, high = self.caps
            cap = f"a cap on the speed of {low:g}, of {high:g}, or between them [m/s]"
        return (
            f"The environment is {self.env}{f' with {options}' if options else ''}, with {cap}.",
            f"Scenes: {_listed(self.scenes)}; each seed draws another one.",
            f"Policies: {_listed(self.policies)}.",
            f"The filter runs {self.program} {_MEANS[self.strict]}, at most {self.steps} steps.",
            f"Entered is what the truth shows at every {looks}, of every condition of rank 1, the "
            "speed limit included.",
        )

    @property
    def files(self) -> list[Path]:
        """The user's files that decide the episodes."""
        robot = environments.known()[self.env].files(self.options)
        scenes = [file for family in self._families for file in family.files]
        return robot + scenes + _files_of(self.policies)

    @property
    def _families(self) -> list[scenarios.Family]:
        """The families of its scenes."""
        found = (scenarios.family_of(name) for name, _ in self.scenes)
        return [family for family in found if family is not None]


def policies_in(env: str, options: Mapping[str, Any], scenes: Sequence[str]) -> Shares:
    """Return all policies that can act in scenes: a learned one fits observations of one shape."""
    able = set(learned.names())
    for scene in scenes:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CoverageWarning)  # it is not the question
            made = gym.make(env, scenario=scene, **options)
        able &= set(learned.fitting(made))
        made.close()
    fits = able | {name for name, _ in FRIENDLY} - set(learned.names())
    return (*HOSTILE, *((name, weight) for name, weight in FRIENDLY if name in fits))


@dataclass(frozen=True)
class OwnFamily:
    """Attacked episodes of a user's own environment and plant."""

    source: str  # ``module:function`` or ``file.py:function`` that returns (environment, plant)
    # of `attacks.ON_ANY_MODEL`, or the user's own, with the weight of each
    policies: Shares = tuple((name, 1.0) for name in ON_ANY_MODEL)
    steps: int = 500  # the most that an episode takes
    program: str = "lex-cbf-qp"  # of the filter
    strict: str = "rows"  # what satisfies the filter's strict conditions

    def __post_init__(self) -> None:
        object.__setattr__(self, "policies", _shares("policies", self.policies))
        for name, _ in self.policies:
            if not policies.is_own(name):
                choose("policy", name, ON_ANY_MODEL)

    def episode(self, seed: int) -> own.OwnEpisode:
        """Return the episode that a seed decides."""
        policy = _drawn(np.random.default_rng([STREAM, seed]), self.policies)
        options = {"program": self.program, "strict": self.strict}
        return own.OwnEpisode(self.source, policy, seed, self.steps, options)

    def certifies(self, declared: Mapping[str, object]) -> dict[str, Any]:
        """Return what a plant must declare to be the one of these episodes."""
        return dict(declared)

    @property
    def words(self) -> tuple[str, ...]:
        """What it is, in sentences."""
        return (
            f"Environment and plant are what {self.source} returns.",
            "Scenes and starts are what the environment draws with each seed.",
            f"Policies: {_listed(self.policies)}.",
            f"The filter runs {self.program} {_MEANS[self.strict]}, at most {self.steps} steps.",
            "Entered is what the plant's strict barriers say of its state at every step, or the "
            "infos' min_h where the environment reports less.",
        )

    @property
    def files(self) -> list[Path]:
        """The user's files that decide the episodes."""
        return loading.files(self.source) + _files_of(self.policies)


ROUNDING = 1e-9  # by how much the sum of shares may miss 1
KINDS: dict[str, type] = {"scenes": SceneFamily, "own": OwnFamily, "a1-mixture": A1Mixture}
"""kind → family, as a certificate's JSON names it."""


Family = SceneFamily | OwnFamily | A1Mixture


def run_seed(family: Family, margins: Uncertainty | None, seed: int) -> Seen:
    """Run the episode of a seed, with the plant's own margins for None."""
    return _run(family.episode(seed), margins)


def run_searched(
    family: Family, margins: Uncertainty, searched: tuple[int, tuple[float, ...]]
) -> Seen:
    """Run the episode of a seed with the attacker that a search tries: (seed, its parameters)."""
    seed, parameters = searched
    return _run(replace(family.episode(seed), attack=SEARCHED, parameters=parameters), margins)


def _run(episode: Episode, margins: Uncertainty | None) -> Seen:
    """Run an episode, and keep what a certificate reads of it."""
    if margins is not None:
        episode = replace(episode, uncertainty=margins)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it is not covered yet; alarms are in the outcome
        outcome = episode.run()
    body = outcome.least_body_h
    return Seen(
        *stratum_of(episode), outcome.least_h if np.isinf(body) else body, outcome.least_speed_h,
        outcome.first_h, outcome.fell, outcome.alarm, outcome.steps, outcome.pressed,
    )  # fmt: skip


def stratum_of(episode: Episode) -> tuple[str, str]:
    """Return an episode's policy, and the family of its scene."""
    guided = "guidance" in (episode.filter_options or {})
    scene = episode.scenario
    name = str(scene["name"]) if isinstance(scene, Mapping) else str(scene)
    return episode.attack + GUIDED * guided, name


def to_dict(family: Family) -> dict[str, object]:
    """Return a family in JSON's terms."""
    return records.to_dict(family, KINDS)


def from_dict(data: Mapping[str, object]) -> Family:
    """Return the family that `to_dict` made this of."""
    return records.from_dict("family", data, KINDS)


def _shares(what: str, given: Sequence[Sequence[Any]]) -> Shares:
    """Return names with their shares, which sum to 1."""
    pairs = [(str(name), finite_float(f"{what}: {name}", w, minimum=0.0)) for name, w in given]
    total = sum(weight for _, weight in pairs)
    if total <= 0.0:
        raise InvalidInputError(f"{what}: got {given!r}, expected names with positive weights")
    if abs(total - 1.0) <= ROUNDING:  # they are shares, and come back from a file as they are
        return tuple(pairs)
    return tuple((name, weight / total) for name, weight in pairs)


def _files_of(shares: Shares) -> list[Path]:
    """Return the files of the policies that are the user's own."""
    return [file for name, _ in shares for file in policies.files(name.removesuffix(GUIDED))]


def _drawn(rng: np.random.Generator, shares: Shares) -> str:
    names, weights = zip(*shares, strict=True)
    return str(names[int(rng.choice(len(names), p=weights))])


def _listed(shares: Shares) -> str:
    return ", ".join(f"{name} {share:.1%}" for name, share in shares)
