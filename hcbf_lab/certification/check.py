"""A certificate repeated: its episodes, and all that follows from them and from its family."""

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

SAME = 1e-6
"""By how much a least h may differ [unit of h]."""
SAFER = 10.0
"""By how much less often than the bound an episode may need more than calibration reserves."""


@dataclass(frozen=True)
class Checked:
    """What a repetition of a part showed."""

    episodes: int  # how many were run again
    differs: tuple[str, ...]  # in what the file differs from what came out, a phrase for each
    elsewhere: tuple[str, ...]  # in what it was computed otherwise than here, a phrase for each
    least_h: float  # of the repeated episodes


def check(certificate: Certificate, episodes: int, seed: int, runs: Runs) -> Checked:
    """Run a random part of a certificate's episodes again; of all of them, calibration, too.

    Args:
        certificate: to check.
        episodes: at least so many, in whole blocks.
        seed: decides which.
        runs: how they run.
    """
    family = families.from_dict(certificate.family)
    differs = stated_otherwise(certificate, family) + _drawn_otherwise(certificate, family)
    count = min(len(certificate.blocks), -(-episodes // BLOCK))
    chosen = np.random.default_rng(seed).permutation(len(certificate.blocks))[:count]
    numbers = [
        number
        for block in sorted(chosen.tolist())
        for number in range(block * BLOCK, min((block + 1) * BLOCK, certificate.episodes))
    ]
    job = functools.partial(run_seed, family, certificate.margins)
    jobs = [certificate.first_seed + number for number in numbers]
    seen: list[Seen] = in_order(certify.over(runs, family, job, jobs, "check"))
    again = certify.outcome(seen, certificate.bound)
    for block, shown in zip(sorted(chosen.tolist()), again["blocks"], strict=True):
        if not _same(certificate.blocks[block], shown):
            first = certificate.first_seed + block * BLOCK
            differs.append(f"block from seed {first}: {certificate.blocks[block]}, now {shown}")
    if count == len(certificate.blocks):
        differs += [
            f"{name}: {getattr(certificate, name)}, now {value}"
            for name, value in again.items()
            if name != "blocks" and not _same(getattr(certificate, name), value)
        ]
        differs += _recalibrated(certificate, family, runs)
    return Checked(
        len(jobs), tuple(differs), tuple(_elsewhere(certificate)), min(s.least_h for s in seen)
    )


def stated_otherwise(c: Certificate, family: Family) -> list[str]:
    """Return in what a file differs from its family, a phrase for each."""
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
        own = plant.uncertainty._asdict()
        differs += [
            f"margins: {name} {value}, expected {own[name]} as the plant declares it"
            for name, value in c.margins._asdict().items()
            if name not in (CALIBRATED if c.calibration else ()) and value != own[name]
        ]
    return differs


def _drawn_otherwise(c: Certificate, family: Family) -> list[str]:
    """Return in what the strata are not those that the seeds draw, a phrase or none."""
    drawn: Counter[tuple[str, str]] = Counter()
    for seed in range(c.first_seed, c.first_seed + c.episodes):
        drawn[families.stratum_of(family.episode(seed))] += 1
    stated = {(s.policy, s.scene): s.episodes for s in c.strata}
    if stated == dict(drawn):
        return []
    return [f"strata: {stated}, expected {dict(drawn)} as the seeds draw them"]


def _recalibrated(c: Certificate, family: Family, runs: Runs) -> list[str]:
    """Return in what margins and rounds are not those that a calibration gives."""
    if not c.calibration or c.margins is None:
        return []
    first = c.calibration[0]
    start = c.margins._replace(**{name: first["margins"][name] for name in CALIBRATED})
    share, seed = c.bound / SAFER, c.first_seed // SEEDS
    try:
        found = certify.calibrated(family, start, runs, first["episodes"], share, seed)
    except HcbfError as error:
        return [f"calibration: {error}"]
    return [
        f"{name}: {stated}, now {value}"
        for name, stated, value in (
            ("calibration", c.calibration, calibration.plain(found.rounds)),
            ("margins", c.margins, found.margins),
        )
        if not _same(stated, value)
    ]


def _elsewhere(c: Certificate) -> list[str]:
    """Return in what a certificate was computed otherwise than here."""
    here, there = versions(), {"hcbf-gym": c.version} | dict(c.versions)
    return [
        f"{name} {there.get(name)} (here {here.get(name)})"
        for name in sorted({*here, *there})
        if there.get(name) != here.get(name)
    ]


def _same(stated: object, value: object) -> bool:
    """Return whether two are alike, numbers to within `SAME`."""
    stated, value = (
        records.plain(vars(one) if is_dataclass(one) else one) for one in (stated, value)
    )
    if isinstance(stated, dict) and isinstance(value, dict):
        return set(stated) == set(value) and all(_same(stated[k], value[k]) for k in stated)
    if isinstance(stated, list) and isinstance(value, list):
        return len(stated) == len(value) and all(map(_same, stated, value))
    if isinstance(stated, float) and isinstance(value, float):
        return abs(stated - value) <= SAME * max(1.0, abs(stated))
    return type(stated) is type(value) and stated == value
