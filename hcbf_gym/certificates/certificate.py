"""The record of a certificate: the plant, all that was fixed before the episodes, and the result.

>>> block = Block(0, BLOCK, 900, 0, 0, 0.012, None)
>>> certificate = Certificate(
...     name="boat", plant={"period": 0.02}, family={"kind": "own"}, words=("One boat.",),
...     margins=None, calibration=(), bound=0.1, confidence=0.999, attempt=0,
...     first_seed=first_seed(0, 0), version="0.2.0", commit="", versions={}, episodes=82,
...     entered=0, e_value=sequential.e_value(0, 82, 0.1), least_h=0.012, falls=0,
...     alarms=0, shown=Shown(82, 0.05, 90), strata=(Stratum("nearest", "random", 82, 0, 0.012),),
...     blocks=(*[block] * 8, block._replace(pressed=2)),
... )  # fmt: skip
>>> certificate.summary
'boat: 0 of 82 episodes entered rank 1; P(enter) ≤ 0.1 with 99.9% confidence'
"""

import hashlib
import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from hcbf_gym import records
from hcbf_gym.certificates import sequential
from hcbf_gym.certificates.parts import BLOCK, Block, Shown, Stratum, check_counts, vacuous
from hcbf_gym.errors import InvalidInputError, finite_float
from hcbf_gym.models.plant import Uncertainty

SEEDS = 100_000_000  # the seeds of each `--seed`; certificates draw from the second half of them
TRY_SEEDS = 1_000_000  # the number of seeds that each try has
PATTERNS = {
    "version": (r"\d+\.\d+\.\d+(\.dev\d+)?", "one such as '0.2.0'"),
    "commit": (
        r"([0-9a-f]{7,40}\+?)?",
        "'' or 7 to 40 hexadecimal digits, with a + where files were edited",
    ),
}
"""Text field → the pattern that it matches, and the pattern in words."""
CALIBRATED = ("distance", "speed")  # the fields of `Uncertainty` that a calibration sets
TOTALS = ("episodes", "entered", "falls", "alarms")  # the fields that count episodes


def first_seed(seed: int, attempt: int) -> int:
    """Return the first seed of a try's episodes; no calibration of the same seed draws them."""
    return SEEDS * seed + SEEDS // 2 + TRY_SEEDS * attempt


@dataclass(frozen=True)
class Certificate:
    """An upper bound on the probability that a plant enters rank 1, with its evidence.

    With k of n independent episodes entered, P(enter) ≤ ε holds with confidence 1 − β as soon as
    e_n(ε) ≥ 1/β, see `certificates.sequential`. All fields before `episodes` were fixed before the
    first one; `hash` is of all fields.

    Args:
        name: the name of the certificate, which is its file's.
        plant: the ranges of the values that a plant must declare, by name, as `ranges.parse_range`
            reads them; "scene" is the family of its scenes.
        family: the distribution of the episodes, as `hcbf_lab.certification.families` reads it.
        words: the family in sentences.
        margins: the margins that rows reserved; None where the plant's own law decides them for
            each episode.
        calibration: the rounds and searches that set the margins, a mapping for each.
        bound: ε.
        confidence: 1 − β.
        attempt: n of the n-th try of several, of which each spends β/2ⁿ; 0 for the only one.
        first_seed: the seed of the first episode; the others follow it.
        version: the version of this package for which the certificate was earned.
        commit: the abbreviated commit of the checkout that earned or last repeated it; "" if there
            was no checkout.
        versions: the versions of the other packages that compute, by name.
        episodes: n, the least number that was enough.
        entered: k.
        e_value: e_n(ε).
        least_h: the least h of the strict conditions on the position in all episodes [unit of h].
        falls: the number of episodes in which the robot fell.
        alarms: the number of episodes in which the filter raised an alarm; with on_alarm="brake"
            the robot then stopped.
        shown: figures that show how hard the episodes tested rank 1.
        strata: counts by policy and family of scenes.
        blocks: counts of every `BLOCK` episodes.

    Raises:
        InvalidInputError: if the numbers contradict each other.
    """

    name: str
    plant: Mapping[str, object]
    family: Mapping[str, object]
    words: tuple[str, ...]
    margins: Uncertainty | None
    calibration: tuple[Mapping[str, Any], ...]
    bound: float
    confidence: float
    attempt: int
    first_seed: int
    version: str
    commit: str
    versions: Mapping[str, str]
    episodes: int
    entered: int
    e_value: float
    least_h: float
    falls: int
    alarms: int
    shown: Shown
    strata: tuple[Stratum, ...]
    blocks: tuple[Block, ...]

    def __post_init__(self) -> None:
        check_counts(self, *TOTALS, "first_seed", "attempt")
        for name in ("least_h", "e_value", "confidence", "bound"):
            number = finite_float(f"certificate: {name}", getattr(self, name))
            if name in ("confidence", "bound") and not 0.0 < number < 1.0:
                raise InvalidInputError(
                    f"certificate: {name}: got {number}, expected a number between 0 and 1"
                )
        for name, (pattern, expected) in PATTERNS.items():
            text = getattr(self, name)
            if not (isinstance(text, str) and re.fullmatch(pattern, text)):
                raise InvalidInputError(
                    f"certificate: got the {name} {text!r}, expected {expected}"
                )
        self._check_calibration()
        self._check_blocks()
        for source, name, expected in self._derived_values():
            value = self.shown.pressed if name == "pressed" else getattr(self, name)
            if not math.isclose(value, expected, rel_tol=1e-9):
                raise InvalidInputError(
                    f"certificate: got {name} {value}, expected {expected} as {source} gives it"
                )
        why = vacuous(self.shown, self.episodes)
        if why:
            raise InvalidInputError(f"certificate: {why}")

    def _derived_values(self) -> Iterator[tuple[str, str, float]]:
        """Yield (source, field, value) of all fields that follow from others, the source."""
        yield "the try", "first_seed", first_seed(self.first_seed // SEEDS, self.attempt)
        needed = sequential.episodes_needed(self.bound, self.entered, self.doubt)
        yield "the bound", "episodes", needed
        yield "the bound", "e_value", sequential.e_value(self.entered, self.episodes, self.bound)
        for name in ("episodes", "entered"):
            yield "the sum of strata", name, sum(getattr(stratum, name) for stratum in self.strata)
        least = min((stratum.least_h for stratum in self.strata), default=math.inf)
        yield "the least of strata", "least_h", least
        for name in ("entered", "falls", "alarms", "pressed"):
            yield "the sum of blocks", name, sum(getattr(block, name) for block in self.blocks)
        yield "the least of blocks", "least_h", min(block.least_h for block in self.blocks)

    def _check_calibration(self) -> None:
        """Refuse rounds whose margins differ from these in a field that no calibration sets."""
        if self.margins is None:
            return
        expected = _not_calibrated(self.margins._asdict())
        for calibration_round in self.calibration:
            got = _not_calibrated(calibration_round["margins"])
            if got != expected:
                raise InvalidInputError(
                    f"certificate: got a calibration with {got}, expected {expected} as in the "
                    "margins"
                )

    def _check_blocks(self) -> None:
        """Refuse blocks of another number or size, or whose counts contradict their least h."""
        if len(self.blocks) != -(-self.episodes // BLOCK):  # rounded up
            raise InvalidInputError(
                f"certificate: got {len(self.blocks)} blocks, expected one for every {BLOCK} of "
                f"{self.episodes} episodes"
            )
        for k, block in enumerate(self.blocks):
            check_counts(block, "entered", "pressed", "steps", "falls", "alarms")
            size = min(BLOCK, self.episodes - k * BLOCK)
            largest = max(block.entered, block.pressed, block.falls, block.alarms)
            least_speed_h = math.inf if block.least_speed_h is None else block.least_speed_h
            is_entered = min(block.least_h, least_speed_h) < 0.0
            if largest > size or is_entered != (block.entered > 0):
                raise InvalidInputError(
                    f"certificate: got {block}, expected counts of at most {size}, and entries "
                    "where a least h is below 0, and only there"
                )

    @property
    def doubt(self) -> float:
        """The share of β that this try may spend, β/2ⁿ."""
        return (1.0 - self.confidence) / 2.0**self.attempt

    @property
    def hash(self) -> str:
        """The hash of all fields, 20 hexadecimal digits."""
        text = json.dumps(self._fields(), sort_keys=True, allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()[:20]

    @property
    def weightings(self) -> dict[str, float]:
        """Bounds that hold however the families are weighted, by the kind of the families."""
        families: dict[str, Callable[[Stratum], object]] = {
            "scenes": lambda stratum: stratum.scene,
            "policies": lambda stratum: stratum.policy,
            "policies in scenes": lambda stratum: (stratum.policy, stratum.scene),
        }
        bounds = {}
        for name, family_of in families.items():
            entered, episodes = Counter[object](), Counter[object]()
            for stratum in self.strata:
                entered[family_of(stratum)] += stratum.entered
                episodes[family_of(stratum)] += stratum.episodes
            counts = [(entered[family], episodes[family]) for family in episodes]
            bounds[name] = sequential.any_weighting(counts, self.doubt)
        return bounds

    @property
    def summary(self) -> str:
        """The result in one sentence."""
        return (
            f"{self.name}: {self.entered} of {self.episodes:,} episodes entered rank 1; "
            f"P(enter) ≤ {self.bound:.3g} with {self.confidence:.1%} confidence"
        )

    def to_dict(self) -> dict[str, object]:
        """Return the certificate in JSON's terms, the bound and its counts first."""
        data = self._fields()
        first = ("name", "episodes", "entered", "bound", "confidence", "e_value", "try", "least_h")
        return {name: data.pop(name) for name in first} | {"hash": self.hash} | data

    def _fields(self) -> dict[str, object]:
        """Return key → value of all fields in JSON's terms; `attempt` has the key "try"."""
        data = {field.name: getattr(self, field.name) for field in fields(self)}
        data["margins"] = None if self.margins is None else self.margins._asdict()
        data["shown"] = self.shown._asdict()
        data["strata"] = [asdict(stratum) for stratum in self.strata]
        data["try"] = data.pop("attempt")
        return records.plain(data)

    @classmethod
    def from_dict(cls, data: Any) -> "Certificate":
        """Return the certificate of a mapping that `to_dict` made.

        Raises:
            InvalidInputError: if a field is missing, unknown or malformed, or was changed since.
        """
        records.check_mapping("certificate", data)
        try:
            json.dumps(data, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise InvalidInputError(f"certificate: got {error}, expected JSON's terms") from error
        values = {name: value for name, value in data.items() if name != "hash"}
        try:
            for name in ("words", "calibration"):
                values[name] = tuple(values[name])
            if values["margins"] is not None:
                values["margins"] = Uncertainty(**values["margins"])
            values["shown"] = Shown(**values["shown"])
            values["blocks"] = tuple(Block(*block) for block in values["blocks"])
            values["strata"] = tuple(Stratum(**stratum) for stratum in values["strata"])
            values["attempt"] = values.pop("try")
            certificate: Certificate = records.build("certificate", cls, values)
        except (KeyError, TypeError, AttributeError, OverflowError) as error:
            raise InvalidInputError(
                f"certificate: got {error!r}, expected the fields {[f.name for f in fields(cls)]} "
                "as `hcbf certify` writes them"
            ) from error
        if data.get("hash") != certificate.hash:
            raise InvalidInputError(
                f"certificate {certificate.name!r}: got the hash {data.get('hash')!r}, expected "
                f"{certificate.hash!r} of its fields: the file was changed"
            )
        return certificate

    @classmethod
    def load(cls, path: str | Path) -> "Certificate":
        """Read a certificate from its JSON file.

        Raises:
            InvalidInputError: if the file cannot be read, or holds no valid certificate.
        """
        return cls.from_dict(records.read_json("certificate", path))

    def save(self, path: Path) -> None:
        """Write the certificate to a JSON file, whole or not at all."""
        records.make_folder(path.parent)
        with records.whole(path) as partial:
            text = json.dumps(self.to_dict(), indent=1, allow_nan=False, ensure_ascii=False)
            partial.write_text(text + "\n", encoding="utf-8")


def _not_calibrated(margins: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of margins that no calibration sets."""
    return {name: value for name, value in margins.items() if name not in CALIBRATED}
