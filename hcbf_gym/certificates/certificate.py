"""The record of a certificate: what was frozen, what came out, and of which plant.

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
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from hcbf_gym import records
from hcbf_gym.certificates import sequential
from hcbf_gym.certificates.parts import BLOCK, Block, Shown, Stratum, check_counts, vacuous
from hcbf_gym.errors import InvalidInputError, finite_float
from hcbf_gym.models.plant import Uncertainty

SEEDS = 100_000_000  # of each `--seed`; the second half belongs to its certificates
TRY_SEEDS = 1_000_000  # of each try of a seed
PATTERNS = {
    "version": (r"\d+\.\d+\.\d+(\.dev\d+)?", "one such as '0.2.0'"),
    "commit": (
        r"([0-9a-f]{7,40}\+?)?",
        "'' or 7 to 40 hexadecimal digits, with a + where files were edited",
    ),
}
CALIBRATED = ("distance", "speed")  # of `Uncertainty`, what a calibration sets
TOTALS = ("episodes", "entered", "falls", "alarms")


def first_seed(seed: int, attempt: int) -> int:
    """Return the first seed of a try's episodes, which no calibration of the same seed draws."""
    return SEEDS * seed + SEEDS // 2 + TRY_SEEDS * attempt


@dataclass(frozen=True)
class Certificate:
    """How often a plant enters rank 1 at most, and all that this number was drawn from.

    With k of n independent episodes entered, P(enter) ≤ ε holds with confidence 1 − β as soon as
    e_n(ε) ≥ 1/β, see `certificates.sequential`. All fields before `episodes` were fixed before the
    first one; `hash` is of all fields.

    Args:
        name: of the certificate, as its file's.
        plant: what a plant must declare to be this one, ranges by name as `judge.judge`
            reads them; "scene" is the family of its scenes.
        family: of the episodes, as `hcbf_lab.certification.families` reads it.
        words: the same in sentences.
        margins: what rows reserved; None where the plant's own law decides it for each episode.
        calibration: what was done before, a mapping for each round and search.
        bound: ε.
        confidence: 1 − β.
        attempt: n of the n-th try of several, of which each spends β/2ⁿ; 0 for the only one.
        first_seed: of the episodes; the others follow it.
        version: of this package for which it was earned.
        commit: of the checkout that earned or last repeated it, abbreviated; "" where there was
            none.
        versions: of what computes beside it, by name.
        episodes: n, the first that were enough.
        entered: k.
        e_value: e_n(ε).
        least_h: over all episodes, of the strict conditions on the position [unit of h].
        falls: in how many episodes the robot fell.
        alarms: in how many the filter raised an alarm; with on_alarm="brake" the robot then
            stopped.
        shown: how much was put to the test.
        strata: counts by policy and family of scenes.
        blocks: what each `BLOCK` episodes showed.

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
        for source, name, expected in self._derived():
            value = self.shown.pressed if name == "pressed" else getattr(self, name)
            if not math.isclose(value, expected, rel_tol=1e-9):
                raise InvalidInputError(
                    f"certificate: got {name} {value}, expected {expected} as {source} gives it"
                )
        why = vacuous(self.shown, self.episodes)
        if why:
            raise InvalidInputError(f"certificate: {why}")

    def _derived(self) -> Iterator[tuple[str, str, float]]:
        """Yield (source, field, value) of all that follows from other fields."""
        yield "the try", "first_seed", first_seed(self.first_seed // SEEDS, self.attempt)
        needed = sequential.episodes_needed(self.bound, self.entered, self.doubt)
        yield "the bound", "episodes", needed
        yield "the bound", "e_value", sequential.e_value(self.entered, self.episodes, self.bound)
        for name in ("episodes", "entered"):
            yield "the sum of strata", name, sum(getattr(s, name) for s in self.strata)
        least = min((s.least_h for s in self.strata), default=math.inf)
        yield "the least of strata", "least_h", least
        for name in ("entered", "falls", "alarms", "pressed"):
            yield "the sum of blocks", name, sum(getattr(one, name) for one in self.blocks)
        yield "the least of blocks", "least_h", min(one.least_h for one in self.blocks)

    def _check_calibration(self) -> None:
        """Refuse rounds that reserved other things than those that were set."""
        if self.margins is None:
            return
        kept = {k: v for k, v in self.margins._asdict().items() if k not in CALIBRATED}
        for one in self.calibration:
            of_round = {k: v for k, v in one["margins"].items() if k not in CALIBRATED}
            if of_round != kept:
                raise InvalidInputError(
                    f"certificate: got a calibration with {of_round}, expected {kept} as in the "
                    "margins"
                )

    def _check_blocks(self) -> None:
        """Refuse blocks of another number or size, or whose counts contradict their least h."""
        if len(self.blocks) != -(-self.episodes // BLOCK):
            raise InvalidInputError(
                f"certificate: got {len(self.blocks)} blocks, expected one for every {BLOCK} of "
                f"{self.episodes} episodes"
            )
        for k, block in enumerate(self.blocks):
            most = min(BLOCK, self.episodes - k * BLOCK)
            check_counts(block, "entered", "pressed", "steps", "falls", "alarms")
            deepest = min(block.least_h, math.inf if (s := block.least_speed_h) is None else s)
            counts = (block.entered, block.pressed, block.falls, block.alarms)
            if not (max(counts) <= most and (deepest < 0.0) == (block.entered > 0)):
                raise InvalidInputError(
                    f"certificate: got {block}, expected counts of at most {most}, and entries "
                    "where a least h is below 0, and only there"
                )

    @property
    def doubt(self) -> float:
        """What this try may spend, β/2ⁿ."""
        return (1.0 - self.confidence) / 2.0**self.attempt

    @property
    def hash(self) -> str:
        """Of all fields."""
        text = json.dumps(self._fields(), sort_keys=True, allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()[:20]

    @property
    def weightings(self) -> dict[str, float]:
        """Bounds that hold for every weighting of families, by what they are families of."""
        groups: dict[str, dict[object, list[int]]] = {
            name: defaultdict(lambda: [0, 0])
            for name in ("scenes", "policies", "policies in scenes")
        }
        for s in self.strata:
            for name, key in zip(groups, (s.scene, s.policy, (s.policy, s.scene)), strict=True):
                count = groups[name][key]
                count[0], count[1] = count[0] + s.entered, count[1] + s.episodes
        return {
            name: sequential.any_weighting([(k, n) for k, n in counts.values()], self.doubt)
            for name, counts in groups.items()
        }

    @property
    def summary(self) -> str:
        """The number in one sentence."""
        return (
            f"{self.name}: {self.entered} of {self.episodes:,} episodes entered rank 1; "
            f"P(enter) ≤ {self.bound:.3g} with {self.confidence:.1%} confidence"
        )

    def to_dict(self) -> dict[str, object]:
        """Return it in JSON's terms, the bound and its counts first."""
        data = self._fields()
        first = ("name", "episodes", "entered", "bound", "confidence", "e_value", "try", "least_h")
        return {name: data.pop(name) for name in first} | {"hash": self.hash} | data

    def _fields(self) -> dict[str, object]:
        data = {field.name: getattr(self, field.name) for field in fields(self)}
        data["margins"] = None if self.margins is None else self.margins._asdict()
        data["shown"] = self.shown._asdict()
        data["strata"] = [asdict(stratum) for stratum in self.strata]
        data["try"] = data.pop("attempt")
        return records.plain(data)

    @classmethod
    def from_dict(cls, data: Any) -> "Certificate":
        """Return the certificate that `to_dict` made this of.

        Raises:
            InvalidInputError: if a field is missing, unknown or malformed, or anything has been
                changed since.
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
            InvalidInputError: if it cannot be read, or is none.
        """
        return cls.from_dict(records.read_json("certificate", path))

    def save(self, path: Path) -> None:
        """Write it to a JSON file, whole or not at all."""
        records.make_folder(path.parent)
        with records.whole(path) as partial:
            text = json.dumps(self.to_dict(), indent=1, allow_nan=False, ensure_ascii=False)
            partial.write_text(text + "\n", encoding="utf-8")
