"""One parameter of the ROS node: its type, default and range, and the check of a given value."""

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, field, fields
from typing import Any, NamedTuple, get_args, get_type_hints

from hcbf_gym.errors import InvalidInputError, finite_float, flag, shown

Numbers = tuple[float, ...]
Texts = tuple[str, ...]


class Parameter(NamedTuple):
    """A parameter of the node or of a source, as a field of the settings describes it."""

    name: str  # without the name of a source in front
    kind: Any  # the type of its value: bool, int, float, str, `Numbers` or `Texts`
    default: Any
    about: str  # the description that ROS's tools show
    low: float  # the least number that is accepted
    high: float  # the greatest number that is accepted
    choices: Texts = ()  # the texts that are accepted; empty where any text is
    live: bool = False  # whether it may be set while the node is configured

    def read(self, value: Any, whole_name: str) -> Any:
        """Return a value of ROS or of a file, converted to the type that the settings have.

        `whole_name`, for errors, has the name of a source in front.

        Raises:
            InvalidInputError: if it is of another type, out of range or none of the choices.
        """
        label = f"parameter {whole_name}"
        if self.kind not in (Numbers, Texts):
            return self._read_item(self.kind, value, label)
        if isinstance(value, str | bytes) or not isinstance(value, Sequence):
            items = "numbers" if self.kind == Numbers else "texts"
            raise InvalidInputError(f"{label}: got {shown(value)}, expected a list of {items}")
        item_type = get_args(self.kind)[0]
        return tuple(self._read_item(item_type, item, label) for item in value)

    def _read_item(self, item_type: Any, value: Any, label: str) -> Any:
        """Return a single value, or an item of a list, as a bool, text or number."""
        if item_type is bool:
            return flag(label, value)
        if item_type is str:
            if not isinstance(value, str):
                raise InvalidInputError(f"{label}: got {shown(value)}, expected text")
            if self.choices and value not in self.choices:
                choices = sorted(self.choices)
                raise InvalidInputError(f"{label}: got {shown(value)}, expected one of {choices}")
            return value
        number = finite_float(label, value, minimum=self.low, maximum=self.high)
        if item_type is int and not number.is_integer():
            raise InvalidInputError(f"{label}: got {shown(value)}, expected an integer")
        return item_type(number)


@contextlib.contextmanager
def naming(whole_name: str) -> Iterator[None]:
    """Put a parameter's whole name in front of the message of an error inside the block.

    Raises:
        InvalidInputError: the error, with the name.
    """
    try:
        yield
    except InvalidInputError as error:
        raise InvalidInputError(f"parameter {whole_name}: {error}") from error


def parameter(
    default: Any, about: str, low: float = -math.inf, high: float = math.inf, **options: Any
) -> Any:
    """Return a dataclass field that describes a `Parameter`; a function returns its default."""
    metadata = {"about": about, "low": low, "high": high, **options}
    if callable(default):
        return field(default_factory=default, metadata=metadata)
    return field(default=default, metadata=metadata)


def parameters_of(settings_class: type) -> tuple[Parameter, ...]:
    """Return the parameters that a dataclass describes by fields made with `parameter`."""
    types = get_type_hints(settings_class)
    described = []
    for setting in fields(settings_class):
        if not setting.metadata:
            continue  # such as the name of a source
        factory: Any = setting.default_factory
        default = factory() if setting.default is MISSING else setting.default
        described.append(Parameter(setting.name, types[setting.name], default, **setting.metadata))
    return tuple(described)
