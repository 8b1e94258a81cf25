"""scikit-build-core, and a compiler as a wheel where the machine has none.

An editable installation compiles into `hcbf_gym/`, so that a checkout imports its own core.
"""

import contextlib
import functools
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from in_place import compile_in_place
from scikit_build_core import build
from scikit_build_core.build import build_sdist as build_sdist
from scikit_build_core.build import get_requires_for_build_sdist as get_requires_for_build_sdist
from scikit_build_core.build import (
    prepare_metadata_for_build_wheel as prepare_metadata_for_build_wheel,
)
from scikit_build_core.errors import FailedLiveProcessError

COMPILERS = "c++", "g++", "clang++"
ZIG = "ziglang==0.17.1"
NEEDED = """the core was not compiled (see above); it needs a C++17 compiler and Python's headers:
    Debian, Ubuntu: apt install g++ python3-dev    Fedora: dnf install gcc-c++ python3-devel
    macOS: xcode-select --install                  conda: conda install cxx-compiler"""
Settings = dict[str, Any] | None


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    """Return what building needs: CMake and Ninja where they are missing, and a compiler."""
    return [*build.get_requires_for_build_wheel(config_settings), *_compiler()]


get_requires_for_build_editable = get_requires_for_build_wheel


def _compiler() -> list[str]:
    """Return the wheel of a compiler where this machine has none."""
    if os.name == "nt" or os.environ.get("CXX") or any(map(_compiles, COMPILERS)):
        return []  # on Windows CMake looks for its own
    print(f"no C++17 compiler found: {ZIG} compiles the core, once", file=sys.stderr)
    return [ZIG]


@functools.cache
def _compiles(compiler: str) -> bool:
    """Return whether a command is a C++17 compiler."""
    command = [compiler, "-std=c++17", "-fsyntax-only", "-x", "c++", "-"]
    try:
        tried = subprocess.run(
            command, input=b"#include <optional>", capture_output=True, check=False
        )
    except OSError:
        return False
    return tried.returncode == 0


@contextlib.contextmanager
def _naming_what_is_needed() -> Iterator[None]:
    """Let a build that fails end with what it needs."""
    try:
        yield
    except (subprocess.CalledProcessError, FailedLiveProcessError, OSError):
        raise SystemExit(NEEDED) from None


def _use_zig() -> None:
    """Let CMake find the compiler that came as a wheel."""
    if not _compiler():
        return
    folder = Path(tempfile.mkdtemp())
    for name, command in (("cc", "cc"), ("c++", "c++"), ("ar", "ar"), ("ranlib", "ranlib")):
        script = folder / f"zig-{name}"
        script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ziglang {command} "$@"\n')
        script.chmod(0o755)
    os.environ["CC"], os.environ["CXX"] = str(folder / "zig-cc"), str(folder / "zig-c++")
    os.environ["AR"], os.environ["RANLIB"] = str(folder / "zig-ar"), str(folder / "zig-ranlib")


def build_wheel(
    wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None
) -> str:
    """Compile the core into a wheel."""
    _use_zig()
    with _naming_what_is_needed():
        return build.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(
    wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None
) -> str:
    """Compile the core into the checkout, and return a wheel that points there."""
    _use_zig()
    with tempfile.TemporaryDirectory() as folder, _naming_what_is_needed():
        compile_in_place(folder)
    return build.build_editable(wheel_directory, _pointing(config_settings), metadata_directory)


def prepare_metadata_for_build_editable(
    metadata_directory: str, config_settings: Settings = None
) -> str:
    """Write the metadata of a wheel that points to the checkout."""
    return build.prepare_metadata_for_build_editable(metadata_directory, _pointing(config_settings))


def _pointing(config_settings: Settings) -> dict[str, Any]:
    """Return the settings of a wheel that holds nothing but where the checkout lies."""
    points = {"wheel.cmake": "false", "wheel.py-api": "py3", "editable.mode": "inplace"}
    return {**(config_settings or {}), **points}
