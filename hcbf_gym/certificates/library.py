"""The certificates that come with the package, and the choice of one that fits a plant."""

import json
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from hcbf_gym import version
from hcbf_gym.certificates.certificate import Certificate
from hcbf_gym.certificates.judge import Judged, judge, judge_scene
from hcbf_gym.errors import CoverageWarning, InvalidInputError, shown, warn_caller
from hcbf_gym.models.plant import Coverage, CoveredBy, Uncertainty

FOLDER = Path(__file__).with_name("shipped")
"""The folder of the shipped certificates: one JSON file each, with the certificate's name."""

TESTED = Path(__file__).with_name("tested.json")
"""Ranges that were tested but that no certificate holds: of the filter's arguments, of its plant,
and the wider ranges of an environment that one argument alone may use, see `AloneRule`."""


@cache
def tested() -> Mapping[str, Any]:
    """Return the content of `TESTED`."""
    return MappingProxyType(json.loads(TESTED.read_text(encoding="utf-8")))


def of_another_version(certificate: Certificate | None = None) -> str:
    """Return why this certificate, or any, is not valid for this version; "" if it is."""
    installed = version.VERSION
    if ".dev" in installed:
        return (
            f"hcbf-gym {installed} is a development version: the filter works as in a release, but "
            "no certificate was earned for it, so that covered is 0 (VERSION)"
        )
    if certificate is None or certificate.version == version.release():
        return ""
    return (
        f"the certificate {certificate.name!r} was earned for hcbf-gym {certificate.version}, and "
        f"this is {installed}: covered is 0 (VERSION); install hcbf-gym=={certificate.version}, or "
        "earn it again by `hcbf certify`"
    )


@cache
def warn_of_version(why: str) -> None:
    """Warn once a process with a sentence that `of_another_version` returned."""
    warn_caller(why, CoverageWarning)


@cache
def shipped() -> Mapping[str, Certificate]:
    """Return name → certificate of all that come with the package."""
    files = sorted(FOLDER.glob("*.json"))
    return MappingProxyType({file.stem: Certificate.load(file) for file in files})


def load(source: str | Path | Mapping[str, object] | Certificate) -> Certificate:
    """Return a certificate.

    Args:
        source: a certificate, the path of its file, its plain form, or the name of a shipped one.

    Raises:
        InvalidInputError: if it is none of these.
    """
    if isinstance(source, Certificate):
        return source
    if isinstance(source, Mapping):
        return Certificate.from_dict(source)
    if not isinstance(source, str | Path):
        raise InvalidInputError(
            f"certificate: got {shown(source)}, expected a Certificate, its plain form, a file, or "
            f"one of {', '.join(shipped())}"
        )
    named = shipped().get(str(source))
    return Certificate.load(source) if named is None else named


def file_of(source: str) -> Path:
    """Return the file of a shipped certificate's name, or the path itself if it is no name."""
    return FOLDER / f"{source}.json" if source in shipped() else Path(source)


def judged_by(
    certificate: Certificate,
    declared: Mapping[str, object],
    alone: Mapping[str, Any] | None = None,
) -> Judged:
    """Return the verdict whether a certificate covers a plant in this version of the package.

    Args:
        certificate: a certificate of any plant and version.
        declared: the values that the plant declares, see `certificates.declared`.
        alone: wider ranges that one argument alone may use, see `judge`.
    """
    verdict = judge(declared, certificate.plant, alone)
    why = of_another_version(certificate)
    if verdict.outside or not why:
        return verdict
    return Judged(Coverage.OUTSIDE, CoveredBy.VERSION, (why,))


class NearestCertificate(NamedTuple):
    """The shipped certificate that differs least from what a plant declares."""

    certificate: Certificate | None  # None if no certificate has the environment and the robot
    judged: Judged  # the verdict whether it covers the plant

    def again(self, declared: Mapping[str, object]) -> Judged:
        """Return the verdict on the same plant in another scene, `declared["scene"]`."""
        if self.judged.outside or self.certificate is None:
            return self.judged
        return judge_scene(declared["scene"], self.certificate.plant["scene"])

    def despite(self, complaints: Iterable[str]) -> "NearestCertificate":
        """Return the certificate with complaints about the plant; with any, it covers nothing."""
        reasons = tuple(complaints)
        if not reasons:
            return self
        reasons = (*self.judged.reasons, *reasons)
        return self._replace(judged=Judged(Coverage.OUTSIDE, CoveredBy.ARGUMENT, reasons))

    @property
    def margins(self) -> Uncertainty | None:
        """The margins that rows reserve; None if it is another plant's, or its law decides them."""
        is_of_another = self.judged.covered_by in (CoveredBy.ARGUMENT, CoveredBy.UNKNOWN)
        return None if self.certificate is None or is_of_another else self.certificate.margins


def nearest(declared: Mapping[str, Any]) -> NearestCertificate:
    """Return the shipped certificate that fits a plant best: the one with the fewest reasons.

    Args:
        declared: the values that the plant declares; only certificates of its "environment" and
            "robot" are compared.
    """
    alone = tested()["alone"].get(declared["environment"])
    candidates = [
        NearestCertificate(certificate, judged_by(certificate, declared, alone))
        for certificate in shipped().values()
        if all(certificate.plant.get(key) == declared.get(key) for key in ("environment", "robot"))
    ]
    if candidates:
        return min(candidates, key=lambda candidate: len(candidate.judged.reasons))
    name = str(declared.get("robot")).rpartition(" ")[0]  # without the hash, see `robot_of`
    reasons = (
        f"robot {name!r}, of which no certificate is shipped: hcbf certify makes one",
        *(f"{departure} (tested: none)" for departure in declared.get("departures", ())),
    )
    return NearestCertificate(None, Judged(Coverage.OUTSIDE, CoveredBy.UNKNOWN, reasons))


def at_least(margins: Uncertainty, robot: str) -> Uncertainty:
    """Return margins that are no smaller than those of a robot's certificate.

    Even in another environment, its calibration has more episodes than other sources of margins.

    Args:
        margins: the margins of the robot as it is used.
        robot: its name in certificates, see `declared.robot_of`.
    """
    for certificate in shipped().values():
        certified = certificate.margins
        if certified is not None and certificate.plant.get("robot") == robot:
            margins = margins._replace(
                distance=max(margins.distance, certified.distance),
                speed=max(margins.speed, certified.speed),
            )
    return margins
