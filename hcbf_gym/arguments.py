"""Ranges of the arguments of commands, beside their types, checked before any work."""

import dataclasses
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from hcbf_gym.errors import MOST, InvalidInputError, choose, shown, text
from hcbf_gym.records import check_place


class Range(NamedTuple):
    """A range of numbers, from `least`, itself refused if `above`, to `most`."""

    least: float
    most: float
    above: bool = False

    def __contains__(self, number: object) -> bool:
        assert isinstance(number, int | float)
        return self.least <= number <= self.most and not (self.above and number == self.least)

    def __str__(self) -> str:
        return f"a number {'above' if self.above else 'from'} {self.least:g} to {self.most:g}"


Seed = Annotated[int, Range(0, 2**53)]
Count = Annotated[int, Range(1, MOST)]
Workers = Annotated[int, Range(1, 4096)]
Amount = Annotated[float, Range(0.0, 1e9)]
Positive = Annotated[float, Range(0.0, 1e9, above=True)]


class Output:
    """Marks a path that a command writes to: a folder, or a file in one."""


Folder = Annotated[Path, Output()]


def check(args: Any, prefix: str = "--") -> None:
    """Refuse numbers out of their range, unknown choices, malformed text, and unusable places.

    Args:
        args: a dataclass of a command's arguments, or one that is made in Python.
        prefix: of the arguments' names in messages.

    Raises:
        InvalidInputError: on the first of them; the message names the argument.
        UnknownNameError: on an unknown choice.
    """
    hints = get_type_hints(type(args), include_extras=True)
    for field in dataclasses.fields(args):
        value = getattr(args, field.name)
        name = prefix + (field.name.replace("_", "-") if prefix else field.name)
        if dataclasses.is_dataclass(value):
            check(value, prefix)
            continue
        marks = list(_marks(hints[field.name]))
        ranges = [mark for mark in marks if isinstance(mark, Range)]
        choices = dict.fromkeys(_choices(hints[field.name]))
        for one in _values(value):
            if choices and one is not None:
                choose(name, one, choices)
            elif ranges and isinstance(one, str | bool) and not isinstance(value, Mapping):
                raise InvalidInputError(f"{name}: got {shown(one)}, expected {ranges[0]}")
            if isinstance(one, str | Path):
                text(name, one)
            if isinstance(one, Path):
                check_place(name, one, makes=any(isinstance(mark, Output) for mark in marks))
            elif isinstance(one, int | float) and not isinstance(one, bool):
                if not math.isfinite(one):
                    raise InvalidInputError(f"{name}: got {one}, expected a finite number")
                for allowed in ranges:
                    if one not in allowed:
                        raise InvalidInputError(f"{name}: got {shown(one)}, expected {allowed}")


def _values(value: Any) -> Iterator[Any]:
    """Yield an argument, or its entries."""
    if isinstance(value, Mapping):
        value = (*value, *value.values())
    if isinstance(value, tuple | list):
        for one in value:
            yield from _values(one)
    else:
        yield value


def _choices(hint: Any) -> Iterator[Any]:
    """Yield the literals of a type hint."""
    if get_origin(hint) is Literal:
        yield from get_args(hint)
    else:
        for part in get_args(hint):
            yield from _choices(part)


def _marks(hint: Any) -> Iterator[Any]:
    """Yield the metadata of a type hint and of its parts."""
    if get_origin(hint) is Annotated:
        yield from hint.__metadata__
    for part in get_args(hint):
        if part is not ...:
            yield from _marks(part)


class Subcommand(NamedTuple):
    """One command of `hcbf`: a module with `Args` and `main(args)`, described by its docstring."""

    module: str  # imported when the command is called, not before
    does: str  # one line for the list of commands
    extra: str = ""  # the extra that brings what it needs, where it needs more than the core
    needs: tuple[str, ...] = ()  # the modules of that extra that must be there
