"""What computes here: the C++ sources of the core, and Python files with all that they import."""

import functools
import hashlib
import importlib
import re
import sys
from collections.abc import Iterable
from pathlib import Path

PACKAGE = Path(__file__).parent
NAMES = ("hcbf_gym", "hcbf_robots", "hcbf_lab")
PACKAGES = tuple(PACKAGE.parent / name for name in NAMES)
"""Where the sources are."""
CORE = PACKAGE.parent / "core"
"""Those of the core, in a checkout."""
REMEDY = "compile it in the checkout:\n    make core\nor install the package again"
_IMPORT = re.compile(r"^\s*(?:from (\S+) import (\([^)]*\)|.*)|import (.+))", re.M)


def core_hash(core: Path = CORE) -> str:
    """Return a hash of the C++ sources of a folder, with their names."""
    found = sorted(file for kind in ("*.hpp", "*.cpp") for file in core.rglob(kind))
    digest = hashlib.sha256()
    for file in found:
        digest.update(file.relative_to(core).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:16]


def check() -> None:
    """Refuse a compiled core that is missing or was made from other sources.

    Raises:
        ImportError: with the remedy.
    """
    try:
        compiled = importlib.import_module("hcbf_gym._core")
    except ImportError as error:
        raise ImportError(f"hcbf_gym: the compiled core is missing ({error}); {REMEDY}") from error
    if (CORE / "include" / "hcbf").is_dir() and core_hash() != compiled.HASH:
        raise ImportError(f"hcbf_gym: the compiled core is older than core/; {REMEDY}")


def sources_hash(files: list[Path]) -> str:
    """Return a hash of the core, of files, and of all that these import here and of their own.

    Args:
        files: below `hcbf_gym/`, or in another package that imports it.
    """
    from hcbf_gym import _core

    found = sorted(reached(files))
    names = (f"{file.relative_to(_top(file).parent)} {_digest(file)}" for file in found)
    text = "\n".join([f"core {_core.HASH}", *names])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def read_by_name() -> list[Path]:
    """Return what no import tells of: environments made by name, robots and policies in files."""
    patterns = (
        "envs/*.py",
        "robots/a1/*.xml",
        "carts/*.xml",
        "carts/*.json",
        "policies/baselines/*",
        "evaluation/*.json",
    )
    return [
        file
        for pattern in patterns
        for top in PACKAGES
        for file in top.glob(pattern)
        if file.is_file()
    ]


def reached(files: Iterable[Path]) -> set[Path]:
    """Return files, and all that they import of this package and of their own."""
    found = set()
    waiting = list(files)
    while waiting:
        file = waiting.pop()
        if file not in found:
            found.add(file)
            waiting += _imported(file)
    return found


def of_user(file: Path) -> list[Path]:
    """Return a file and what it imports, without this package."""
    return sorted(
        one for one in reached([file]) if not any(one.is_relative_to(top) for top in PACKAGES)
    )


@functools.cache
def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _top(file: Path) -> Path:
    """Return the folder of the package in which a file lies."""
    folder = file.parent
    while (folder.parent / "__init__.py").is_file():
        folder = folder.parent
    return folder


@functools.cache
def _imported(file: Path) -> list[Path]:
    """Return what a file imports of this package and of its own, none for a file of data."""
    if file.suffix != ".py":
        return []
    places = []
    for parent, names, modules in _IMPORT.findall(file.read_text(encoding="utf-8")):
        for module in _bare(parent or modules):
            place = _place(file, module)
            if place is not None:
                places += [place, *(place / name for name in _bare(names))]
    paths = [path for place in places for path in (place.with_suffix(".py"), place / "__init__.py")]
    # a package's own __init__ imports every subpackage, and nothing computes with what it has
    tops = {top / "__init__.py" for top in PACKAGES}
    return [path for path in paths if path.is_file() and path not in tops]


def _bare(names: str) -> list[str]:
    """Return the names in a list of an import statement, without what they are called there."""
    bare = (name.split(" as ")[0].strip(" ()\n") for name in names.split(","))
    return [name for name in bare if name]


def _place(file: Path, module: str) -> Path | None:
    """Return where a module lies that a file imports; None if it is neither ours nor its own."""
    name = module.lstrip(".")
    dots = len(module) - len(name)
    parts = name.split(".") if name else []
    if dots:
        return file.parents[dots - 1].joinpath(*parts)
    for folder in (*PACKAGES, _top(file)):
        if folder.name == parts[0]:
            return folder.joinpath(*parts[1:])
    in_package = (file.parent / "__init__.py").is_file()
    return None if in_package else file.parent.joinpath(*parts)  # a neighbour


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(f'#pragma once\n#define HCBF_HASH "{core_hash()}"\n')
