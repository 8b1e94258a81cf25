"""One parameter of a node: what it may be, and how a value is refused by its name."""

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, field, fields
from typing import Any, NamedTuple, get_args, get_type_hints

from hcbf_gym.errors import InvalidInputError, finite_float, flag, shown

Numbers = tuple[float, ...]
Texts = tuple[str, ...]


class Parameter(NamedTuple):
    """One parameter; `kind` is the type of its value, and `live` ones may be set at any time."""

    name: str  # of a source behind the source's name and a dot
    kind: Any
    default: Any
    about: str
    low: float
    high: float
    choices: Texts = ()  # of a text; none for any
    live: bool = False

    def read(self, value: Any, label: str) -> Any:
        """Return a value of ROS or of a file as the settings have it; `label` is the whole name.

        Raises:
            InvalidInputError: if it is of another type, out of range or none of the choices.
        """
        label, got = f"parameter {label}", shown(value)
        if self.kind in (Numbers, Texts):
            if isinstance(value, str | bytes) or not isinstance(value, Sequence):
                what = "numbers" if self.kind == Numbers else "texts"
                raise InvalidInputError(f"{label}: got {got}, expected a list of {what}")
            one = self._replace(kind=get_args(self.kind)[0])
            return tuple(one.read(item, label.removeprefix("parameter ")) for item in value)
        if self.kind is bool:
            return flag(label, value)
        if self.kind is str:
            if not isinstance(value, str):
                raise InvalidInputError(f"{label}: got {got}, expected text")
            if self.choices and value not in self.choices:
                choices = sorted(self.choices)
                raise InvalidInputError(f"{label}: got {got}, expected one of {choices}")
            return value
        number = finite_float(label, value, minimum=self.low, maximum=self.high)
        if self.kind is int and not number.is_integer():
            raise InvalidInputError(f"{label}: got {got}, expected an integer")
        return self.kind(number)


@contextlib.contextmanager
def naming(name: str) -> Iterator[None]:
    """Put a parameter's whole name in front of an error's message.

    Raises:
        InvalidInputError: the error, with the name.
    """
    try:
        yield
    except InvalidInputError as error:
        raise InvalidInputError(f"parameter {name}: {error}") from error


def parameter(
    default: Any, about: str, low: float = -math.inf, high: float = math.inf, **options: Any
) -> Any:
    """Return a field of the settings; arguments are those of `Parameter`."""
    metadata = {"about": about, "low": low, "high": high, **options}
    if callable(default):
        return field(default_factory=default, metadata=metadata)
    return field(default=default, metadata=metadata)


def table(of: type) -> tuple[Parameter, ...]:
    """Return the parameters of the node, or those of each source."""
    hints = get_type_hints(of)
    found = []
    for one in fields(of):
        if one.metadata:
            made: Any = one.default_factory
            default = made() if one.default is MISSING else one.default
            found.append(Parameter(one.name, hints[one.name], default, **one.metadata))
    return tuple(found)
