"""JSON serialisation of dataclasses, and files that are written whole or not at all."""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym.errors import InvalidInputError, choose, shown, text


def to_dict(record: Any, kinds: Mapping[str, type]) -> dict[str, Any]:
    """Return ``{"kind": …, field: value, …}`` with JSON types, of a dataclass among named kinds."""
    kind = next(name for name, cls in kinds.items() if type(record) is cls)
    return {"kind": kind} | {f.name: plain(getattr(record, f.name)) for f in fields(record)}


def from_dict(what: str, data: Any, kinds: Mapping[str, type]) -> Any:
    """Build the dataclass that ``data["kind"]`` names from the other entries.

    Args:
        what: names it in messages ("barrier", "reference", …).
        data: a mapping as `to_dict` makes it.
        kinds: name → class.

    Raises:
        InvalidInputError: if `data` is no mapping, the kind is not registered, or a field is
            missing, unknown or mistyped.
    """
    check_mapping(what, data)
    if "kind" not in data:
        raise InvalidInputError(f"{what}: 'kind' is missing, expected one of {sorted(kinds)}")
    cls = choose(f"{what} kind", data["kind"], kinds)
    return build(f"{what} ({data['kind']})", cls, {k: v for k, v in data.items() if k != "kind"})


def build(what: str, cls: type, values: Mapping[str, object]) -> Any:
    """Return a dataclass of the fields in `values`.

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
    """Refuse anything but a mapping with text keys."""
    if not isinstance(data, Mapping) or not all(isinstance(key, str) for key in data):
        raise InvalidInputError(f"{what}: got {shown(data)}, expected a mapping with text keys")


def read_json(what: str, path: str | Path) -> Any:
    """Return the content of a JSON file, which messages call `what`.

    Raises:
        InvalidInputError: if it cannot be read, or is not JSON.
    """
    path = Path(text(what, path))
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

    Raises:
        InvalidInputError: if it is nested without end.
    """
    try:
        return _plain(value)
    except RecursionError as error:
        raise InvalidInputError(
            f"got {shown(value)}, nested without end, expected what JSON can hold"
        ) from error


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "to_dict"):
        return _plain(value.to_dict())
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value


def expanded(what: str, path: str) -> str:
    """Return a path with its environment variables and ``~`` expanded.

    Raises:
        InvalidInputError: if a variable is not set.
    """
    found = os.path.expanduser(os.path.expandvars(path))
    if "$" in found:
        raise InvalidInputError(
            f"{what}: got {path!r}, expected its environment variables to be set"
        )
    return found


def check_place(name: str, path: Path, *, makes: bool = True) -> None:
    """Refuse a path where no folder or file can be.

    Raises:
        InvalidInputError: if a part of the path is too long, or, unless `makes` is false, a file is
            where a folder is to be made.
    """
    whole_path = path.absolute()
    if len(str(whole_path)) > 4000 or any(len(part.encode()) > 255 for part in whole_path.parts):
        raise InvalidInputError(f"{name}: got {shown(str(path))}, expected a shorter path")
    above = next(one for one in (whole_path, *whole_path.parents) if one.exists())
    if makes and above != whole_path and not above.is_dir():
        raise InvalidInputError(
            f"{name}: got {shown(str(path))}, expected a place in a folder; {above} is a file"
        )


def check_name(name: str, value: str) -> str:
    """Return a name that becomes part of a file's name.

    Raises:
        InvalidInputError: if it is empty, hidden, too long, or holds what separates folders.
    """
    separates = any(letter in value for letter in "/\\:\0\n")
    if not value or value.startswith((".", "-")) or separates or len(value.encode()) > 200:
        raise InvalidInputError(
            f"{name}: got {shown(value)}, expected a name of a file without its folder, such as "
            "'my-robot'"
        )
    return value


SETTINGS = "settings.json"
"""What a folder holds of its study, before there is a result."""

_MADE: ContextVar[list[Path] | None] = ContextVar("folders that were made", default=None)


def make_folder(folder: Path) -> None:
    """Make a folder and its parents, where they do not exist.

    Raises:
        InvalidInputError: if it cannot be made.
    """
    check_place("output", folder)
    missing = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInputError(
            f"output: got {str(folder)!r} ({error.strerror}), expected a place to write to"
        ) from error
    made = _MADE.get()
    if made is not None:
        made += missing


@contextmanager
def nothing_left_behind() -> Iterator[None]:
    """Remove the folders that `make_folder` makes inside, where an error comes before a result."""
    made: list[Path] = []
    token = _MADE.set(made)
    try:
        yield
    except Exception:
        for folder in sorted(made, key=lambda one: -len(one.parts)):
            with suppress(OSError):
                if [one.name for one in folder.iterdir()] == [SETTINGS]:
                    (folder / SETTINGS).unlink()
                folder.rmdir()  # unless it holds a result
        raise
    finally:
        _MADE.reset(token)


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Yield a path to write to, which becomes `path` at the end: whole or not at all.

    Of two processes that write the same file the last one wins. The suffix is retained, as some
    writers add one.
    """
    partial = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
