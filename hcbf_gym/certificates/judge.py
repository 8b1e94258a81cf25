"""The judge of coverage: it compares the values that a plant declares with the tested ranges.

`hcbf_gym.filter.certified` explains the words of coverage, and has an example.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import records
from hcbf_gym.arrays import Integers
from hcbf_gym.certificates.ranges import Range, names_outside, parse_range
from hcbf_gym.models.plant import Coverage, CoveredBy

DERIVED = {"friction_derived", "alpha_gain"}
"""Names of values that follow from other declared values; ranges end at them."""


class Judged(NamedTuple):
    """The verdict whether a plant is covered.

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


@dataclass(frozen=True)
class AloneRule:
    """The rule by which one argument alone may leave its usual range for a wider one.

    >>> rule = AloneRule(
    ...     wider_ranges={"gait": parse_range({"any of": ["trot", "walk"]}, {})},
    ...     others={"payload": parse_range(0.0, {})},
    ...     words="another gait without payload",
    ... )
    >>> usual_ranges = {"gait": parse_range("trot", {}), "payload": parse_range({"to": 4.0}, {})}
    >>> rule.violations({"gait": "walk", "payload": 0.0}, usual_ranges)
    []
    >>> rule.violations({"gait": "walk", "payload": 2.0}, usual_ranges)
    ['alone gait and payload (tested: another gait without payload)']
    """

    wider_ranges: Mapping[str, Range]  # one of these arguments at a time may use its range
    others: Mapping[str, Range]  # all other arguments have to be in these ranges meanwhile
    words: str  # the rule in messages

    def violations(
        self, declared: Mapping[str, object], usual_ranges: Mapping[str, Range]
    ) -> list[str]:
        """Return a phrase if an argument uses its wider range while another is unusual, too."""
        usual = {name: x for name, x in usual_ranges.items() if name in self.wider_ranges}
        wider = names_outside(usual, declared)
        unusual = [*wider, *names_outside(self.others, declared)]
        if not wider or len(unusual) == 1:
            return []
        return [f"alone {' and '.join(unusual)} (tested: {self.words})"]


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
        ranges: argument → range in JSON, see `parse_range`; these were tested all at once.
        alone: the "ranges", the "others" and the "words" of an `AloneRule` in JSON; None for none.
        reason: reported if a value is outside.
    """

    def parsed(ranges_as_json: Mapping[str, object]) -> dict[str, Range]:
        return {name: parse_range(x, declared) for name, x in ranges_as_json.items()}

    usual_ranges = parsed({name: data for name, data in ranges.items() if name != "scene"})
    rule = AloneRule({}, {}, "")
    if alone is not None:
        rule = AloneRule(parsed(alone["ranges"]), parsed(alone["others"]), alone["words"])
    reasons = _departures(declared, {**usual_ranges, **rule.wider_ranges})
    reasons += rule.violations(declared, usual_ranges)
    if reasons:
        return Judged(Coverage.OUTSIDE, reason, tuple(reasons))
    return judge_scene(declared.get("scene"), ranges.get("scene"))


def judge_scene(family: object, tested: object) -> Judged:
    """Return the verdict on a plant whose arguments are all in their ranges.

    `family` is the name of its scene's family, a list of N of them, or None; `tested` is the range
    of families in JSON.
    """
    families = parse_range(tested, {})
    if isinstance(family, list):
        is_tested = np.array([families.contains(name) for name in family], dtype=np.bool_)
        return Judged(
            np.where(is_tested, Coverage.COVERED, Coverage.SCENE),
            np.where(is_tested, CoveredBy.NONE, CoveredBy.SCENE),
        )
    if families.contains(family):
        return Judged(Coverage.COVERED, CoveredBy.NONE)
    return Judged(Coverage.SCENE, CoveredBy.SCENE)


def _departures(declared: Mapping[str, object], ranges: Mapping[str, Range]) -> list[str]:
    """Return a phrase for each argument that is outside of its range, or that has no range."""
    phrases = []
    for name in names_outside(ranges, declared):
        value_text = ranges[name].explain(records.plain(declared.get(name)))
        phrases.append(f"{name} {value_text} (tested: {ranges[name].words})")
    for name, value in declared.items():
        if name not in ranges and name not in DERIVED and name != "scene":
            phrases.append(f"{name} {value!r} (nothing is tested of it)")
    return phrases
