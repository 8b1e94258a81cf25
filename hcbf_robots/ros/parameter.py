"""One parameter of a node: what it may be, and how a value is refused by its name."""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import field, fields
from typing import Any, NamedTuple, get_type_hints

from hcbf_gym.errors import InvalidInputError, finite_float, shown

Numbers = tuple[float, ...]
Texts = tuple[str, ...]
_PLAIN = (bool, int, float, str, tuple)


class Parameter(NamedTuple):
    """One parameter.

    Attributes:
        name: as ROS has it; of a source behind the source's name and a dot.
        kind: the Python type of its value.
        default: where none is given.
        says: what it is.
        low: the least number.
        high: the greatest number.
        choices: of a text; none for any.
        live: whether it may be set while the node runs.
    """

    name: str
    kind: Any
    default: Any
    says: str
    low: float | None
    high: float | None
    choices: Texts
    live: bool

    def read(self, value: Any, label: str) -> Any:
        """Return a value as the settings have it.

        Args:
            value: as ROS or a file gave it.
            label: the parameter's whole name.

        Raises:
            InvalidInputError: if it is of another type, out of range or none of the choices.
        """
        if self.kind in (Numbers, Texts):
            if isinstance(value, str | bytes) or not isinstance(value, Sequence):
                raise InvalidInputError(
                    f"parameter {label}: got {shown(value)}, expected a list of "
                    f"{'numbers' if self.kind == Numbers else 'texts'}"
                )
            one = self._number if self.kind == Numbers else self._text
            return tuple(one(item, label) for item in value)
        if self.kind is bool:
            if not isinstance(value, bool):
                raise InvalidInputError(
                    f"parameter {label}: got {shown(value)}, expected true or false"
                )
            return value
        return self._text(value, label) if self.kind is str else self._number(value, label)

    def live_value(self, value: Any, label: str) -> Any:
        """Return the value of a parameter that is set while the node runs.

        Raises:
            InvalidInputError: if it does not fit, or may not change now.
        """
        if not self.live:
            raise InvalidInputError(
                f"parameter {label}: got {shown(value)} while the node is configured, expected it "
                "before"
            )
        return self.read(value, label)

    def _text(self, value: Any, label: str) -> str:
        if not isinstance(value, str):
            raise InvalidInputError(f"parameter {label}: got {shown(value)}, expected text")
        if self.choices and value not in self.choices:
            raise InvalidInputError(
                f"parameter {label}: got {shown(value)}, expected one of {sorted(self.choices)}"
            )
        return value

    def _number(self, value: Any, label: str) -> Any:
        low = -float("inf") if self.low is None else self.low
        high = float("inf") if self.high is None else self.high
        number = finite_float(f"parameter {label}", value, minimum=low, maximum=high)
        if self.kind is int:
            if not number.is_integer():
                raise InvalidInputError(f"parameter {label}: got {number:g}, expected an integer")
            return int(number)
        return number


@contextlib.contextmanager
def naming(name: str) -> Iterator[None]:
    """Put a parameter's whole name before what is wrong with its value.

    Args:
        name: whole.

    Raises:
        InvalidInputError: whatever refuses the value.
    """
    try:
        yield
    except InvalidInputError as error:
        raise InvalidInputError(f"parameter {name}: {error}") from error


def parameter(
    default: Any,
    says: str,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: Sequence[str] = (),
    live: bool = False,
) -> Any:
    """Return a field of the settings with what `Parameter` says of it."""
    about = {"says": says, "low": low, "high": high, "choices": tuple(choices), "live": live}
    if callable(default):
        return field(default_factory=default, metadata=about)
    return field(default=default, metadata=about)


def table(of: type) -> tuple[Parameter, ...]:
    """Return the parameters of the node, or those of each source."""
    hints = get_type_hints(of)
    found = []
    for one in fields(of):
        if one.metadata:
            made: Callable[[], Any] = one.default_factory  # type: ignore[assignment]
            default = one.default if isinstance(one.default, _PLAIN) else made()
            found.append(Parameter(one.name, hints[one.name], default, **one.metadata))
    return tuple(found)
