"""The compiled core: made from the sources beside it, headers that anybody can include."""

import shutil
import subprocess
from pathlib import Path

import pytest

from hcbf_gym import _core, sources

ROOT = Path(__file__).parents[1]
INCLUDE = ROOT / "core" / "include"
STRICT = ("-std=c++17", "-Wall", "-Wextra", "-Werror", "-fno-exceptions", f"-I{INCLUDE}")


def compiler():
    """Return the C++ compiler of this machine."""
    found = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
    if found is None:
        pytest.skip("needs a C++17 compiler")
    return found


def test_the_module_was_made_from_the_sources_beside_it():
    assert sources.core_hash() == _core.HASH


def test_a_core_that_is_older_than_its_sources_is_refused_with_the_remedy(monkeypatch):
    monkeypatch.setattr(sources, "core_hash", lambda: "another")
    with pytest.raises(ImportError, match="make core"):
        sources.check()


def test_what_lies_elsewhere_than_in_a_checkout_is_not_compared(monkeypatch, tmp_path):
    monkeypatch.setattr(sources, "CORE", tmp_path)
    monkeypatch.setattr(sources, "core_hash", lambda: "another")
    sources.check()


def test_any_edit_of_a_source_changes_the_hash(tmp_path):
    copy = Path(shutil.copytree(ROOT / "core", tmp_path / "core"))
    before = sources.core_hash(copy)
    assert before == _core.HASH
    header = copy / "include" / "hcbf" / "arrays.hpp"
    header.write_text(header.read_text() + "\n")
    edited = sources.core_hash(copy)
    header.rename(header.with_name("views.hpp"))
    assert len({before, edited, sources.core_hash(copy)}) == 3


def test_each_header_stands_alone_without_exceptions_and_warnings(tmp_path):
    headers = sorted(INCLUDE.rglob("*.hpp"))
    assert headers
    unit = tmp_path / "all.cpp"
    names = [header.relative_to(INCLUDE).as_posix() for header in headers]
    for order in (names, names[::-1]):  # what one needs of another, it includes itself
        unit.write_text("".join(f"#include <{name}>\n" for name in order))
        command = [compiler(), *STRICT, "-fsyntax-only", str(unit)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
