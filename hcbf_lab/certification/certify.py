"""A certificate from fresh episodes: frozen first, then one look, then a bound."""

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

from hcbf_gym import certificates, opened, sources
from hcbf_gym.arrays import Info
from hcbf_gym.certificates import BLOCK, Block, Certificate, Stratum, sequential
from hcbf_gym.certificates.certificate import SEEDS, TRY_SEEDS
from hcbf_gym.certificates.declared import UNHASHABLE
from hcbf_gym.certificates.parts import vacuous
from hcbf_gym.certificates.sequential import Tally
from hcbf_gym.errors import CoverageWarning, InvalidInputError, RefusedError, finite_float
from hcbf_gym.evaluation import chunks, own_environment
from hcbf_gym.evaluation.chunks import Runs
from hcbf_gym.models.plant import Plant, Uncertainty
from hcbf_lab.certification import calibration, families, own
from hcbf_lab.certification.families import Family, Seen, run_searched, run_seed

LOOK = 100
"""After how many episodes the running bound is printed."""
PATIENCE = 10
"""How many times the fewest episodes are waited for."""
TRIES = SEEDS // 2 // TRY_SEEDS
"""How many tries a seed has seeds for."""


def plant_of(family: Family) -> tuple[Plant, Info]:
    """Return the plant of a family's first episode, and what it declares.

    Args:
        family: of episodes.
    """
    episode = family.episode(0)
    if isinstance(episode, own.OwnEpisode):
        env, plant = own_environment.make(episode.source)
    else:
        env = env_of(family)
        plant = env.unwrapped.plant  # type: ignore[attr-defined]
    try:
        return plant, certificates.declared(plant, env.unwrapped, None, {})
    finally:
        env.close()


def env_of(family: Family) -> gym.Env:
    """Return the environment of a family's first episode, without a filter."""
    episode = family.episode(0)
    if isinstance(episode, own.OwnEpisode):
        return own_environment.make(episode.source).env
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CoverageWarning)  # not covered: it is to be certified
        return gym.make(episode.env, scenario=episode.scenario, **(episode.env_options or {}))


def calibrated(
    family: Family,
    start: Uncertainty,
    runs: Runs,
    episodes: int,
    share: float,
    seed: int,
) -> calibration.Calibrated:
    """Return margins for a family's plant, from episodes of it and from a search.

    Args:
        family: of episodes.
        start: the plant's own margins.
        runs: how they run.
        episodes: of each round.
        share: of episodes that may need more than is reserved.
        seed: decides the seeds, which no certificate of the same seed draws.

    Raises:
        RefusedError: if no margins do.
    """

    def run(margins: Uncertainty, seeds: Sequence[int], title: str) -> list[Seen]:
        job = functools.partial(run_seed, family, margins)
        return chunks.in_order(over(runs, family, job, seeds, title))

    def attack(
        margins: Uncertainty, tried: Sequence[tuple[int, tuple[float, ...]]], title: str
    ) -> list[Seen]:
        job = functools.partial(run_searched, family, margins)
        return chunks.in_order(over(runs, family, job, tried, title, 3))

    caps = getattr(family, "caps", None)
    return calibration.calibrate(
        start,
        run,
        attack,
        episodes,
        share,
        SEEDS * seed,
        v_max=np.inf if caps is None else caps[0],
    )


def over(
    runs: Runs,
    family: Family,
    job: Callable[[Any], Seen],
    jobs: Sequence[Any],
    title: str,
    size: int = BLOCK,
) -> Iterator[tuple[int, Seen]]:
    """Yield (number, what it showed) of a family's episodes; one of each saved chunk runs again.

    Args:
        runs: how they run.
        family: that decides what they read.
        job: runs an episode.
        jobs: what it is called with.
        title: of a bar.
        size: episodes in a chunk.
    """
    return runs.over(job, jobs, title, family.files, size, _identity(family), repeat=True)


def _identity(family: Family) -> str:
    """Return the identity of a plant of the user's own, as it is now; "" of the package's."""
    episode = family.episode(0)
    return own_environment.identity(episode.source) if isinstance(episode, own.OwnEpisode) else ""


@dataclass(frozen=True)
class Frozen:
    """What is fixed before the first episode of a certificate; see `Certificate`.

    Args:
        name: of the certificate.
        family: the episodes are drawn from.
        margins: what rows reserve; None is the plant's own law.
        calibration: what was done before.
        bound: ε that is asked for.
        confidence: 1 − β.
        attempt: which try, of which each spends β/2ⁿ; 0 for the only one.
        seed: decides the seeds, with that of the calibration.
    """

    name: str
    family: Family
    margins: Uncertainty | None
    calibration: tuple[Mapping[str, Any], ...]
    bound: float
    confidence: float = 0.999
    attempt: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("bound", "confidence"):
            share = finite_float(name, getattr(self, name))
            if not 0.0 < share < 1.0:
                raise InvalidInputError(f"{name}: got {share}, expected between 0 and 1")
        if not 0 <= self.attempt < TRIES:
            raise InvalidInputError(f"try: got {self.attempt}, expected 0 to {TRIES - 1}")

    @property
    def doubt(self) -> float:
        """What this try may spend, β/2ⁿ."""
        return (1.0 - self.confidence) / 2.0**self.attempt

    @property
    def first_seed(self) -> int:
        """Of the certificate's episodes, which no calibration of this seed draws."""
        return certificates.first_seed(self.seed, self.attempt)

    @property
    def fewest(self) -> int:
        """How many episodes are enough where none enters."""
        return sequential.episodes_needed(self.bound, 0, self.doubt)

    def fields(self) -> dict[str, Any]:
        """Return the fields of a `Certificate` that are known before its episodes."""
        both = [plant_of(self.family)[1] for _ in range(2)]
        differ = [name for name in both[0] if both[0][name] != both[1].get(name)]
        unhashable = both[0].get(UNHASHABLE)
        if differ or unhashable:
            why = f"what cannot be hashed: {unhashable}" if unhashable else f"another {differ}"
            raise RefusedError(
                f"{self.name}: no certificate could cover it: its function returns {why}, expected "
                "the same plant at every call; make in `reset` what only an episode needs"
            )
        versions = chunks.versions()
        return {
            "name": self.name,
            "plant": self.family.certifies(both[0]),
            "family": families.to_dict(self.family),
            "words": tuple(self.family.words),
            "margins": self.margins,
            "calibration": self.calibration,
            "bound": self.bound,
            "confidence": self.confidence,
            "attempt": self.attempt,
            "first_seed": self.first_seed,
            "version": versions.pop("hcbf-gym"),
            "commit": commit(),
            "versions": versions,
        }


def commit() -> str:
    """Return the commit of this package's checkout, with a + after edits; "" without a checkout."""
    root = sources.PACKAGE.parent
    if not (root / ".git").exists():
        return ""

    def git(*arguments: str) -> str:
        done = subprocess.run(
            ["git", "-C", root, *arguments], capture_output=True, text=True, check=True
        )
        return done.stdout.strip()

    try:
        edited = git("status", "--porcelain", "--", *sources.NAMES, "core")
        return git("rev-parse", "--short=7", "HEAD") + "+" * bool(edited)
    except (OSError, subprocess.CalledProcessError):  # without git, or without a commit
        return ""


def certify(frozen: Frozen, runs: Runs, at_most: int | None = None) -> Certificate:
    """Return the certificate that fresh episodes give, as soon as they are enough.

    Args:
        frozen: what was fixed before.
        runs: how they run.
        at_most: as `draw` takes it.

    Raises:
        RefusedError: if there is none, by `draw`; if a seed does not decide its episode; or if the
            episodes put nothing to the test.
    """
    with opened.recorded() as read:
        fields = frozen.fields()
    read |= {str(file): opened.content(str(file)) for file in frozen.family.files}
    once, again = (run_seed(frozen.family, frozen.margins, frozen.first_seed) for _ in range(2))
    if once != again:
        raise RefusedError(
            f"{frozen.name}: no certificate: the episode of seed {frozen.first_seed} came out "
            f"otherwise when it ran again (least h {once.least_h:+.4g}, {again.least_h:+.4g}); "
            "expected that the seed decides all that the environment draws"
        )
    seen = draw(frozen, runs, at_most)
    changed = [path for path, then in read.items() if opened.content(path) != then]
    if changed:
        raise RefusedError(
            f"{frozen.name}: no certificate: {', '.join(changed)} changed while episodes ran, "
            "expected the plant to stay; give the command again"
        )
    found = outcome(seen, frozen.bound)
    why = vacuous(found["shown"], len(seen))
    if why:
        raise RefusedError(f"{frozen.name}: no certificate: {why}")
    return Certificate(**fields, **found)


def draw(frozen: Frozen, runs: Runs, at_most: int | None = None) -> list[Seen]:
    """Return what fresh episodes showed, as many in the order of their seeds as are enough.

    Args:
        frozen: as `certify` takes it.
        runs: how they run.
        at_most: how many episodes to wait for; `PATIENCE` times the fewest if None.

    Raises:
        RefusedError: as soon as the chance is shown to be above ε/2, so that none may come; or
            where so many are not enough.
    """
    tally = Tally(frozen.bound, frozen.doubt)
    most = PATIENCE * frozen.fewest if at_most is None else at_most
    seen: list[Seen] = []
    needed = frozen.fewest
    while len(seen) < min(most, needed):
        for one in in_order(frozen, runs, range(len(seen), min(most, needed))):
            seen.append(one)
            tally.add(one.entered)
            if tally.certified:
                return seen
            if not runs.quiet and len(seen) % LOOK == 0:
                Console(stderr=True).print(so_far(tally))
            if tally.hopeless:
                why = f"P(enter) is above {frozen.bound / 2.0:.3g}, where none ever comes"
                raise RefusedError(_refusal(frozen, seen, why))
        needed = sequential.episodes_needed(frozen.bound, tally.entered, frozen.doubt)
    raise RefusedError(
        _refusal(frozen, seen, f"{needed:,} are needed; go on with a greater --at-most")
    )


def so_far(tally: Tally) -> str:
    """Return what the episodes so far say."""
    bound = sequential.running_bound(tally.entered, tally.episodes, tally.beta)
    return f"{tally.entered} of {tally.episodes:,} entered, P(enter) ≤ {bound:.3g} so far"


def in_order(frozen: Frozen, runs: Runs, numbers: range) -> Iterator[Seen]:
    """Yield what some of a certificate's episodes show, in their order.

    Blocks run whole, so that chunks of several machines are those of one.

    Args:
        frozen: as `certify` takes it.
        runs: how they run.
        numbers: of the episodes, from 0.
    """
    job = functools.partial(run_seed, frozen.family, frozen.margins)
    first, end = BLOCK * (numbers.start // BLOCK), BLOCK * -(-numbers.stop // BLOCK)
    seeds = range(frozen.first_seed + first, frozen.first_seed + end)
    early: dict[int, Seen] = {}
    following = first
    for number, one in over(runs, frozen.family, job, seeds, "certificate"):
        early[first + number] = one
        while following in early:
            found = early.pop(following)
            if following in numbers:
                yield found
            following += 1


def outcome(seen: Sequence[Seen], bound: float) -> dict[str, Any]:
    """Return the fields of a `Certificate` that follow from its episodes.

    Args:
        seen: in their order.
        bound: ε.
    """
    entered = sum(one.entered for one in seen)
    return {
        "episodes": len(seen),
        "entered": entered,
        "e_value": sequential.e_value(entered, len(seen), bound),
        "least_h": min(one.least_h for one in seen),
        "falls": sum(one.fell for one in seen),
        "alarms": sum(one.alarm > 0 for one in seen),
        "shown": calibration.shown(seen),
        "strata": strata(seen),
        "blocks": tuple(_block(seen[k : k + BLOCK]) for k in range(0, len(seen), BLOCK)),
    }


def _block(seen: Sequence[Seen]) -> Block:
    speed = min(one.least_speed_h for one in seen)
    return Block(
        sum(one.entered for one in seen), sum(one.pressed for one in seen),
        sum(one.steps for one in seen), sum(one.fell for one in seen),
        sum(one.alarm > 0 for one in seen), min(one.least_h for one in seen),
        speed if np.isfinite(speed) else None,
    )  # fmt: skip


def strata(seen: Sequence[Seen]) -> tuple[Stratum, ...]:
    """Return the counts of each policy in each family of scenes."""
    groups: dict[tuple[str, str], list[Seen]] = {}
    for one in seen:
        groups.setdefault((one.policy, one.scene), []).append(one)
    return tuple(
        Stratum(*key, len(group), sum(s.entered for s in group), min(s.least_h for s in group))
        for key, group in sorted(groups.items())
    )


def _refusal(frozen: Frozen, seen: Sequence[Seen], why: str) -> str:
    """Return why there is no certificate, what is known, and who entered."""
    entered = [s for s in seen if s.entered]
    tally = Tally(frozen.bound, frozen.doubt, len(entered), len(seen))
    who = Counter(f"{s.policy} in {s.scene}" for s in entered)
    listed = ", ".join(f"{name} ({count})" for name, count in who.most_common(3))
    return (
        f"{frozen.name}: no certificate: {so_far(tally)}; {why}"
        f"{'; most by ' + listed if listed else ''}"
    )
