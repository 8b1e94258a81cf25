"""Which files a piece of work reads: their contents decide its results.

>>> import tempfile
>>> with tempfile.NamedTemporaryFile() as file, recorded() as found:
...     _ = Path(file.name).read_text()
>>> list(found) == [file.name]
True
"""

import functools
import hashlib
import os
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hcbf_gym import sources

MISSING = "missing"
"""In the place of a hash, of a file that is not there."""
_WRITTEN = ""
"""In the place of a hash, of a file that the work itself writes."""
_APART = tuple(
    f"{os.path.realpath(folder)}{os.sep}"
    for folder in (
        "/dev", "/etc", "/lib", "/proc", "/sys", "/usr", Path.home() / ".cache", sys.prefix,
        sys.base_prefix, *sources.PACKAGES,
    )
)  # fmt: skip
"""Folders of the system, of installed packages and of this one, whose versions are known."""

_records: list[dict[str, str]] = []
_local = threading.local()


@contextmanager
def recorded() -> Iterator[dict[str, str]]:
    """Yield path → hash of the content of every file that is opened for reading inside.

    Files of the system and of installed packages are left out, and so are files that the work
    itself writes. Files that C code opens are not seen.
    """
    _listen()
    found: dict[str, str] = {}
    _records.append(found)
    try:
        yield found
    finally:
        _records[:] = [one for one in _records if one is not found]
        for path in [path for path, content in found.items() if content == _WRITTEN]:
            del found[path]


def note(found: Mapping[str, str]) -> None:
    """Add files, path → hash, which were read before, to all that is being recorded."""
    for record in _records:
        record.update(found)


def content(path: str) -> str:
    """Return the hash of a file's content, or `MISSING`."""
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:20]
    except OSError:
        return MISSING


@functools.cache
def _listen() -> None:
    """Add the hook, once a process: Python removes none."""
    sys.addaudithook(_on_event)


def _on_event(event: str, arguments: tuple[Any, ...]) -> None:
    if event != "open" or not _records or getattr(_local, "busy", False):
        return
    _local.busy = True  # hashing the file opens it
    try:
        _add(*arguments)
    finally:
        _local.busy = False


def _add(given: Any, mode: str | None, flags: int) -> None:
    if isinstance(given, int):  # a descriptor, whose path was seen before
        return
    path = os.path.abspath(os.fsdecode(given))
    apart = os.path.realpath(path).startswith(_APART) or "__pycache__" in path
    if apart or (os.path.exists(path) and not os.path.isfile(path)):
        return
    for record in _records:
        if flags & (os.O_WRONLY | os.O_CREAT | os.O_TRUNC):
            record[path] = _WRITTEN
        elif path not in record:
            record[path] = content(path)
