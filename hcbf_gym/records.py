"""JSON serialisation of dataclasses, checks of paths, and files that are written atomically."""

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

MAX_PATH_LENGTH = 4000  # the longest path [characters]; Linux allows 4096 bytes
MAX_PART_BYTES = 255  # the longest name of a file or a folder on usual file systems [byte]
MAX_NAME_BYTES = 200  # the longest name that becomes part of a file's name [byte]
SETTINGS = "settings.json"  # a study's settings, which its folder has before there is a result

_made_folders: ContextVar[list[Path] | None] = ContextVar("made_folders", default=None)


def to_dict(record: Any, kinds: Mapping[str, type]) -> dict[str, Any]:
    """Return ``{"kind": …, field: value, …}`` in JSON's terms, of a dataclass among `kinds`."""
    kind = next(name for name, cls in kinds.items() if type(record) is cls)
    return {"kind": kind} | {f.name: plain(getattr(record, f.name)) for f in fields(record)}


def from_dict(what: str, data: Any, kinds: Mapping[str, type]) -> Any:
    """Build the dataclass that ``data["kind"]`` names from the other entries.

    Args:
        what: what the dataclass is, in messages: "barrier", "reference", …
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
    """Return an object of the dataclass `cls` from field → value; messages call it `what`.

    Raises:
        InvalidInputError: if a field is missing or unknown; the message lists the fields.
    """
    assert is_dataclass(cls)
    known = [field.name for field in fields(cls)]
    unset = [field for field in fields(cls) if field.name not in values]
    missing = [f.name for f in unset if f.default is MISSING and f.default_factory is MISSING]
    unknown = sorted(set(values) - set(known))
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
        InvalidInputError: if the file cannot be read, or is not JSON.
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

    Tuples and arrays become lists, NumPy scalars become numbers, paths become text, and members of
    enumerations their values. An object with a `to_dict` becomes the result of that.

    Raises:
        InvalidInputError: if `value` is nested too deeply, such as a list that contains itself.
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
    result = os.path.expanduser(os.path.expandvars(path))
    if "$" in result:
        raise InvalidInputError(
            f"{what}: got {path!r}, expected its environment variables to be set"
        )
    return result


def check_place(name: str, path: Path, *, makes: bool = True) -> None:
    """Refuse a path where no folder or file can be.

    Raises:
        InvalidInputError: if the path or a part of it is too long, or, if `makes`, a file is where
            a folder is to be made.
    """
    full_path = path.absolute()
    is_too_long = len(str(full_path)) > MAX_PATH_LENGTH
    if is_too_long or any(len(part.encode()) > MAX_PART_BYTES for part in full_path.parts):
        raise InvalidInputError(f"{name}: got {shown(str(path))}, expected a shorter path")
    existing = next(parent for parent in (full_path, *full_path.parents) if parent.exists())
    if makes and existing != full_path and not existing.is_dir():
        raise InvalidInputError(
            f"{name}: got {shown(str(path))}, expected a place in a folder; {existing} is a file"
        )


def check_name(name: str, value: str) -> str:
    """Return a name that becomes part of a file's name.

    Raises:
        InvalidInputError: if it is empty, too long, begins with a dot or a dash, or contains a
            character that separates folders or lines.
    """
    has_separator = any(letter in value for letter in "/\\:\0\n")
    is_too_long = len(value.encode()) > MAX_NAME_BYTES
    if not value or value.startswith((".", "-")) or has_separator or is_too_long:
        raise InvalidInputError(
            f"{name}: got {shown(value)}, expected a name of a file without its folder, such as "
            "'my-robot'"
        )
    return value


def make_folder(folder: Path) -> None:
    """Make a folder and its parents, where they do not exist.

    Raises:
        InvalidInputError: if it cannot be made.
    """
    check_place("output", folder)
    missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInputError(
            f"output: got {str(folder)!r} ({error.strerror}), expected a place to write to"
        ) from error
    made = _made_folders.get()
    if made is not None:
        made += missing


@contextmanager
def nothing_left_behind() -> Iterator[None]:
    """After an error, remove the folders that the block made and that contain no result."""
    made: list[Path] = []
    token = _made_folders.set(made)
    try:
        yield
    except Exception:
        for folder in sorted(made, key=lambda folder: -len(folder.parts)):  # innermost first
            with suppress(OSError):
                if [file.name for file in folder.iterdir()] == [SETTINGS]:
                    (folder / SETTINGS).unlink()
                folder.rmdir()  # fails if the folder contains a result
        raise
    finally:
        _made_folders.reset(token)


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to; after the block, the file replaces `path` at once.

    After an error `path` is unchanged. Of two processes that write the same file, the last one
    wins. The temporary path has the suffix of `path`, because some writers add one otherwise.
    """
    partial = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
