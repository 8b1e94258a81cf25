"""Which files an MJCF reads: included ones, attached models, meshes, textures, height fields."""

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from xml.etree import ElementTree

FOLDERS = ("meshdir", "texturedir", "assetdir")
"""Attributes of ``<compiler>`` that say from where assets count."""


def read_by(mjcf: Path) -> set[Path]:
    """Return a file and all that it reads, as far as they are there.

    A name may mean several files, by the folders that any of them names: it means all.
    """
    found, waiting = set[Path](), [mjcf]
    folders = {mjcf.parent}
    names: set[str] = set()
    while waiting:
        file = waiting.pop()
        if file in found or not file.is_file():
            continue
        found.add(file)
        for element in _elements(file):
            given = element.attrib
            own = [given[key] for key in FOLDERS if key in given]
            folders |= {folder / name for folder in (mjcf.parent, file.parent) for name in own}
            folders.add(file.parent)
            names |= {value for key, value in given.items() if key.startswith("file")}
        waiting += [
            path for folder, name in product(folders, names)
            if (path := folder / name) not in found and path.is_file()
        ]  # fmt: skip
    return found


def _elements(file: Path) -> Iterator[ElementTree.Element]:
    """Yield the elements of an XML file; none of another one."""
    try:
        yield from ElementTree.parse(file).getroot().iter()
    except (ElementTree.ParseError, UnicodeDecodeError, ValueError):
        return
