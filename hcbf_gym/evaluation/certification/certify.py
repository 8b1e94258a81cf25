"""A certificate from fresh episodes: frozen first, then one look, then a bound."""

import functools
import importlib.metadata
import platform
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import hcbf_gym
from hcbf_gym import certificates
from hcbf_gym.certificates import BLOCK, Certificate, Stratum, block_digests
from hcbf_gym.errors import CoverageWarning, InvalidInputError, RefusedError
from hcbf_gym.evaluation import chunks
from hcbf_gym.evaluation.attacked import AttackedEpisode
from hcbf_gym.evaluation.certification import calibration, families, own
from hcbf_gym.evaluation.certification.families import Seen, see
from hcbf_gym.evaluation.statistics import at_most, upper_bound
from hcbf_gym.evaluation.workers import Backend
from hcbf_gym.models.plant import Plant, Uncertainty

CALIBRATION_SEEDS = 100_000_000
"""Each `seed` has so many seeds, of which the second half belongs to the certificate."""
COMPUTING = ("numpy", "scipy", "numba", "mujoco", "gymnasium")
"""Whose versions decide the bits of an episode."""


@dataclass(frozen=True)
class Runs:
    """How episodes run.

    Args:
        folder: where finished chunks are kept; None to keep none.
        workers: chunks that run at once; None for as many as the backend has CPUs.
        backend: "processes" or "ray".
        quiet: show no bar.
    """

    folder: Path | None
    workers: int | None = None
    backend: Backend = "processes"
    quiet: bool = False

    def over(self, function: Any, jobs: Sequence[Any], family: Any, title: str, size: int) -> Any:
        """Yield (number, result) of jobs, with a bar that tells the time left."""
        return chunks.run(
            function, jobs, folder=self.folder, reads=family.files, size=size,
            workers=self.workers, backend=self.backend, title=None if self.quiet else title,
        )  # fmt: skip


def plant_of(family: Any) -> tuple[Plant, dict[str, Any]]:
    """Return the plant of a family's first episode, and what it declares.

    Args:
        family: of episodes.
    """
    episode = family.episode(0)
    if isinstance(episode, own.OwnEpisode):
        env, plant = own.make(episode.source)
    else:
        env = _env_of(episode)
        plant = env.unwrapped.plant  # type: ignore[attr-defined]
    try:
        return plant, certificates.declared(plant, env.unwrapped, None, {})
    finally:
        env.close()


def _env_of(episode: AttackedEpisode) -> gym.Env:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CoverageWarning)  # not covered: that is what is asked
        return gym.make(episode.env, scenario=episode.scenario, **(episode.env_options or {}))


def calibrated(
    family: Any,
    start: Uncertainty,
    runs: Runs,
    episodes: int,
    share: float,
    seed: int,
    constants: Sequence[str] = calibration.CONSTANTS,
) -> calibration.Calibrated:
    """Return margins for a family's plant, from episodes of it and from a search.

    Args:
        family: of episodes; one with `searched` is searched, too.
        start: the plant's own margins.
        runs: how they run.
        episodes: of each round.
        share: of episodes that may need more than is reserved.
        seed: decides the seeds, which no certificate of the same seed draws.
        constants: which margins are set.

    Raises:
        RefusedError: if no margins do.
    """

    def run(margins: Uncertainty, seeds: Sequence[int], title: str) -> list[Seen]:
        job = functools.partial(see, family, margins)
        found = dict(runs.over(job, list(seeds), family, title, BLOCK))
        return [found[k] for k in range(len(seeds))]

    def attack(margins: Uncertainty, tried: Sequence[Any], title: str) -> list[Seen]:
        job = functools.partial(_try, family, margins)
        found = dict(runs.over(job, list(tried), family, title, 3))
        return [found[k] for k in range(len(tried))]

    caps = getattr(family, "caps", None)
    return calibration.calibrate(
        start,
        run,
        attack if hasattr(family, "searched") else None,
        episodes,
        share,
        CALIBRATION_SEEDS * seed,
        constants,
        v_max=np.inf if caps is None else caps[0],
    )


def _try(family: Any, margins: Uncertainty, tried: tuple[int, tuple[float, ...]]) -> Seen:
    """Run the episode of a seed with a searched attacker of some parameters."""
    episode = family.searched(*tried)
    return families.look(families.with_margins(episode, margins))


def bound_of(episodes: int, allowed: int, confidence: float) -> float:
    """Return what is certified at least where no more enter than are allowed.

    Raises:
        InvalidInputError: if the numbers make no sense, or all may enter.
    """
    if allowed >= episodes:
        raise InvalidInputError(
            f"episodes: got {episodes} of which {allowed} may enter, expected more"
        )
    return upper_bound(allowed, episodes, confidence)


@dataclass(frozen=True)
class Frozen:
    """What is fixed before the first episode of a certificate; see `Certificate`.

    Args:
        name: of the certificate.
        family: the episodes are drawn from.
        margins: what rows reserve; None is the plant's own law.
        calibration: what was done before.
        episodes: n.
        allowed: the most that may enter, k.
        confidence: of the bound.
        seed: decides the seeds, with that of the calibration.
    """

    name: str
    family: Any
    margins: Uncertainty | None
    calibration: tuple[Any, ...]
    episodes: int
    allowed: int
    confidence: float
    seed: int

    def __post_init__(self) -> None:
        bound_of(self.episodes, self.allowed, self.confidence)

    @property
    def first_seed(self) -> int:
        """Of the certificate's episodes, which no calibration of this seed draws."""
        return CALIBRATION_SEEDS * self.seed + CALIBRATION_SEEDS // 2

    def fields(self) -> dict[str, Any]:
        """Return the fields of a `Certificate` that are known before its episodes."""
        _, declared = plant_of(self.family)
        return {
            "name": self.name,
            "plant": self.family.certifies(declared),
            "family": families.to_dict(self.family),
            "words": tuple(self.family.words),
            "margins": self.margins,
            "calibration": self.calibration,
            "episodes": self.episodes,
            "allowed": self.allowed,
            "confidence": self.confidence,
            "first_seed": self.first_seed,
            "versions": versions(),
            "sources": chunks.sources_of(see, self.family.files),
        }


def versions() -> dict[str, str]:
    """Return name → version of what decides the bits of an episode."""
    found = {name: importlib.metadata.version(name) for name in COMPUTING}
    here = {"python": platform.python_version(), "machine": platform.machine()}
    return {"hcbf-gym": hcbf_gym.__version__} | found | here


def certify(frozen: Frozen, runs: Runs) -> Certificate:
    """Return the certificate that fresh episodes give.

    Args:
        frozen: what was fixed before.
        runs: how they run.

    Raises:
        RefusedError: as soon as more have entered than were allowed, or if a seed does not decide
            its episode.
    """
    fields = frozen.fields()
    once, again = (see(frozen.family, frozen.margins, frozen.first_seed) for _ in range(2))
    if once != again:
        raise RefusedError(
            f"{frozen.name}: no certificate: the episode of seed {frozen.first_seed} came out "
            f"otherwise when it ran again (least h {once.least_h:+.4g}, {again.least_h:+.4g}); "
            "expected that the seed decides all that the environment draws"
        )
    seen = draw(frozen, runs)
    least = np.array([(one.least_h, one.least_speed_h) for one in seen])
    entered = sum(one.entered for one in seen)
    return Certificate(
        **fields,
        entered=entered,
        bound=upper_bound(entered, frozen.episodes, frozen.confidence),
        least_h=float(least[:, 0].min()),
        falls=sum(one.fell for one in seen),
        alarms=sum(one.alarm > 0 for one in seen),
        strata=strata(seen),
        blocks=block_digests(least),
    )


def draw(frozen: Frozen, runs: Runs) -> list[Seen]:
    """Return what the fresh episodes of a certificate showed, no more of them than allowed entered.

    Args:
        frozen: as `certify` takes it.
        runs: how they run.

    Raises:
        RefusedError: as soon as more have entered than were allowed.
    """
    seeds = range(frozen.first_seed, frozen.first_seed + frozen.episodes)
    job = functools.partial(see, frozen.family, frozen.margins)
    seen: dict[int, Seen] = {}
    entered = 0
    for number, one in runs.over(job, seeds, frozen.family, "certificate", BLOCK):
        seen[number] = one
        entered += one.entered
        if entered > frozen.allowed:
            raise RefusedError(_refusal(frozen, list(seen.values())))
    return [seen[k] for k in range(frozen.episodes)]


def strata(seen: Sequence[Seen]) -> tuple[Stratum, ...]:
    """Return the counts of each policy in each family of scenes."""
    groups: dict[tuple[str, str], list[Seen]] = {}
    for one in seen:
        groups.setdefault((one.policy, one.scene), []).append(one)
    return tuple(
        Stratum(*key, len(group), sum(s.entered for s in group), min(s.least_h for s in group))
        for key, group in sorted(groups.items())
    )


def _refusal(frozen: Frozen, seen: Sequence[Seen]) -> str:
    """Return why there is no certificate, and who entered."""
    entered = [s for s in seen if s.entered]
    who = Counter(f"{s.policy} in {s.scene}" for s in entered)
    told = ", ".join(f"{name} ({count})" for name, count in who.most_common(3))
    return (
        f"{frozen.name}: no certificate: {len(entered)} of the first {len(seen):,} episodes "
        f"entered rank 1, {frozen.allowed} of {frozen.episodes:,} were allowed; "
        f"P(enter) {at_most(len(entered), len(seen))}; most by {told}"
    )


@dataclass(frozen=True)
class Checked:
    """What a repetition of a part showed.

    Attributes:
        episodes: how many were run again.
        differing: the first seeds of the blocks that were not the same bit for bit.
        least_h: of the repeated episodes.
        same_sources: whether program and files are those of the certificate.
    """

    episodes: int
    differing: tuple[int, ...]
    least_h: float
    same_sources: bool


def check(certificate: Certificate, episodes: int, seed: int, runs: Runs) -> Checked:
    """Run a random part of a certificate's episodes again, and compare bit for bit.

    Args:
        certificate: to check.
        episodes: at least so many, in whole blocks.
        seed: decides which.
        runs: how they run.
    """
    family = families.from_dict(certificate.family)
    count = min(len(certificate.blocks), -(-episodes // BLOCK))
    chosen = np.random.default_rng(seed).permutation(len(certificate.blocks))[:count]
    blocks = sorted(int(k) for k in chosen)
    jobs = [
        certificate.first_seed + k
        for block in blocks
        for k in range(block * BLOCK, min((block + 1) * BLOCK, certificate.episodes))
    ]
    job = functools.partial(see, family, certificate.margins)
    found = dict(runs.over(job, jobs, family, "check", BLOCK))
    seen = [found[k] for k in range(len(jobs))]
    differing = []
    for place, block in enumerate(blocks):
        part = seen[place * BLOCK : (place + 1) * BLOCK]
        digest = block_digests(np.array([(s.least_h, s.least_speed_h) for s in part]))
        if digest != (certificate.blocks[block],):
            differing.append(certificate.first_seed + block * BLOCK)
    return Checked(
        len(jobs),
        tuple(differing),
        min(s.least_h for s in seen),
        chunks.sources_of(see, family.files) == certificate.sources,
    )
