"""Hashes of the sources of a result: the C++ core, the packages, and the files of users."""

import contextlib
import functools
import hashlib
import importlib
import sys
from collections.abc import Iterable
from modulefinder import ModuleFinder
from pathlib import Path

PACKAGE = Path(__file__).parent
NAMES = ("hcbf_gym", "hcbf_robots", "hcbf_lab")
PACKAGES = tuple(PACKAGE.parent / name for name in NAMES)  # their folders
CORE = PACKAGE.parent / "core"  # the folder of the C++ sources, which only a checkout has
REMEDY = "compile it in the checkout:\n    make core\nor install the package again"


def core_hash(core: Path = CORE) -> str:
    """Return a hash of the names and contents of the C++ sources in a folder."""
    files = sorted([*core.rglob("*.hpp"), *core.rglob("*.cpp")])
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.relative_to(core).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:16]


def check() -> None:
    """Refuse a compiled core that is missing, or that was compiled from other sources.

    Raises:
        ImportError: if so; the message has the remedy.
    """
    try:
        compiled = importlib.import_module("hcbf_gym._core")
    except ImportError as error:
        raise ImportError(f"hcbf_gym: the compiled core is missing ({error}); {REMEDY}") from error
    if (CORE / "include" / "hcbf").is_dir() and core_hash() != compiled.HASH:
        raise ImportError(f"hcbf_gym: the compiled core is older than core/; {REMEDY}")


def sources_hash(files: Iterable[Path]) -> str:
    """Return a hash of the core, of all files of the packages, and of a user's files."""
    names = sorted(f"{file.name} {_digest(file)}" for file in files)
    return hashlib.sha256("\n".join([_packages_hash(), *names]).encode()).hexdigest()[:16]


@functools.cache
def _packages_hash() -> str:
    """Return a hash of the core and of all files of the packages `NAMES`.

    Of the version only the release counts, so that results of a candidate are its release's.
    """
    from hcbf_gym import _core, version

    files = sorted(file for package in PACKAGES for file in package.rglob("*") if file.is_file())
    lines = (
        f"{file.relative_to(PACKAGE.parent).as_posix()} {_digest(file)}"
        for file in files
        if file.suffix not in (".so", ".pyd", ".pyc") and file != PACKAGE / "version.py"
    )
    return hashlib.sha256("\n".join([_core.HASH, version.release(), *lines]).encode()).hexdigest()


def of_user(file: Path) -> list[Path]:
    """Return a user's Python file and its imports: files of its folder, or its whole package."""
    top = file.parent
    while (top / "__init__.py").is_file():
        top = top.parent
    if top != file.parent:
        package = top / file.relative_to(top).parts[0]
        return [] if package in PACKAGES else sorted(package.rglob("*.py"))
    finder = ModuleFinder([str(top)], excludes=list(NAMES))
    with contextlib.suppress(SyntaxError):  # reported where the file is imported
        finder.run_script(str(file))
    imported = (getattr(module, "__file__", None) for module in finder.modules.values())
    return sorted({file, *(Path(name) for name in imported if name)})


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(f'#pragma once\n#define HCBF_HASH "{core_hash()}"\n')
