"""Families of attacked episodes, in which a seed decides the policy and the scene of an episode."""

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

STREAM = 41  # separates a family's draws from those of the environment with the same seed
GUIDED = " guided"  # the end of the name of a policy with guidance in the filter
SEARCHED = "searched"
"""The attack whose parameters a search sets. It belongs to no certificate."""
ROUNDING = 1e-9  # by which the sum of shares may miss 1

_STRICT_IN_WORDS = {
    "rows": "on its default rows",
    "gatekeeper": "with verified manoeuvres for strict conditions",
}

Shares = tuple[tuple[str, float], ...]
"""(name, share) of everything that may be drawn; the shares sum to 1."""

Episode = AttackedEpisode | own.OwnEpisode


class Seen(NamedTuple):
    """The part of an episode's outcome that a certificate needs."""

    policy: str  # its name, with `GUIDED` if the filter guided it
    scene: str  # the name of the family of its scene
    least_h: float  # of the strict conditions on the position, or of the body's [unit of h]
    least_speed_h: float  # of a strict speed limit [m/s]; infinite without a limit
    first_h: float  # the least strict h at the reset [unit of h]
    fell: bool  # whether the robot fell
    alarm: int = 0  # the last `Reason` that was an alarm; 0 for none
    steps: int = 0  # the number of control steps
    pressed: bool = False  # whether the filter changed an input that would have entered

    @property
    def entered(self) -> bool:
        """Whether a condition of rank 1 was violated; an h that is NaN counts as violated."""
        return not (self.least_h >= 0.0 and self.least_speed_h >= 0.0)


HOSTILE = tuple((name, 1.0) for name in ATTACKS)
"""The attacks, with equal weights."""
FRIENDLY = (("pd", 1.0), ("pd guided", 1.0), *((name, 0.5) for name in learned.names()))
"""The policies that lead to the goal, with their weights."""


@dataclass(frozen=True)
class SceneFamily:
    """Attacked episodes of one of this package's environments in random scenes; see `Family`."""

    env: str  # the environment's id
    options: Mapping[str, Any] = field(default_factory=dict)  # its further arguments
    # families of scenes, with the weight of each
    scenes: Shares = tuple((name, 1.0) for name in SCENES)
    policies: Shares = (*HOSTILE, *FRIENDLY)  # attacks and policies, with the weight of each
    # least and greatest strict cap on the speed [m/s]: a third of the episodes has the least, a
    # third the greatest, and the others one between them; None takes the scene's own
    caps: tuple[float, float] | None = None
    steps: int = 1000  # the greatest number of control steps of an episode
    program: str = "lex-cbf-qp"  # of the filter
    strict: str = "rows"  # the filter's method for strict conditions, see `_STRICT_IN_WORDS`

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
        """Return the episode of a seed."""
        rng = np.random.default_rng([STREAM, seed])
        policy, scene = _draw(rng, self.policies), _draw(rng, self.scenes)
        options = {"max_episode_steps": self.steps} | dict(self.options)
        if self.caps is not None:
            low, high = self.caps
            between = float(rng.uniform(low, high))
            options["v_max"] = (low, high, between)[rng.integers(3)]
        guidance = {"guidance": "geodesic"} if policy.endswith(GUIDED) else {}
        return AttackedEpisode(
            policy.removesuffix(GUIDED), scene, seed, self.env, env_options=options,
            filter_options={"program": self.program, "strict": self.strict} | guidance,
            inside=EachMillisecond if self._has_exact_path else None,
        )  # fmt: skip

    @property
    def _has_exact_path(self) -> bool:
        """Whether the robot is the model, whose path between two samples is known exactly."""
        return self.env == "HCBF-Regions-v0"

    def certifies(self, declared: Mapping[str, object]) -> dict[str, Any]:
        """Return the declaration that a certificate covers, from that of the first episode."""
        scenes = [family.identity for family in self._families]
        covered = dict(declared) | {"scene": {"any of": scenes}}
        if self.caps is not None:
            covered["v_max"] = {"from": self.caps[0], "to": self.caps[1]}
        return covered

    @property
    def words(self) -> tuple[str, ...]:
        """Sentences for the certificate's page that describe the episodes."""
        options = ", ".join(f"{name}={value!r}" for name, value in self.options.items())
        environment = f"{self.env} with {options}" if options else self.env
        instant = "millisecond" if self._has_exact_path else "physics step"
        cap = "each scene's own cap on the speed"
        if self.caps is not None:
            low, high = self.caps
            cap = f"a cap on the speed of {low:g}, of {high:g}, or between them [m/s]"
        return (
            f"The environment is {environment}, with {cap}.",
            f"Scenes: {_listed(self.scenes)}; each seed draws another one.",
            f"Policies: {_listed(self.policies)}.",
            _filter_sentence(self),
            f"Entered is what the truth shows at every {instant}, of every condition of rank 1, "
            "the speed limit included.",
        )

    @property
    def files(self) -> list[Path]:
        """The user's files of robot, scenes and policies, which decide the episodes."""
        robot = environments.known()[self.env].files(self.options)
        scenes = [file for family in self._families for file in family.files]
        return robot + scenes + _files_of(self.policies)

    @property
    def _families(self) -> list[scenarios.Family]:
        """The families of the scenes."""
        families = (scenarios.family_of(name) for name, _ in self.scenes)
        return [family for family in families if family is not None]


def policies_in(env: str, options: Mapping[str, Any], scenes: Sequence[str]) -> Shares:
    """Return all attacks, and those of `FRIENDLY` that can act in every one of these scenes.

    A learned policy fits observations of one shape only, which depends on the scene.
    """
    able = {name for name, _ in FRIENDLY}
    for scene in scenes:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CoverageWarning)  # only the observation is needed
            scene_env = gym.make(env, scenario=scene, **options)
        able -= set(learned.names()) - set(learned.fitting(scene_env))
        scene_env.close()
    return (*HOSTILE, *((name, weight) for name, weight in FRIENDLY if name in able))


@dataclass(frozen=True)
class OwnFamily:
    """Attacked episodes of a user's own environment and plant; see `Family`."""

    source: str  # ``module:function`` or ``file.py:function`` that returns (environment, plant)
    # attacks of `attacks.ON_ANY_MODEL`, or policies of the user, with the weight of each
    policies: Shares = tuple((name, 1.0) for name in ON_ANY_MODEL)
    steps: int = 500  # the greatest number of control steps of an episode
    program: str = "lex-cbf-qp"  # of the filter
    strict: str = "rows"  # the filter's method for strict conditions, see `_STRICT_IN_WORDS`

    def __post_init__(self) -> None:
        object.__setattr__(self, "policies", _shares("policies", self.policies))
        for name, _ in self.policies:
            if not policies.is_own(name):
                choose("policy", name, ON_ANY_MODEL)

    def episode(self, seed: int) -> own.OwnEpisode:
        """Return the episode of a seed."""
        policy = _draw(np.random.default_rng([STREAM, seed]), self.policies)
        options = {"program": self.program, "strict": self.strict}
        return own.OwnEpisode(self.source, policy, seed, self.steps, options)

    def certifies(self, declared: Mapping[str, object]) -> dict[str, Any]:
        """Return the declaration that a certificate covers: the plant's own."""
        return dict(declared)

    @property
    def words(self) -> tuple[str, ...]:
        """Sentences for the certificate's page that describe the episodes."""
        return (
            f"Environment and plant are what {self.source} returns.",
            "Scenes and starts are what the environment draws with each seed.",
            f"Policies: {_listed(self.policies)}.",
            _filter_sentence(self),
            "Entered is what the plant's strict barriers say of its state at every step, or the "
            "infos' min_h where the environment reports less.",
        )

    @property
    def files(self) -> list[Path]:
        """The user's files of plant and policies, which decide the episodes."""
        return loading.files(self.source) + _files_of(self.policies)


KINDS: dict[str, type] = {"scenes": SceneFamily, "own": OwnFamily, "a1-mixture": A1Mixture}
"""The name of each kind of family in a certificate's JSON."""

Family = SceneFamily | OwnFamily | A1Mixture
"""A frozen record whose fields, together with a seed, decide an episode, which ``episode`` returns.

``certifies`` returns what a plant may declare to be covered by a certificate of the family,
``words`` describes the episodes, and ``files`` lists the user's files that decide them.
"""


def run_seed(family: Family, margins: Uncertainty | None, seed: int) -> Seen:
    """Run the episode of a seed with these margins; None takes the plant's own."""
    return _run(family.episode(seed), margins)


def run_searched(
    family: Family, margins: Uncertainty, searched: tuple[int, tuple[float, ...]]
) -> Seen:
    """Run the episode of a seed with a searched attacker: (seed, parameters of the attacker)."""
    seed, parameters = searched
    return _run(replace(family.episode(seed), attack=SEARCHED, parameters=parameters), margins)


def _run(episode: Episode, margins: Uncertainty | None) -> Seen:
    """Run an episode, and return the part of its outcome that a certificate needs."""
    if margins is not None:
        episode = replace(episode, uncertainty=margins)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # no certificate covers it yet; the outcome has the alarms
        outcome = episode.run()
    policy, scene = stratum_of(episode)
    is_point = np.isinf(outcome.least_body_h)
    return Seen(
        policy, scene, least_h=outcome.least_h if is_point else outcome.least_body_h,
        least_speed_h=outcome.least_speed_h, first_h=outcome.first_h, fell=outcome.fell,
        alarm=outcome.alarm, steps=outcome.steps, pressed=outcome.pressed,
    )  # fmt: skip


def stratum_of(episode: Episode) -> tuple[str, str]:
    """Return the name of an episode's policy, and that of the family of its scene."""
    guided = "guidance" in (episode.filter_options or {})
    policy = episode.attack + GUIDED if guided else episode.attack
    scene = episode.scenario
    return policy, str(scene["name"] if isinstance(scene, Mapping) else scene)


def to_dict(family: Family) -> dict[str, object]:
    """Return a family in JSON types."""
    return records.to_dict(family, KINDS)


def from_dict(data: Mapping[str, object]) -> Family:
    """Return the family that `to_dict` returned in JSON types."""
    return records.from_dict("family", data, KINDS)


def _shares(field_name: str, weighted: Sequence[Sequence[Any]]) -> Shares:
    """Return names with their weights scaled to shares; `field_name` is for errors."""
    pairs = [
        (str(name), finite_float(f"{field_name}: {name}", weight, minimum=0.0))
        for name, weight in weighted
    ]
    total = sum(weight for _, weight in pairs)
    if total <= 0.0:
        expected = "expected names with positive weights"
        raise InvalidInputError(f"{field_name}: got {weighted!r}, {expected}")
    if abs(total - 1.0) <= ROUNDING:  # shares from a file stay the same, bit for bit
        return tuple(pairs)
    return tuple((name, weight / total) for name, weight in pairs)


def _files_of(shares: Shares) -> list[Path]:
    """Return the files of the policies that are the user's own."""
    return [file for name, _ in shares for file in policies.files(name.removesuffix(GUIDED))]


def _draw(rng: np.random.Generator, shares: Shares) -> str:
    """Return a random name, each with the probability of its share."""
    names, probabilities = zip(*shares, strict=True)
    return str(names[int(rng.choice(len(names), p=probabilities))])


def _filter_sentence(family: SceneFamily | OwnFamily) -> str:
    """Return a sentence about the filter for the certificate's page."""
    strict = _STRICT_IN_WORDS[family.strict]
    return f"The filter runs {family.program} {strict}, at most {family.steps} steps."


def _listed(shares: Shares) -> str:
    return ", ".join(f"{name} {share:.1%}" for name, share in shares)
