"""Ranges: the sets of values that were tested, as certificates and `tested.json` hold them.

>>> delay = parse_range({"from": 0.0, "to": 0.02, "unit": "s"}, declared={})
>>> delay.words, delay.contains([0.0, 0.01]), delay.contains(0.03)
('0 to 0.02 s', True, False)
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hcbf_gym import records


@dataclass(frozen=True)
class Range:
    """A set of values of one argument.

    Attributes:
        words: the range in messages.
        contains: whether a value in JSON's terms is in the range.
        fields: the range of each field, if the range has records; messages name these fields.
    """

    words: str
    contains: Callable[[Any], bool]
    fields: "Mapping[str, Range] | None" = None

    def explain(self, value: Any) -> str:
        """Return the text of a value outside of the range; of a record, of its fields outside."""
        if self.fields is None or not isinstance(value, Mapping):
            return repr(value)
        names = names_outside(self.fields, value)
        return ", ".join(f"{name} {value.get(name)!r}" for name in names)


def names_outside(ranges: Mapping[str, Range], values: Mapping[str, object]) -> list[str]:
    """Return the names of the ranges that do not contain the value of the same name."""
    return [
        name
        for name, tested in ranges.items()
        if name not in values or not tested.contains(records.plain(values[name]))
    ]


def parse_range(data: Any, declared: Mapping[str, object]) -> Range:
    """Return the range that JSON describes; `declared` has the values that ends may name.

    * ``{"any of": [range, …]}`` contains the values of each of its ranges.
    * ``{"each": {name: range, …}}`` and ``{"each": [range, …]}`` contain records and lists of which
      every part is in its own range.
    * ``{"from": a, "to": b}`` contains numbers, and lists of numbers that are all between its ends.
      One end may be missing. An end may also be the name of another declared value.
    * Any other JSON contains only itself.

    "unit" is the unit of a range's numbers, and "words" are its text in the place of a derived one.
    """
    keys = set(data) - {"unit", "words"} if isinstance(data, Mapping) else set()
    if keys == {"any of"}:
        options = [parse_range(option, declared) for option in data["any of"]]
        words = data.get("words", " or ".join(option.words for option in options))
        fields = next((x.fields for x in options if x.fields is not None), None)
        return Range(words, lambda value: any(x.contains(value) for x in options), fields)
    if keys == {"each"} and isinstance(data["each"], Mapping):
        fields = {name: parse_range(field, declared) for name, field in data["each"].items()}
        words = ", ".join(f"{name} {field.words}" for name, field in fields.items())
        return Range(data.get("words", words), lambda value: _is_record(value, fields), fields)
    if keys == {"each"}:
        entries = [parse_range(entry, declared) for entry in data["each"]]
        words = data.get("words", ", ".join(entry.words for entry in entries))
        return Range(words, lambda value: _is_list(value, entries))
    if keys and keys <= {"from", "to"}:
        low, high = data.get("from", -np.inf), data.get("to", np.inf)
        words = data.get("words", _words_of_ends(low, high, data.get("unit")))
        ends = [declared.get(end) if isinstance(end, str) else end for end in (low, high)]
        return Range(words, lambda value: _is_between(value, *ends))
    return Range(repr(data), lambda value: bool(value == records.plain(data)))


def _is_record(value: Any, fields: Mapping[str, Range]) -> bool:
    return isinstance(value, Mapping) and not names_outside(fields, value)


def _is_list(value: Any, entries: list[Range]) -> bool:
    if not isinstance(value, list) or len(value) != len(entries):
        return False
    return all(tested.contains(entry) for tested, entry in zip(entries, value, strict=True))


def _is_between(value: Any, low: Any, high: Any) -> bool:
    """Return whether a number, or each of a list of them, is between two ends that are numbers."""
    numbers = value if isinstance(value, list) else [value]
    for number in (low, high, *numbers):
        if isinstance(number, bool) or not isinstance(number, int | float):
            return False
    return bool(numbers) and all(low <= number <= high for number in numbers)


def _words_of_ends(low: float | str, high: float | str, unit: str | None) -> str:
    """Return "at most …", "at least …" or "… to …" with the unit."""
    low_text, high_text = (end if isinstance(end, str) else f"{end:g}" for end in (low, high))
    suffix = "" if unit is None else f" {unit}"
    if low == -np.inf:
        return f"at most {high_text}{suffix}"
    if high == np.inf:
        return f"at least {low_text}{suffix}"
    return f"{low_text} to {high_text}{suffix}"
