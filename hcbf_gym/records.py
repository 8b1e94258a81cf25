"""How records leave the process: as plain dicts that travel through JSON, and as whole files."""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym.errors import InvalidInputError, choose


def to_dict(record: Any, kinds: Mapping[str, type]) -> dict[str, Any]:
    """Return ``{"kind": …, field: value, …}`` with JSON types only.

    Args:
        record: a dataclass instance whose class is among `kinds`.
        kinds: the registered names and their classes.
    """
    kind = next(name for name, cls in kinds.items() if type(record) is cls)
    return {"kind": kind} | {f.name: plain(getattr(record, f.name)) for f in fields(record)}


def from_dict(what: str, data: Any, kinds: Mapping[str, type]) -> Any:
    """Build the dataclass that ``data["kind"]`` names from the other entries.

    Args:
        what: what is being read, for the message ("barrier", "reference", …).
        data: a mapping as `to_dict` makes it.
        kinds: the registered names and their classes.

    Raises:
        InvalidInputError: if `data` is no mapping, or a field is missing, unknown or mistyped.
        UnknownNameError: if the kind is not registered.
    """
    check_mapping(what, data)
    if "kind" not in data:
        raise InvalidInputError(f"{what}: 'kind' is missing, expected one of {sorted(kinds)}")
    cls = choose(f"{what} kind", data["kind"], kinds)
    return build(f"{what} ({data['kind']})", cls, {k: v for k, v in data.items() if k != "kind"})


def build(what: str, cls: type, values: Mapping[str, object]) -> Any:
    """Call a dataclass with the fields in `values` after checking their names.

    Raises:
        InvalidInputError: if a field is missing or unknown; the message lists the fields.
    """
    assert is_dataclass(cls)
    known = [f.name for f in fields(cls)]
    required = [
        f.name for f in fields(cls) if f.default is MISSING and f.default_factory is MISSING
    ]
    unknown = sorted(set(values) - set(known))
    missing = [name for name in required if name not in values]
    if unknown or missing:
        raise InvalidInputError(
            f"{what}: got missing field(s) {missing} and unknown field(s) {unknown}, "
            f"expected the fields {known}"
        )
    return cls(**values)


def check_mapping(what: str, data: object) -> None:
    """Refuse anything but a mapping with text keys.

    Raises:
        InvalidInputError: on anything else.
    """
    if not isinstance(data, Mapping) or not all(isinstance(key, str) for key in data):
        raise InvalidInputError(f"{what}: got {data!r}, expected a mapping with text keys")


def read_json(what: str, path: Path) -> Any:
    """Return what a JSON file holds.

    Args:
        what: names it in the message.
        path: of the file.

    Raises:
        InvalidInputError: if it cannot be read, or is not JSON.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InvalidInputError(
            f"{what}: got {str(path)!r} ({error}), expected a readable JSON file"
        ) from error


def plain(value: Any) -> Any:
    """Return `value` in JSON's terms.

    Tuples and arrays become lists, NumPy scalars numbers, paths text, enumerations their values,
    and a record with a `to_dict` what that returns.
    """
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "to_dict"):
        return plain(value.to_dict())
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    return value


def expanded(what: str, path: str) -> str:
    """Return a path with its environment variables and ``~`` put in.

    Args:
        what: names it in the message.
        path: as it is written.

    Raises:
        InvalidInputError: if a variable is not set.
    """
    found = os.path.expanduser(os.path.expandvars(path))
    if "$" in found:
        raise InvalidInputError(
            f"{what}: got {path!r}, expected its environment variables to be set"
        )
    return found


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Give a path to write to, which becomes `path` at the end: whole or not at all.

    Whoever else writes the same file meanwhile writes another part of the disk; the last one wins.

    Args:
        path: of the file; its suffix is retained, as some writers add one of their own.
    """
    partial = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
