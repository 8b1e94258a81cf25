"""The certificates that come with the package, and which of them fits a plant."""

import json
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from hcbf_gym import version
from hcbf_gym.certificates.certificate import Certificate
from hcbf_gym.certificates.judge import Judged, judge
from hcbf_gym.errors import CoverageWarning, InvalidInputError, shown, warn_caller
from hcbf_gym.models.plant import Coverage, CoveredBy, Uncertainty

FOLDER = Path(__file__).with_name("shipped")
"""Of the shipped ones, one JSON file each; its name is the certificate's."""

TESTED = Path(__file__).with_name("tested.json")
"""Ranges that were tested without a number of their own: of the filter's arguments, of its plant,
and of an environment's arguments of which one alone may be left for a wider range."""


@cache
def tested() -> Mapping[str, Any]:
    """Return the content of `TESTED`."""
    return MappingProxyType(json.loads(TESTED.read_text(encoding="utf-8")))


def of_another_version(certificate: Certificate | None = None) -> str:
    """Return why a certificate, or any of this version, covers nothing; "" where it does."""
    here = version.VERSION
    if ".dev" in here:
        return (
            f"hcbf-gym {here} is a development version: the filter works as in a release, but no "
            "certificate was earned for it, so that covered is 0 (VERSION)"
        )
    if certificate is None or certificate.version == version.release():
        return ""
    return (
        f"the certificate {certificate.name!r} was earned for hcbf-gym {certificate.version}, and "
        f"this is {here}: covered is 0 (VERSION); install hcbf-gym=={certificate.version}, or earn "
        "it again by `hcbf certify`"
    )


@cache
def warn_of_version(why: str) -> None:
    """Warn once a process of what `of_another_version` returns."""
    warn_caller(why, CoverageWarning)


@cache
def shipped() -> Mapping[str, Certificate]:
    """Return name → certificate of those that come with the package."""
    files = sorted(FOLDER.glob("*.json"))
    return MappingProxyType({file.stem: Certificate.load(file) for file in files})


def load(source: str | Path | Mapping[str, object] | Certificate) -> Certificate:
    """Return a certificate.

    Args:
        source: itself, the path of its file, its plain form, or the name of a shipped one.

    Raises:
        InvalidInputError: if there is none.
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
    known = shipped().get(str(source))
    return Certificate.load(source) if known is None else known


def file_of(source: str) -> Path:
    """Return the file of a shipped certificate's name; a path is itself."""
    return FOLDER / f"{source}.json" if source in shipped() else Path(source)


def judged_by(
    certificate: Certificate,
    declared: Mapping[str, object],
    alone: Mapping[str, Any] | None = None,
) -> Judged:
    """Return whether a certificate covers a plant in this version of the package.

    Args:
        certificate: any.
        declared: what the plant declares, see `certificates.declared`.
        alone: what was tested besides, see `judge`.
    """
    judged = judge(declared, certificate.plant, alone)
    why = of_another_version(certificate)
    if judged.outside or not why:
        return judged
    return Judged(Coverage.OUTSIDE, CoveredBy.VERSION, (why,))


class NearestCertificate(NamedTuple):
    """The shipped certificate that differs least from what a plant declares."""

    certificate: Certificate | None  # None where none is of such an environment and robot
    judged: Judged  # whether it covers the plant

    def again(self, declared: Mapping[str, object]) -> Judged:
        """Return whether it covers the plant in another scene, `declared["scene"]`."""
        if self.judged.outside or self.certificate is None:
            return self.judged
        return judge({"scene": declared["scene"]}, {"scene": self.certificate.plant["scene"]})

    def despite(self, complaints: Iterable[str]) -> "NearestCertificate":
        """Return it with sentences about where the plant does not follow; they cover nothing."""
        reasons = tuple(complaints)
        if not reasons:
            return self
        reasons = (*self.judged.reasons, *reasons)
        return self._replace(judged=Judged(Coverage.OUTSIDE, CoveredBy.ARGUMENT, reasons))

    @property
    def margins(self) -> Uncertainty | None:
        """What rows reserve by it; None where it is of another plant, or leaves it to a law."""
        other = self.judged.covered_by in (CoveredBy.ARGUMENT, CoveredBy.UNKNOWN)
        return None if self.certificate is None or other else self.certificate.margins


def nearest(declared: Mapping[str, Any]) -> NearestCertificate:
    """Return the shipped certificate that fits a plant best.

    Args:
        declared: what the plant declares; "environment" and "robot" must be the certified ones.
    """
    alone = tested()["alone"].get(declared["environment"])
    alike = [
        NearestCertificate(one, judged_by(one, declared, alone))
        for one in shipped().values()
        if all(one.plant.get(key) == declared.get(key) for key in ("environment", "robot"))
    ]
    name = str(declared.get("robot")).rpartition(" ")[0]
    reasons = (
        f"robot {name!r}, of which no certificate is shipped: hcbf certify makes one",
        *(f"{departure} (tested: none)" for departure in declared.get("departures", ())),
    )
    none = NearestCertificate(None, Judged(Coverage.OUTSIDE, CoveredBy.UNKNOWN, reasons))
    return min(alike, key=lambda found: len(found.judged.reasons), default=none)


def at_least(margins: Uncertainty, robot: str) -> Uncertainty:
    """Return margins that are no smaller than those of a robot's certificate.

    Such a certificate may be of another environment, but its calibration has seen more episodes
    than any other source of margins.

    Args:
        margins: of the robot as it is used.
        robot: its name in certificates, see `declared.robot_of`.
    """
    for one in shipped().values():
        if one.margins is not None and one.plant.get("robot") == robot:
            margins = margins._replace(
                distance=max(margins.distance, one.margins.distance),
                speed=max(margins.speed, one.margins.speed),
            )
    return margins
