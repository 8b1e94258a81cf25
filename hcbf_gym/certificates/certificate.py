"""The record of a certificate: what was frozen, what came out, and what it says of a plant.

>>> stratum = Stratum("nearest", "random", 688, 0, 0.012)
>>> certificate = Certificate(
...     name="boat", plant={"period": 0.02}, family={"kind": "own"}, words=("One boat.",),
...     margins=None, calibration=(), episodes=688, allowed=0, confidence=0.999, first_seed=7,
...     versions={}, sources="", entered=0, bound=0.01, least_h=0.012, falls=0, alarms=0,
...     strata=(stratum,), blocks=block_digests(np.full((688, 2), 0.012)),
... )  # fmt: skip
>>> certificate.differs({"period": 0.05})
['period 0.05 (certified: 0.02)']
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr

from hcbf_gym import records
from hcbf_gym.errors import InvalidInputError, finite_float
from hcbf_gym.models.plant import Coverage, Uncertainty

Array = NDArray[np.float64]

BLOCK = 10
"""Episodes of which one digest is kept, so that a part can be repeated and compared."""

FROZEN = (
    "plant",
    "family",
    "words",
    "margins",
    "episodes",
    "allowed",
    "confidence",
    "first_seed",
    "versions",
    "sources",
)
"""The fields that are fixed, and hashed, before the first episode of a certificate."""

ROUNDED = 1e-6
"""By how much the binomial probability of a bound may differ from what was asked."""


@dataclass(frozen=True)
class Stratum:
    """What one policy did in one family of scenes.

    Args:
        policy: an attack's name, or a policy's.
        scene: the family's name; "own" where the environment draws its scenes by itself.
        episodes: how many were drawn.
        entered: in how many rank 1 was entered.
        least_h: of the strict conditions on the position [unit of h].

    Raises:
        InvalidInputError: if a number is none, or contradicts another.
    """

    policy: str
    scene: str
    episodes: int
    entered: int
    least_h: float

    def __post_init__(self) -> None:
        _check_counts(self, "episodes", "entered")
        finite_float("certificate: least_h", self.least_h)
        if not (self.least_h < 0.0) <= self.entered <= self.episodes:
            raise InvalidInputError(
                f"certificate: got {self}, expected between 0 and all of its episodes entered, "
                "and one of them where its least h is below 0"
            )


@dataclass(frozen=True)
class Certificate:
    """How often a plant enters rank 1 at most, and all that this number was drawn from.

    With k of n independent episodes entered, P(enter) ≤ BetaInv(c; k + 1, n − k) holds with
    confidence c (Clopper and Pearson); n, the allowed k and all that `hash` covers were fixed
    before the first episode.

    Args:
        name: what it is called.
        plant: what a plant must declare to be this one: a value, ``{"any of": […]}``, or
            ``{"from": a, "to": b}``, by name; "scene" is the family of its scenes.
        family: what the episodes were drawn from, as `evaluation.certification` reads it.
        words: the same in sentences.
        margins: what rows reserved; None where the plant's own law says it for each episode.
        calibration: what was done before, a mapping for each round and search.
        episodes: n.
        allowed: how many were allowed to enter.
        confidence: c.
        first_seed: of the n episodes; the others follow it.
        versions: of what computes, by name.
        sources: a hash of the program's sources and of the user's files.
        entered: k.
        bound: the greatest chance of entering that is in accord with this.
        least_h: over all episodes, of the strict conditions on the position [unit of h].
        falls: in how many episodes the robot fell.
        alarms: in how many the filter raised an alarm; with on_alarm="brake" the robot then stood.
        strata: counts by policy and family of scenes.
        blocks: a digest of the least h's of every `BLOCK` episodes.

    Raises:
        InvalidInputError: if the numbers contradict each other.
    """

    name: str
    plant: Mapping[str, Any]
    family: Mapping[str, Any]
    words: tuple[str, ...]
    margins: Uncertainty | None
    calibration: tuple[Mapping[str, Any], ...]
    episodes: int
    allowed: int
    confidence: float
    first_seed: int
    versions: Mapping[str, str]
    sources: str
    entered: int
    bound: float
    least_h: float
    falls: int
    alarms: int
    strata: tuple[Stratum, ...]
    blocks: tuple[str, ...]

    def __post_init__(self) -> None:
        _check_counts(self, "episodes", "allowed", "entered", "falls", "alarms", "first_seed")
        for name in ("confidence", "bound"):
            finite_float(f"certificate: {name}", getattr(self, name), minimum=0.0, maximum=1.0)
        finite_float("certificate: least_h", self.least_h)
        if not self.entered <= self.allowed < self.episodes:
            raise InvalidInputError(
                f"certificate: got {self.entered} entered and {self.allowed} allowed of "
                f"{self.episodes} episodes, expected entered <= allowed < episodes"
            )
        doubt = float(bdtr(self.entered, self.episodes, self.bound))
        if doubt > (1.0 - self.confidence) * (1.0 + ROUNDED) + ROUNDED * 1e-3:
            raise InvalidInputError(
                f"certificate: got the bound {self.bound} for {self.entered} of {self.episodes}, "
                f"expected what {self.confidence:.1%} confidence gives"
            )
        counted = (sum(s.episodes for s in self.strata), sum(s.entered for s in self.strata))
        if counted != (self.episodes, self.entered):
            raise InvalidInputError(
                f"certificate: got strata of {counted[0]} episodes with {counted[1]} entered, "
                f"expected {self.episodes} with {self.entered}"
            )
        deepest = min(s.least_h for s in self.strata)
        if self.least_h != deepest:
            raise InvalidInputError(
                f"certificate: got the least h {self.least_h}, expected {deepest} as in its strata"
            )
        if max(self.falls, self.alarms) > self.episodes:
            raise InvalidInputError(
                f"certificate: got {self.falls} falls and {self.alarms} alarms, expected no more "
                f"than {self.episodes} episodes"
            )
        if len(self.blocks) != -(-self.episodes // BLOCK):
            raise InvalidInputError(
                f"certificate: got {len(self.blocks)} blocks, expected one for every {BLOCK} of "
                f"{self.episodes} episodes"
            )

    @property
    def hash(self) -> str:
        """What tells this frozen description from any other."""
        return frozen_hash({name: getattr(self, name) for name in FROZEN})

    @property
    def says(self) -> str:
        """The number in one sentence."""
        return (
            f"{self.name}: {self.entered} of {self.episodes:,} episodes entered rank 1; "
            f"P(enter) ≤ {self.bound:.3g} with {self.confidence:.1%} confidence"
        )

    def differs(self, declared: Mapping[str, Any]) -> list[str]:
        """Return in what a plant is not the certified one, a phrase for each; empty if in nothing.

        Args:
            declared: what the plant declares, as `certificates.declared` reads it.
        """
        return [
            f"{name} {declared.get(name)!r} (certified: {_told(expected)})"
            for name, expected in self.plant.items()
            if name != "scene" and not _is_of(declared.get(name), expected)
        ]

    def covers(self, declared: Mapping[str, Any]) -> Coverage:
        """Return whether it speaks of a plant, and of the family of its scenes.

        Args:
            declared: as `differs` takes it.
        """
        if self.differs(declared):
            return Coverage.OUTSIDE
        asked = self.plant.get("scene")
        inside = _is_of(declared.get("scene"), asked)
        return Coverage.COVERED if inside else Coverage.SCENE

    def to_dict(self) -> dict[str, Any]:
        """Return it in JSON's terms, what matters first."""
        data = {field.name: getattr(self, field.name) for field in fields(self)}
        if self.margins is not None:
            data["margins"] = self.margins._asdict()
        data["strata"] = [asdict(stratum) for stratum in self.strata]
        first = ("name", "episodes", "entered", "bound", "confidence", "allowed", "least_h")
        ordered = {name: data.pop(name) for name in first} | {"hash": self.hash} | data
        return records.plain(ordered)

    @classmethod
    def from_dict(cls, data: Any) -> "Certificate":
        """Return the certificate that `to_dict` made this of.

        Raises:
            InvalidInputError: if a field is missing, unknown or malformed, or what was frozen has
                been changed since.
        """
        records.check_mapping("certificate", data)
        try:
            json.dumps(data, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise InvalidInputError(f"certificate: got {error}, expected JSON's terms") from error
        values = {name: value for name, value in data.items() if name != "hash"}
        try:
            for name in ("words", "calibration", "blocks"):
                values[name] = tuple(values[name])
            if values["margins"] is not None:
                values["margins"] = Uncertainty(**values["margins"])
            values["strata"] = tuple(Stratum(**stratum) for stratum in values["strata"])
        except (KeyError, TypeError) as error:
            raise InvalidInputError(
                f"certificate: got {error}, expected the fields {[f.name for f in fields(cls)]}"
            ) from error
        certificate = records.build("certificate", cls, values)
        if data.get("hash") != certificate.hash:
            raise InvalidInputError(
                f"certificate {certificate.name!r}: got the hash {data.get('hash')!r}, expected "
                f"{certificate.hash!r} of what it says was frozen: the file was changed"
            )
        return certificate

    @classmethod
    def load(cls, path: str | Path) -> "Certificate":
        """Read a certificate from its JSON file.

        Raises:
            InvalidInputError: if it cannot be read, or is none.
        """
        try:
            data = json.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise InvalidInputError(
                f"certificate: got {str(path)!r} ({error}), expected a JSON file that "
                "`hcbf certify` wrote"
            ) from error
        return cls.from_dict(data)

    def save(self, path: Path) -> None:
        """Write it to a JSON file, whole or not at all."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with records.whole(path) as partial:
            text = json.dumps(self.to_dict(), indent=1, allow_nan=False, ensure_ascii=False)
            partial.write_text(text + "\n", encoding="utf-8")


def _check_counts(record: Any, *names: str) -> None:
    """Refuse fields that are no counts.

    Raises:
        InvalidInputError: if there is one.
    """
    for name in names:
        number = getattr(record, name)
        if isinstance(number, bool) or not isinstance(number, int) or number < 0:
            raise InvalidInputError(f"certificate: {name}: got {number!r}, expected a count")


def frozen_hash(frozen: Mapping[str, Any]) -> str:
    """Return a hash of a description in JSON's terms."""
    plain = records.plain(frozen)
    text = json.dumps(plain, sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def block_digests(least: Array) -> tuple[str, ...]:
    """Return a digest of every `BLOCK` episodes, equal where they are the same bit for bit.

    Args:
        least: (n, 2) of each episode the least strict h on the position and of the speed limit.
    """
    starts = range(0, len(least), BLOCK)
    rows = np.ascontiguousarray(least, dtype="<f8")
    return tuple(hashlib.sha256(rows[k : k + BLOCK].tobytes()).hexdigest()[:12] for k in starts)


def _is_of(got: Any, expected: Any) -> bool:
    """Tell whether a declared value is the certified one, among several, or in a range."""
    got = records.plain(got)
    if isinstance(expected, Mapping) and set(expected) == {"any of"}:
        return got in expected["any of"]
    if isinstance(expected, Mapping) and set(expected) == {"from", "to"}:
        number = isinstance(got, int | float) and not isinstance(got, bool)
        return number and bool(expected["from"] <= got <= expected["to"])
    return bool(got == records.plain(expected))


def _told(expected: Any) -> str:
    if isinstance(expected, Mapping) and set(expected) == {"any of"}:
        values: Sequence[Any] = expected["any of"]
        return ", ".join(map(str, values))
    if isinstance(expected, Mapping) and set(expected) == {"from", "to"}:
        return f"{expected['from']:g} to {expected['to']:g}"
    return repr(expected)
