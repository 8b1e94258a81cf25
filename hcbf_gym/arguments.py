"""Checks of a command's arguments before it runs, by the type hints that also parse them."""

import dataclasses
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from hcbf_gym.errors import MAX_COUNT, InvalidInputError, choose, shown, text
from hcbf_gym.records import check_place


class Range(NamedTuple):
    """A range of numbers from `least` to `most`; `above` excludes `least` itself."""

    least: float
    most: float
    above: bool = False

    def __contains__(self, number: object) -> bool:
        assert isinstance(number, int | float)
        return self.least <= number <= self.most and not (self.above and number == self.least)

    def __str__(self) -> str:
        return f"a number {'above' if self.above else 'from'} {self.least:g} to {self.most:g}"


Seed = Annotated[int, Range(0, 2**53)]
Count = Annotated[int, Range(1, MAX_COUNT)]
Workers = Annotated[int, Range(1, 4096)]
Amount = Annotated[float, Range(0.0, 1e9)]
Positive = Annotated[float, Range(0.0, 1e9, above=True)]


class Output:
    """Marks a path that a command writes to: a folder, or a file in one."""


Folder = Annotated[Path, Output()]


def check(args: Any, prefix: str = "--") -> None:
    """Refuse numbers out of their range, unknown choices, malformed text, and unusable paths.

    Args:
        args: a dataclass of a command's arguments; a field may be another such dataclass.
        prefix: precedes the arguments' names in messages; "" for arguments that are set in Python.

    Raises:
        InvalidInputError: on the first invalid argument; the message names it.
        UnknownNameError: on an unknown choice.
    """
    hints = get_type_hints(type(args), include_extras=True)
    for field in dataclasses.fields(args):
        value = getattr(args, field.name)
        name = prefix + (field.name.replace("_", "-") if prefix else field.name)
        if dataclasses.is_dataclass(value):
            check(value, prefix)
        else:
            _check_argument(name, value, hints[field.name])


def _check_argument(name: str, value: Any, hint: Any) -> None:
    """Refuse an argument, or an entry of it, that its type hint does not allow."""
    choices, metadata = dict.fromkeys(_choices(hint)), list(_metadata(hint))
    ranges = [mark for mark in metadata if isinstance(mark, Range)]
    is_output = any(isinstance(mark, Output) for mark in metadata)
    has_keys = isinstance(value, Mapping)  # its keys are text, although its values have a range
    for entry in _entries(value):
        if choices and entry is not None:
            choose(name, entry, choices)
        elif ranges and isinstance(entry, str | bool) and not has_keys:
            raise InvalidInputError(f"{name}: got {shown(entry)}, expected {ranges[0]}")
        if isinstance(entry, str | Path):
            text(name, entry)
        if isinstance(entry, Path):
            check_place(name, entry, makes=is_output)
        if isinstance(entry, int | float) and not isinstance(entry, bool):
            _check_number(name, entry, ranges)


def _check_number(name: str, number: float, ranges: list[Range]) -> None:
    """Refuse a number that is not finite, or out of one of its ranges."""
    if not math.isfinite(number):
        raise InvalidInputError(f"{name}: got {number}, expected a finite number")
    for allowed in ranges:
        if number not in allowed:
            raise InvalidInputError(f"{name}: got {shown(number)}, expected {allowed}")


def _entries(value: Any) -> Iterator[Any]:
    """Yield the entries of nested lists and mappings, keys too; any other value itself."""
    if isinstance(value, Mapping):
        value = (*value, *value.values())
    if isinstance(value, tuple | list):
        for entry in value:
            yield from _entries(entry)
    else:
        yield value


def _choices(hint: Any) -> Iterator[Any]:
    """Yield the literals of a type hint, such as "a" and "b" of ``Literal["a", "b"] | None``."""
    if get_origin(hint) is Literal:
        yield from get_args(hint)
    else:
        for part in get_args(hint):
            yield from _choices(part)


def _metadata(hint: Any) -> Iterator[Any]:
    """Yield the metadata of a type hint and of its parts, such as `Range` of ``Count | None``."""
    if get_origin(hint) is Annotated:
        yield from hint.__metadata__
    for part in get_args(hint):
        if part is not ...:
            yield from _metadata(part)


class Subcommand(NamedTuple):
    """A command of `hcbf`: a module with `Args` and `main(args)`, described by its docstring."""

    module: str  # its name; it is imported when the command is called
    does: str  # one line for the list of commands
    extra: str = ""  # the extra that installs its dependencies; "" for none
    needs: tuple[str, ...] = ()  # the modules of that extra that it imports
