"""The check of a certificate: its episodes run again, and its other fields are derived again."""

import functools
from collections import Counter
from dataclasses import dataclass, is_dataclass

import numpy as np

from hcbf_gym import records
from hcbf_gym.certificates import BLOCK, Certificate
from hcbf_gym.certificates.certificate import CALIBRATED, SEEDS
from hcbf_gym.errors import HcbfError
from hcbf_gym.evaluation.jobs import Runs, in_order, versions
from hcbf_lab.certification import calibration, certify, families
from hcbf_lab.certification.families import Family, Seen, run_seed

TOLERANCE = 1e-6  # relative, and absolute below 1, for every number that is compared
SAFER = 10.0
"""A calibration lets a share bound / `SAFER` of the episodes need more than the margins."""


@dataclass(frozen=True)
class Checked:
    """The result of a check."""

    episodes: int  # the number of repeated episodes
    differs: tuple[str, ...]  # a phrase for each difference between the file and the repetition
    elsewhere: tuple[str, ...]  # a phrase for each version that differs from the one here
    least_h: float  # of the repeated episodes


def check(certificate: Certificate, episodes: int, seed: int, runs: Runs) -> Checked:
    """Run random blocks of a certificate's episodes again, and compare.

    If all blocks are chosen, the totals are compared, too, and the calibration is repeated.

    Args:
        certificate: to check.
        episodes: the least number of episodes to repeat, rounded up to whole blocks.
        seed: of the random choice of blocks.
        runs: how episodes run.
    """
    family = families.from_dict(certificate.family)
    differs = stated_otherwise(certificate, family) + _drawn_otherwise(certificate, family)
    count = min(len(certificate.blocks), -(-episodes // BLOCK))
    shuffled = np.random.default_rng(seed).permutation(len(certificate.blocks))
    chosen = sorted(shuffled[:count].tolist())
    seeds: list[int] = []
    for block in chosen:
        end = min((block + 1) * BLOCK, certificate.episodes)
        seeds += range(certificate.first_seed + block * BLOCK, certificate.first_seed + end)
    job = functools.partial(run_seed, family, certificate.margins)
    seen: list[Seen] = in_order(certify.over(runs, family, job, seeds, "check"))
    repeated = certify.outcome(seen, certificate.bound)
    for block, value in zip(chosen, repeated["blocks"], strict=True):
        stated = certificate.blocks[block]
        if not _same(stated, value):
            first = certificate.first_seed + block * BLOCK
            differs.append(f"block from seed {first}: {stated}, now {value}")
    if count == len(certificate.blocks):
        differs += [
            f"{name}: {getattr(certificate, name)}, now {value}"
            for name, value in repeated.items()
            if name != "blocks" and not _same(getattr(certificate, name), value)
        ]
        differs += _recalibrated(certificate, family, runs)
    least_h = min(episode.least_h for episode in seen)
    return Checked(len(seeds), tuple(differs), tuple(_elsewhere(certificate)), least_h)


def stated_otherwise(c: Certificate, family: Family) -> list[str]:
    """Return a phrase for each field of a file that does not follow from its family and plant."""
    plant, declared = certify.plant_of(family)
    expected = {
        "plant": family.certifies(declared),
        "words": family.words,
        "family": families.to_dict(family),
    }
    differs = [
        f"{name}: {getattr(c, name)!r}, expected {value!r}"
        for name, value in expected.items()
        if records.plain(getattr(c, name)) != records.plain(value)
    ]
    if c.margins is not None:
        calibrated = CALIBRATED if c.calibration else ()
        expected_margins = plant.uncertainty._asdict()
        differs += [
            f"margins: {name} {value}, expected {expected_margins[name]} as the plant declares it"
            for name, value in c.margins._asdict().items()
            if name not in calibrated and value != expected_margins[name]
        ]
    return differs


def _drawn_otherwise(c: Certificate, family: Family) -> list[str]:
    """Return a phrase if the strata are not those that the seeds draw, else nothing."""
    drawn: Counter[tuple[str, str]] = Counter()
    for seed in range(c.first_seed, c.first_seed + c.episodes):
        drawn[families.stratum_of(family.episode(seed))] += 1
    stated = {(s.policy, s.scene): s.episodes for s in c.strata}
    if stated == dict(drawn):
        return []
    return [f"strata: {stated}, expected {dict(drawn)} as the seeds draw them"]


def _recalibrated(c: Certificate, family: Family, runs: Runs) -> list[str]:
    """Return a phrase for the rounds and for the margins if a new calibration gives others."""
    if not c.calibration or c.margins is None:
        return []
    first = c.calibration[0]
    start = c.margins._replace(**{name: first["margins"][name] for name in CALIBRATED})
    share, seed = c.bound / SAFER, c.first_seed // SEEDS
    try:
        now = certify.calibrated(family, start, runs, first["episodes"], share, seed)
    except HcbfError as error:
        return [f"calibration: {error}"]
    return [
        f"{name}: {stated}, now {value}"
        for name, stated, value in (
            ("calibration", c.calibration, calibration.plain(now.rounds)),
            ("margins", c.margins, now.margins),
        )
        if not _same(stated, value)
    ]


def _elsewhere(c: Certificate) -> list[str]:
    """Return a phrase for each version with which a certificate was computed, and that differs."""
    here, there = versions(), {"hcbf-gym": c.version} | dict(c.versions)
    return [
        f"{name} {there.get(name)} (here {here.get(name)})"
        for name in sorted({*here, *there})
        if there.get(name) != here.get(name)
    ]


def _same(stated: object, value: object) -> bool:
    """Return whether two fields of a certificate are equal, real numbers to `TOLERANCE`."""
    stated, value = (
        records.plain(vars(field) if is_dataclass(field) else field) for field in (stated, value)
    )
    if isinstance(stated, dict) and isinstance(value, dict):
        return set(stated) == set(value) and all(_same(stated[k], value[k]) for k in stated)
    if isinstance(stated, list) and isinstance(value, list):
        return len(stated) == len(value) and all(map(_same, stated, value))
    if isinstance(stated, float) and isinstance(value, float):
        return abs(stated - value) <= TOLERANCE * max(1.0, abs(stated))
    return type(stated) is type(value) and stated == value
