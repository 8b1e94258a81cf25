"""The judge of `covered`: it compares what is declared with what was tested.

Ranges are JSON, in certificates and in `tested.json`:

* ``{"any of": [range, …]}`` holds what lies in one of them;
* ``{"from": a, "to": b}`` holds numbers, and lists of numbers that all lie between; one end alone
  will do, and an end may be the name of another value that is declared;
* ``{"each": {name: range, …}}`` and ``{"each": [range, …]}`` hold records and lists of which every
  part lies in its own range;
* any other value holds itself alone.

"unit" is that of a range's numbers, and "words" describe a range in a message.

>>> judge({"gait": "walk", "delay": [0.0, 0.01]}, {"gait": "trot", "delay": {"to": 0.02}}).reasons
("gait 'walk' (tested: 'trot')",)
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import records
from hcbf_gym.arrays import Integers
from hcbf_gym.models.plant import Coverage, CoveredBy

_WORDS = {"unit", "words"}
DERIVED = {"friction_derived", "alpha_gain"}
"""Names of values that follow from others that are declared; ranges end at them."""


class Judged(NamedTuple):
    """Whether a plant is covered.

    Attributes:
        covered: a `Coverage`, or (N,) of N plants.
        covered_by: why, a `CoveredBy`, or (N,).
        reasons: what lies outside, a phrase for each; empty where nothing does.
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
    """Compare what is declared with what was tested.

    Args:
        declared: argument → value; "scene" is the family of the scene, or a list of N of them. An
            argument without a range was not tested; names in `DERIVED` are no arguments.
        ranges: argument → range, that were tested all at once.
        alone: "ranges", argument → range, of which one may be left for a wider one where everything
            lies in "others", argument → range; "words" describe both. None for none.
        reason: reported where a value lies outside.
    """
    single = {} if alone is None else alone["ranges"]
    reasons = [
        f"{name} {_shown(declared.get(name), expected)} (tested: {words(expected)})"
        for name, expected in (dict(ranges) | single).items()
        if name != "scene" and not _lies(name, expected, declared)
    ]
    known = {"scene", *DERIVED, *ranges, *single}
    reasons += [
        f"{name} {value!r} (nothing is tested of it)"
        for name, value in declared.items()
        if name not in known
    ]
    left = [n for n in single if n in ranges and not _lies(n, ranges[n], declared)]
    if alone is not None and left:
        others = [n for n, one in alone["others"].items() if not _lies(n, one, declared)]
        if len(left) > 1 or others:
            reasons.append(f"alone {' and '.join([*left, *others])} (tested: {alone['words']})")
    if reasons:
        return Judged(Coverage.OUTSIDE, reason, tuple(reasons))
    scene, expected = declared.get("scene"), ranges.get("scene")
    if isinstance(scene, list):
        found = np.array([_holds(one, expected, declared) for one in scene], dtype=np.bool_)
        return Judged(
            np.where(found, Coverage.COVERED, Coverage.SCENE),
            np.where(found, CoveredBy.NONE, CoveredBy.SCENE),
        )
    if _holds(scene, expected, declared):
        return Judged(Coverage.COVERED, CoveredBy.NONE)
    return Judged(Coverage.SCENE, CoveredBy.SCENE)


def words(expected: Any) -> str:
    """Return a range in words."""
    kind = _kind(expected)
    if kind and "words" in expected:
        return str(expected["words"])
    if kind == {"any of"}:
        return " or ".join(map(words, expected["any of"]))
    if kind == {"each"}:
        parts = expected["each"]
        if isinstance(parts, Mapping):
            return ", ".join(f"{name} {words(one)}" for name, one in parts.items())
        return ", ".join(map(words, parts))
    if kind:
        ends = {key: end if isinstance(end, str) else f"{end:g}" for key, end in expected.items()}
        unit = f" {expected['unit']}" if "unit" in expected else ""
        if kind == {"from", "to"}:
            return f"{ends['from']} to {ends['to']}{unit}"
        return (f"at most {ends['to']}" if "to" in kind else f"at least {ends['from']}") + unit
    return repr(expected)


def _kind(expected: Any) -> set[str]:
    """Return which keys make a value a range; none of a value that holds itself alone."""
    found = set(expected) - _WORDS if isinstance(expected, Mapping) else set()
    return found if found in ({"any of"}, {"each"}, {"from"}, {"to"}, {"from", "to"}) else set()


def _lies(name: str, expected: Any, declared: Mapping[str, object]) -> bool:
    return name in declared and _holds(declared[name], expected, declared)


def _holds(got: Any, expected: Any, declared: Mapping[str, object]) -> bool:
    """Return whether a value lies in a range."""
    got, kind = records.plain(got), _kind(expected)
    if kind == {"any of"}:
        return any(_holds(got, one, declared) for one in expected["any of"])
    if kind == {"each"}:
        parts = expected["each"]
        if isinstance(parts, Mapping):
            return isinstance(got, Mapping) and all(
                name in got and _holds(got[name], one, declared) for name, one in parts.items()
            )
        return (
            isinstance(got, list)
            and len(got) == len(parts)
            and all(_holds(g, one, declared) for g, one in zip(got, parts, strict=True))
        )
    if kind:
        ends = expected.get("from", -np.inf), expected.get("to", np.inf)
        low, high = (declared.get(end) if isinstance(end, str) else end for end in ends)
        numbers = got if isinstance(got, list) else [got]
        known = all(
            isinstance(one, int | float) and not isinstance(one, bool)
            for one in (low, high, *numbers)
        )
        return known and bool(numbers) and all(low <= one <= high for one in numbers)
    return bool(got == records.plain(expected))


def _shown(got: object, expected: Any) -> str:
    """Return a value that lies outside; of a record with ranges of its parts those that do."""
    got = records.plain(got)
    options = expected["any of"] if _kind(expected) == {"any of"} else [expected]
    for one in options:
        if isinstance(got, Mapping) and _kind(one) == {"each"} and isinstance(one["each"], Mapping):
            outside = {k: got.get(k) for k, r in one["each"].items() if not _lies(k, r, got)}
            return ", ".join(f"{name} {value!r}" for name, value in outside.items())
    return repr(got)
