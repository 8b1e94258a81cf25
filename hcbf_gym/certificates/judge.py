"""The judge of `covered`: it compares the values that a plant declares with the tested ranges.

Ranges are JSON, in certificates and in `tested.json`:

* ``{"any of": [range, …]}`` contains the values of each of its ranges;
* ``{"from": a, "to": b}`` contains numbers, and lists of numbers that are all between its ends.
  One end may be missing. An end may also be the name of another declared value;
* ``{"each": {name: range, …}}`` and ``{"each": [range, …]}`` contain records and lists of which
  every part is in its own range;
* any other value contains only itself.

"unit" is the unit of a range's numbers, and "words" describe a range in a message.

>>> judge({"gait": "walk", "delay": [0.0, 0.01]}, {"gait": "trot", "delay": {"to": 0.02}}).reasons
("gait 'walk' (tested: 'trot')",)
"""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np

from hcbf_gym import records
from hcbf_gym.arrays import Integers
from hcbf_gym.models.plant import Coverage, CoveredBy

_ANNOTATIONS = {"unit", "words"}  # keys of a range that change its text and not its values
DERIVED = {"friction_derived", "alpha_gain"}
"""Names of values that follow from other declared values; ranges end at them."""


class Judged(NamedTuple):
    """The judgement whether a plant is covered.

    Attributes:
        covered: a `Coverage`, or (N,) of N plants.
        covered_by: why, a `CoveredBy`, or (N,).
        reasons: a phrase for each value that is outside of its range; empty if none is.
    """

    covered: Coverage | Integers
    covered_by: CoveredBy | Integers
    reasons: tuple[str, ...] = ()

    @property
    def outside(self) -> bool:
        """Whether nothing is promised, whatever the scene is."""
        return bool(self.reasons)


def judge(
    declared: Mapping[str, object],
    ranges: Mapping[str, object],
    alone: Mapping[str, Any] | None = None,
    reason: CoveredBy = CoveredBy.ARGUMENT,
) -> Judged:
    """Compare the values that a plant declares with the ranges that were tested.

    Args:
        declared: argument → value; "scene" is the family of the scene, or a list of N of them. An
            argument without a range was not tested; names in `DERIVED` are no arguments.
        ranges: argument → range; these were tested all at once.
        alone: "ranges", argument → wider range, into which one argument may go if all others are
            within "others", argument → range; "words" describe both. None for no such ranges.
        reason: reported if a value is outside.
    """
    wider = {} if alone is None else alone["ranges"]
    reasons: list[str] = []
    for name, expected in (dict(ranges) | wider).items():
        if name != "scene" and not _is_within(name, expected, declared):
            got = _outside_text(declared.get(name), expected)
            reasons.append(f"{name} {got} (tested: {words(expected)})")
    known = {"scene", *DERIVED, *ranges, *wider}
    untested = {name: value for name, value in declared.items() if name not in known}
    reasons += [f"{name} {value!r} (nothing is tested of it)" for name, value in untested.items()]
    if alone is not None:
        reasons += _not_alone(declared, ranges, alone)
    if reasons:
        return Judged(Coverage.OUTSIDE, reason, tuple(reasons))
    scene, expected = declared.get("scene"), ranges.get("scene")
    if isinstance(scene, list):
        tested = np.array([_contains(expected, each, declared) for each in scene], dtype=np.bool_)
        return Judged(
            np.where(tested, Coverage.COVERED, Coverage.SCENE),
            np.where(tested, CoveredBy.NONE, CoveredBy.SCENE),
        )
    if _contains(expected, scene, declared):
        return Judged(Coverage.COVERED, CoveredBy.NONE)
    return Judged(Coverage.SCENE, CoveredBy.SCENE)


def _not_alone(
    declared: Mapping[str, object], ranges: Mapping[str, object], alone: Mapping[str, Any]
) -> list[str]:
    """Return a reason if an argument is in its wider range, but not as the only unusual one."""
    usual = {name: ranges[name] for name in alone["ranges"] if name in ranges}
    wider = [n for n, expected in usual.items() if not _is_within(n, expected, declared)]
    others = [n for n, expected in alone["others"].items() if not _is_within(n, expected, declared)]
    if not wider or (len(wider) == 1 and not others):
        return []
    return [f"alone {' and '.join([*wider, *others])} (tested: {alone['words']})"]


def words(expected: Any) -> str:
    """Return a range in words."""
    kind = _kind(expected)
    if kind == "value":
        return repr(expected)
    if "words" in expected:
        return str(expected["words"])
    if kind == "any of":
        return " or ".join(map(words, expected["any of"]))
    if kind == "each":
        parts = expected["each"]
        if isinstance(parts, Mapping):
            return ", ".join(f"{name} {words(part)}" for name, part in parts.items())
        return ", ".join(map(words, parts))
    ends = {key: expected[key] for key in ("from", "to") if key in expected}
    text = {key: end if isinstance(end, str) else f"{end:g}" for key, end in ends.items()}
    unit = f" {expected['unit']}" if "unit" in expected else ""
    low, high = text.get("from"), text.get("to")
    if low is None:
        return f"at most {high}{unit}"
    return f"at least {low}{unit}" if high is None else f"{low} to {high}{unit}"


def _kind(expected: Any) -> Literal["any of", "each", "ends", "value"]:
    """Return which of the four kinds a range is, by its keys."""
    keys = set(expected) - _ANNOTATIONS if isinstance(expected, Mapping) else set()
    if keys == {"any of"}:
        return "any of"
    if keys == {"each"}:
        return "each"
    return "ends" if keys and keys <= {"from", "to"} else "value"


def _is_within(name: str, expected: Any, declared: Mapping[str, object]) -> bool:
    """Return whether a value is declared under a name, and is in its range."""
    return name in declared and _contains(expected, declared[name], declared)


def _contains(expected: Any, value: Any, declared: Mapping[str, object]) -> bool:
    """Return whether a range contains a value; its ends may be names of other declared values."""
    value, kind = records.plain(value), _kind(expected)
    if kind == "any of":
        return any(_contains(option, value, declared) for option in expected["any of"])
    if kind == "ends":
        return _is_between(expected, value, declared)
    if kind == "value":
        return bool(value == records.plain(expected))
    parts = expected["each"]
    if isinstance(parts, Mapping):
        return isinstance(value, Mapping) and all(
            name in value and _contains(part, value[name], declared) for name, part in parts.items()
        )
    return (
        isinstance(value, list)
        and len(value) == len(parts)
        and all(_contains(part, entry, declared) for part, entry in zip(parts, value, strict=True))
    )


def _is_between(expected: Any, value: Any, declared: Mapping[str, object]) -> bool:
    """Return whether a number, or every one of a list of numbers, is between a range's ends."""
    ends = expected.get("from", -np.inf), expected.get("to", np.inf)
    low, high = (declared.get(end) if isinstance(end, str) else end for end in ends)
    numbers = value if isinstance(value, list) else [value]
    for number in (low, high, *numbers):
        if isinstance(number, bool) or not isinstance(number, int | float):
            return False
    return bool(numbers) and all(low <= number <= high for number in numbers)


def _outside_text(value: object, expected: Any) -> str:
    """Return the text of a value outside of a range; of a record, of its parts that are outside."""
    value = records.plain(value)
    options = expected["any of"] if _kind(expected) == "any of" else [expected]
    for option in options:
        is_record = _kind(option) == "each" and isinstance(option["each"], Mapping)
        if isinstance(value, Mapping) and is_record:
            return ", ".join(
                f"{name} {value.get(name)!r}"
                for name, part in option["each"].items()
                if not _is_within(name, part, value)
            )
    return repr(value)
