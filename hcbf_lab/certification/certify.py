"""A certificate from fresh episodes: `Frozen` fixes the claim first, then `certify` tests it."""

import functools
import subprocess
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from rich.console import Console

from hcbf_gym import certificates, opened
from hcbf_gym.arrays import Info
from hcbf_gym.certificates import BLOCK, Block, Certificate, Stratum, sequential
from hcbf_gym.certificates.certificate import SEEDS, TRY_SEEDS
from hcbf_gym.certificates.declared import UNHASHABLE
from hcbf_gym.certificates.parts import vacuous
from hcbf_gym.certificates.sequential import Tally
from hcbf_gym.errors import CoverageWarning, InvalidInputError, RefusedError, finite_float
from hcbf_gym.evaluation import own_environment
from hcbf_gym.evaluation.jobs import Runs, in_order, versions
from hcbf_gym.models.plant import Plant, Uncertainty
from hcbf_gym.sources import NAMES, PACKAGE
from hcbf_lab.certification import calibration, families, own
from hcbf_lab.certification.families import Family, Seen, run_searched, run_seed

PRINTED_EVERY = 100  # episodes from one printed running bound to the next
PATIENCE = 10  # episodes to wait for, as a multiple of the fewest that can be enough
TRIES = SEEDS // 2 // TRY_SEEDS  # the number of tries for which a seed has episodes


def make(family: Family) -> own_environment.EnvironmentAndPlant:
    """Return the environment of a family's first episode, without a filter, and its plant."""
    episode = family.episode(0)
    if isinstance(episode, own.OwnEpisode):
        return own_environment.make(episode.source)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CoverageWarning)  # a certificate is only to be made
        env = gym.make(episode.env, scenario=episode.scenario, **(episode.env_options or {}))
    return own_environment.EnvironmentAndPlant(env, env.unwrapped.plant)  # type: ignore[attr-defined]


def plant_of(family: Family) -> tuple[Plant, Info]:
    """Return the plant of a family's first episode, and its declaration for certificates."""
    env, plant = make(family)
    try:
        return plant, certificates.declared(plant, env.unwrapped, None, {})
    finally:
        env.close()


def calibrated(
    family: Family, start: Uncertainty, runs: Runs, episodes: int, share: float, seed: int
) -> calibration.Calibrated:
    """Return margins for a family's plant, from its episodes and from a search for attackers.

    Args:
        family: of the episodes.
        start: the margins that the plant declares.
        runs: how episodes run.
        episodes: the number of episodes in each round.
        share: of the episodes that may need more than the margins.
        seed: decides the episodes' seeds. No certificate of the same seed uses them.

    Raises:
        RefusedError: if there are no such margins.
    """

    def run(margins: Uncertainty, seeds: Sequence[int], title: str) -> list[Seen]:
        job = functools.partial(run_seed, family, margins)
        return in_order(over(runs, family, job, seeds, title))

    def attack(
        margins: Uncertainty, attackers: Sequence[calibration.Searched], title: str
    ) -> list[Seen]:
        job = functools.partial(run_searched, family, margins)
        return in_order(over(runs, family, job, attackers, title))

    caps = getattr(family, "caps", None)
    v_max = np.inf if caps is None else caps[0]
    return calibration.calibrate(start, run, attack, episodes, share, SEEDS * seed, v_max)


def over(
    runs: Runs, family: Family, job: Callable[[Any], Seen], jobs: Sequence[Any], title: str
) -> Iterator[tuple[int, Seen]]:
    """Yield (index of the job, record) of a family's episodes, in any order.

    Some of the saved results are computed again, to see that they stay the same.
    """
    episode, plant = family.episode(0), ""
    if isinstance(episode, own.OwnEpisode):
        plant = own_environment.plant_hash(episode.source)
    return runs.over(job, jobs, title, family.files, plant, repeat=True)


@dataclass(frozen=True)
class Frozen:
    """The fields of a `Certificate` that are fixed before its first episode."""

    name: str  # of the certificate
    family: Family  # of the episodes
    margins: Uncertainty | None  # of the rows; None takes the plant's own law
    calibration: tuple[Mapping[str, Any], ...]  # the rounds that led to the margins
    bound: float  # ε
    confidence: float = 0.999  # 1 − β
    attempt: int = 0  # n, the number of the try; 0 for the only one
    seed: int = 0  # decides the episodes' seeds

    def __post_init__(self) -> None:
        for name in ("bound", "confidence"):
            share = finite_float(name, getattr(self, name))
            if not 0.0 < share < 1.0:
                raise InvalidInputError(f"{name}: got {share}, expected between 0 and 1")
        if not 0 <= self.attempt < TRIES:
            raise InvalidInputError(f"try: got {self.attempt}, expected 0 to {TRIES - 1}")

    @property
    def doubt(self) -> float:
        """The probability β/2ⁿ with which this try may be wrong."""
        return (1.0 - self.confidence) / 2.0**self.attempt

    @property
    def first_seed(self) -> int:
        """The seed of the first episode. No calibration with the same `seed` uses it."""
        return certificates.first_seed(self.seed, self.attempt)

    @property
    def fewest(self) -> int:
        """The number of episodes that are enough if none enters."""
        return sequential.episodes_needed(self.bound, 0, self.doubt)

    def fields(self) -> dict[str, Any]:
        """Return the fields of a `Certificate` that are known before its episodes.

        Raises:
            RefusedError: if no later plant could be recognised as this one.
        """
        declared, declared_again = (plant_of(self.family)[1] for _ in range(2))
        differ = [name for name in declared if declared[name] != declared_again.get(name)]
        unhashable = declared.get(UNHASHABLE)
        if differ or unhashable:
            why = f"what cannot be hashed: {unhashable}" if unhashable else f"another {differ}"
            raise RefusedError(
                f"{self.name}: no certificate could cover it: its function returns {why}, expected "
                "the same plant at every call; make in `reset` what only an episode needs"
            )
        other_versions = versions()
        names = ("name", "margins", "calibration", "bound", "confidence", "attempt", "first_seed")
        return {name: getattr(self, name) for name in names} | {
            "plant": self.family.certifies(declared),
            "family": families.to_dict(self.family),
            "words": tuple(self.family.words),
            "version": other_versions.pop("hcbf-gym"),
            "commit": commit(),
            "versions": other_versions,
        }


def commit() -> str:
    """Return the commit of the packages' checkout, with a + after edits; "" without a checkout."""
    root = PACKAGE.parent
    if not (root / ".git").exists():
        return ""

    def git(*arguments: str) -> str:
        command = ["git", "-C", root, *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        edited = git("status", "--porcelain", "--", *NAMES, "core")
        return git("rev-parse", "--short=7", "HEAD") + "+" * bool(edited)
    except (OSError, subprocess.CalledProcessError):  # there is no git, or no commit yet
        return ""


def certify(frozen: Frozen, runs: Runs, at_most: int | None = None) -> Certificate:
    """Return the certificate that fresh episodes give, as soon as they are enough; see `draw`.

    Raises:
        RefusedError: if `draw` finds no certificate, a seed does not decide its episode, a file of
            the plant changes, or the episodes hardly put rank 1 to the test.
    """
    with opened.recorded() as contents:
        fields = frozen.fields()
    contents |= {str(file): opened.content(str(file)) for file in frozen.family.files}
    once, again = (run_seed(frozen.family, frozen.margins, frozen.first_seed) for _ in range(2))
    refused = f"{frozen.name}: no certificate"
    if once != again:
        raise RefusedError(
            f"{refused}: the episode of seed {frozen.first_seed} came out otherwise when it ran "
            f"again (least h {once.least_h:+.4g}, {again.least_h:+.4g}); expected that the seed "
            "decides all that the environment draws"
        )
    seen = draw(frozen, runs, at_most)
    changed = [path for path, before in contents.items() if opened.content(path) != before]
    if changed:
        raise RefusedError(
            f"{refused}: {', '.join(changed)} changed while episodes ran, expected the plant to "
            "stay; give the command again"
        )
    results = outcome(seen, frozen.bound)
    why = vacuous(results["shown"], len(seen))
    if why:
        raise RefusedError(f"{refused}: {why}")
    return Certificate(**fields, **results)


def draw(frozen: Frozen, runs: Runs, at_most: int | None = None) -> list[Seen]:
    """Return the records of fresh episodes, in the order of their seeds, as soon as they certify.

    Args:
        frozen: the fields that are fixed before the episodes.
        runs: how episodes run.
        at_most: the number of episodes to wait for; None for `PATIENCE` times the fewest.

    Raises:
        RefusedError: if P(enter) is shown to be above ε/2, where no certificate is to be expected,
            or if `at_most` episodes are not enough.
    """
    tally = Tally(frozen.bound, frozen.doubt)
    most = PATIENCE * frozen.fewest if at_most is None else at_most
    seen: list[Seen] = []
    needed = frozen.fewest
    while len(seen) < min(most, needed):
        for episode in episodes(frozen, runs, range(len(seen), min(most, needed))):
            seen.append(episode)
            tally.add(episode.entered)
            if tally.certified:
                return seen
            if not runs.quiet and len(seen) % PRINTED_EVERY == 0:
                Console(stderr=True).print(_so_far(tally))
            if tally.hopeless:
                why = f"P(enter) is above {frozen.bound / 2.0:.3g}, where none ever comes"
                raise RefusedError(_refusal(frozen, seen, tally, why))
        needed = sequential.episodes_needed(frozen.bound, tally.entered, frozen.doubt)
    why = f"{needed:,} are needed; continue with a greater --at-most"
    raise RefusedError(_refusal(frozen, seen, tally, why))


def _so_far(tally: Tally) -> str:
    """Return the running bound in words."""
    bound = sequential.running_bound(tally.entered, tally.episodes, tally.beta)
    return f"{tally.entered} of {tally.episodes:,} entered, P(enter) ≤ {bound:.3g} so far"


def _refusal(frozen: Frozen, seen: Sequence[Seen], tally: Tally, why: str) -> str:
    """Return a refusal's message: the running bound, the reason, and the policies that enter."""
    entries = Counter(f"{s.policy} in {s.scene}" for s in seen if s.entered)
    listed = ", ".join(f"{name} ({count})" for name, count in entries.most_common(3))
    most = f"; most by {listed}" if listed else ""
    return f"{frozen.name}: no certificate: {_so_far(tally)}; {why}{most}"


def episodes(frozen: Frozen, runs: Runs, numbers: range) -> Iterator[Seen]:
    """Yield the records of a certificate's episodes of these numbers, from 0, in their order."""
    job = functools.partial(run_seed, frozen.family, frozen.margins)
    seeds = [frozen.first_seed + number for number in numbers]
    waiting: dict[int, Seen] = {}  # episodes that finished before earlier ones
    next_index = 0
    for index, episode in over(runs, frozen.family, job, seeds, "certificate"):
        waiting[index] = episode
        while next_index in waiting:
            yield waiting.pop(next_index)
            next_index += 1


def outcome(seen: Sequence[Seen], bound: float) -> dict[str, Any]:
    """Return the fields of a `Certificate` that follow from its episodes, in the order of seeds."""
    blocks = tuple(_block(seen[k : k + BLOCK]) for k in range(0, len(seen), BLOCK))
    entered = sum(block.entered for block in blocks)
    groups: dict[tuple[str, str], list[Seen]] = {}
    for episode in seen:
        groups.setdefault((episode.policy, episode.scene), []).append(episode)
    return {
        "entered": entered,
        "falls": sum(block.falls for block in blocks),
        "alarms": sum(block.alarms for block in blocks),
        "episodes": len(seen),
        "e_value": sequential.e_value(entered, len(seen), bound),
        "least_h": min(episode.least_h for episode in seen),
        "shown": calibration.shown(seen),
        "strata": tuple(
            Stratum(*key, len(group), sum(s.entered for s in group), min(s.least_h for s in group))
            for key, group in sorted(groups.items())
        ),
        "blocks": blocks,
    }


def _block(seen: Sequence[Seen]) -> Block:
    """Return the sums and the least h's of a few successive episodes."""
    least_speed_h = min(episode.least_speed_h for episode in seen)
    return Block(
        entered=sum(s.entered for s in seen), pressed=sum(s.pressed for s in seen),
        steps=sum(s.steps for s in seen), falls=sum(s.fell for s in seen),
        alarms=sum(s.alarm > 0 for s in seen), least_h=min(s.least_h for s in seen),
        least_speed_h=least_speed_h if np.isfinite(least_speed_h) else None,
    )  # fmt: skip
