"""A record of the files that a piece of work reads, because their contents decide its results.

>>> import tempfile
>>> with tempfile.NamedTemporaryFile() as file, recorded() as read:
...     _ = Path(file.name).read_text()
>>> list(read) == [file.name]
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

MISSING = "missing"  # the content of a file that does not exist, in the place of a hash
_WRITTEN = ""  # the content of a file that the work itself writes, in the place of a hash
_VERSIONED_FOLDERS = tuple(
    f"{os.path.realpath(folder)}{os.sep}"
    for folder in (
        "/dev", "/etc", "/lib", "/proc", "/sys", "/usr", Path.home() / ".cache", sys.prefix,
        sys.base_prefix, *sources.PACKAGES,
    )
)  # fmt: skip
"""Folders of the system and of packages. Their files are left out: their versions are known."""

_records: list[dict[str, str]] = []  # path → hash, of each `recorded` block that is active
_local = threading.local()


@contextmanager
def recorded() -> Iterator[dict[str, str]]:
    """Yield path → hash of the content of every file that the block opens for reading.

    Files of the system and of installed packages are left out, and so are files that the work
    itself writes. Files that C code opens are not seen.
    """
    _add_hook()
    files: dict[str, str] = {}
    _records.append(files)
    try:
        yield files
    finally:
        _records[:] = [record for record in _records if record is not files]
        for path in [path for path, content in files.items() if content == _WRITTEN]:
            del files[path]


def note(files: Mapping[str, str]) -> None:
    """Add files that were read before, path → hash, to the records of all active blocks."""
    for record in _records:
        record.update(files)


def content(path: str) -> str:
    """Return the hash of a file's content, or `MISSING`."""
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:20]
    except OSError:
        return MISSING


@functools.cache
def _add_hook() -> None:
    """Add the audit hook, once a process: Python cannot remove it."""
    sys.addaudithook(_on_event)


def _on_event(event: str, arguments: tuple[Any, ...]) -> None:
    """Record a file that is opened; Python calls this at every audit event."""
    if event != "open" or not _records or getattr(_local, "is_hashing", False):
        return
    _local.is_hashing = True  # hashing opens the file, too
    try:
        _record_file(*arguments)
    finally:
        _local.is_hashing = False


def _record_file(file: Any, mode: str | None, flags: int) -> None:
    """Add a file to all records; the arguments are those of the audit event "open"."""
    if isinstance(file, int):  # a descriptor, whose path was recorded when it was opened
        return
    path = os.path.abspath(os.fsdecode(file))
    is_versioned = os.path.realpath(path).startswith(_VERSIONED_FOLDERS) or "__pycache__" in path
    if is_versioned or (os.path.exists(path) and not os.path.isfile(path)):
        return
    for record in _records:
        if flags & (os.O_WRONLY | os.O_CREAT | os.O_TRUNC):
            record[path] = _WRITTEN
        elif path not in record:
            record[path] = content(path)
