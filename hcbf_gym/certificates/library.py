"""The certificates that come with the package, and which of them speaks of a plant."""

from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from hcbf_gym.certificates.certificate import Certificate
from hcbf_gym.models.plant import Uncertainty

FOLDER = Path(__file__).with_name("shipped")
"""Where they lie, one JSON file each; its name is the certificate's."""


@cache
def shipped() -> Mapping[str, Certificate]:
    """Return name → certificate of those that come with the package."""
    files = sorted(FOLDER.glob("*.json"))
    return MappingProxyType({file.stem: Certificate.load(file) for file in files})


def load(source: str | Path | Mapping[str, Any] | Certificate) -> Certificate:
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
    known = shipped().get(str(source))
    return Certificate.load(source) if known is None else known


class Nearest(NamedTuple):
    """The shipped certificate that differs least from what a plant declares.

    Attributes:
        certificate: None where none is of such an environment.
        differs: in what the plant is not the certified one, a phrase for each.
    """

    certificate: Certificate | None
    differs: list[str]

    @property
    def margins(self) -> Uncertainty | None:
        """What rows reserve by it; None where it speaks of another plant, or leaves it to a law."""
        return None if self.certificate is None or self.differs else self.certificate.margins


def nearest(declared: Mapping[str, Any]) -> Nearest:
    """Return the shipped certificate that fits a plant best.

    Args:
        declared: what the plant declares; "environment" and "robot" must be the certified ones.
    """
    alike = [
        Nearest(one, one.differs(declared))
        for one in shipped().values()
        if all(one.plant.get(key) == declared.get(key) for key in ("environment", "robot"))
    ]
    return min(alike, key=lambda found: len(found.differs), default=Nearest(None, []))


def at_least(margins: Uncertainty, robot: str) -> Uncertainty:
    """Return margins of a robot that are no smaller than what a certificate found that it needs.

    A certificate does not speak of another door, floor or cap, but its calibration has seen more
    episodes than whatever the margins come from.

    Args:
        margins: of the robot as it is used.
        robot: what certificates call it, see `declared.robot_of`.
    """
    for one in shipped().values():
        if one.margins is not None and one.plant.get("robot") == robot:
            margins = margins._replace(
                distance=max(margins.distance, one.margins.distance),
                speed=max(margins.speed, one.margins.speed),
            )
    return margins


def table(certificates: Iterable[Certificate] | None = None) -> str:
    """Return certificates as pages show them, a table in Markdown.

    Args:
        certificates: the lines; None shows those that are shipped.
    """
    head = ("certificate", "episodes", "entered", "P(enter) ≤", "confidence", "least h [m]")
    rows = [
        f"| {one.name} | {one.episodes:,} | {one.entered} | {one.bound:.2g} | "
        f"{one.confidence:.1%} | {one.least_h:+.4f} |"
        for one in (shipped().values() if certificates is None else certificates)
    ]
    return "\n".join((f"| {' | '.join(head)} |", "|---" * len(head) + "|", *rows))
