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

LOOK = 100
"""After how many episodes the running bound is printed."""
PATIENCE = 10
"""How many times the fewest episodes are waited for."""
TRIES = SEEDS // 2 // TRY_SEEDS
"""How many tries a seed has seeds for."""


def made(family: Family) -> own_environment.Made:
    """Return the environment of a family's first episode, without a filter, and its plant."""
    episode = family.episode(0)
    if isinstance(episode, own.OwnEpisode):
        return own_environment.make(episode.source)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CoverageWarning)  # not covered: it is to be certified
        env = gym.make(episode.env, scenario=episode.scenario, **(episode.env_options or {}))
    return own_environment.Made(env, env.unwrapped.plant)  # type: ignore[attr-defined]


def plant_of(family: Family) -> tuple[Plant, Info]:
    """Return the plant of a family's first episode, and what it declares."""
    env, plant = made(family)
    try:
        return plant, certificates.declared(plant, env.unwrapped, None, {})
    finally:
        env.close()


def calibrated(
    family: Family, start: Uncertainty, runs: Runs, episodes: int, share: float, seed: int
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
        return in_order(
            over(runs, family, functools.partial(run_seed, family, margins), seeds, title)
        )

    def attack(
        margins: Uncertainty, tried: Sequence[tuple[int, tuple[float, ...]]], title: str
    ) -> list[Seen]:
        job = functools.partial(run_searched, family, margins)
        return in_order(over(runs, family, job, tried, title))

    caps = getattr(family, "caps", None)
    v_max = np.inf if caps is None else caps[0]
    return calibration.calibrate(start, run, attack, episodes, share, SEEDS * seed, v_max)


def over(
    runs: Runs, family: Family, job: Callable[[Any], Seen], jobs: Sequence[Any], title: str
) -> Iterator[tuple[int, Seen]]:
    """Yield (number, what it showed) of a family's episodes; some of the saved ones run again."""
    episode, plant = family.episode(0), ""
    if isinstance(episode, own.OwnEpisode):
        plant = own_environment.identity(episode.source)
    return runs.over(job, jobs, title, family.files, plant, repeat=True)


@dataclass(frozen=True)
class Frozen:
    """What is fixed before the first episode of a certificate; see `Certificate`."""

    name: str
    family: Family
    margins: Uncertainty | None  # None is the plant's own law
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
        others = versions()
        names = ("name", "margins", "calibration", "bound", "confidence", "attempt", "first_seed")
        return {name: getattr(self, name) for name in names} | {
            "plant": self.family.certifies(both[0]),
            "family": families.to_dict(self.family),
            "words": tuple(self.family.words),
            "version": others.pop("hcbf-gym"),
            "commit": commit(),
            "versions": others,
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
    except (OSError, subprocess.CalledProcessError):  # without git, or without a commit
        return ""


def certify(frozen: Frozen, runs: Runs, at_most: int | None = None) -> Certificate:
    """Return the certificate that fresh episodes give, as soon as they are enough.

    Raises:
        RefusedError: if there is none, by `draw`; if a seed does not decide its episode; or if the
            episodes put nothing to the test.
    """
    with opened.recorded() as read:
        fields = frozen.fields()
    read |= {str(file): opened.content(str(file)) for file in frozen.family.files}
    once, again = (run_seed(frozen.family, frozen.margins, frozen.first_seed) for _ in range(2))
    refused = f"{frozen.name}: no certificate"
    if once != again:
        raise RefusedError(
            f"{refused}: the episode of seed {frozen.first_seed} came out otherwise when it ran "
            f"again (least h {once.least_h:+.4g}, {again.least_h:+.4g}); expected that the seed "
            "decides all that the environment draws"
        )
    seen = draw(frozen, runs, at_most)
    changed = [path for path, then in read.items() if opened.content(path) != then]
    if changed:
        raise RefusedError(
            f"{refused}: {', '.join(changed)} changed while episodes ran, expected the plant to "
            "stay; give the command again"
        )
    found = outcome(seen, frozen.bound)
    why = vacuous(found["shown"], len(seen))
    if why:
        raise RefusedError(f"{refused}: {why}")
    return Certificate(**fields, **found)


def draw(frozen: Frozen, runs: Runs, at_most: int | None = None) -> list[Seen]:
    """Return what fresh episodes showed, as many in the order of their seeds as are enough.

    Args:
        frozen: what was fixed before.
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
        for one in episodes(frozen, runs, range(len(seen), min(most, needed))):
            seen.append(one)
            tally.add(one.entered)
            if tally.certified:
                return seen
            if not runs.quiet and len(seen) % LOOK == 0:
                Console(stderr=True).print(_so_far(tally))
            if tally.hopeless:
                why = f"P(enter) is above {frozen.bound / 2.0:.3g}, where none ever comes"
                raise RefusedError(_refusal(frozen, seen, tally, why))
        needed = sequential.episodes_needed(frozen.bound, tally.entered, frozen.doubt)
    why = f"{needed:,} are needed; continue with a greater --at-most"
    raise RefusedError(_refusal(frozen, seen, tally, why))


def _so_far(tally: Tally) -> str:
    bound = sequential.running_bound(tally.entered, tally.episodes, tally.beta)
    return f"{tally.entered} of {tally.episodes:,} entered, P(enter) ≤ {bound:.3g} so far"


def _refusal(frozen: Frozen, seen: Sequence[Seen], tally: Tally, why: str) -> str:
    """Return why there is no certificate, what is known, and who entered."""
    who = Counter(f"{s.policy} in {s.scene}" for s in seen if s.entered)
    listed = ", ".join(f"{name} ({count})" for name, count in who.most_common(3))
    most = f"; most by {listed}" if listed else ""
    return f"{frozen.name}: no certificate: {_so_far(tally)}; {why}{most}"


def episodes(frozen: Frozen, runs: Runs, numbers: range) -> Iterator[Seen]:
    """Yield what some of a certificate's episodes show, in their order, numbered from 0."""
    job = functools.partial(run_seed, frozen.family, frozen.margins)
    seeds = [frozen.first_seed + number for number in numbers]
    early: dict[int, Seen] = {}
    following = 0
    for number, one in over(runs, frozen.family, job, seeds, "certificate"):
        early[number] = one
        while following in early:
            yield early.pop(following)
            following += 1


def outcome(seen: Sequence[Seen], bound: float) -> dict[str, Any]:
    """Return the fields of a `Certificate` that follow from its episodes, in their order."""
    blocks = tuple(_block(seen[k : k + BLOCK]) for k in range(0, len(seen), BLOCK))
    totals = {
        name: sum(getattr(one, name) for one in blocks) for name in ("entered", "falls", "alarms")
    }
    groups: dict[tuple[str, str], list[Seen]] = {}
    for one in seen:
        groups.setdefault((one.policy, one.scene), []).append(one)
    return totals | {
        "episodes": len(seen),
        "e_value": sequential.e_value(totals["entered"], len(seen), bound),
        "least_h": min(one.least_h for one in seen),
        "shown": calibration.shown(seen),
        "strata": tuple(
            Stratum(*key, len(group), sum(s.entered for s in group), min(s.least_h for s in group))
            for key, group in sorted(groups.items())
        ),
        "blocks": blocks,
    }


def _block(seen: Sequence[Seen]) -> Block:
    speed = min(one.least_speed_h for one in seen)
    return Block(
        sum(one.entered for one in seen), sum(one.pressed for one in seen),
        sum(one.steps for one in seen), sum(one.fell for one in seen),
        sum(one.alarm > 0 for one in seen), min(one.least_h for one in seen),
        speed if np.isfinite(speed) else None,
    )  # fmt: skip
