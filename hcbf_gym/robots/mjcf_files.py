"""Lists the files that an MJCF reads: included ones, attached models, meshes, textures, heights."""

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from xml.etree import ElementTree

FOLDER_ATTRIBUTES = ("meshdir", "texturedir", "assetdir")
"""Attributes of ``<compiler>`` that name the folders of assets."""


def read_by(mjcf: Path) -> set[Path]:
    """Return an MJCF file and all existing files that it reads.

    MuJoCo's rules of folders are not followed exactly. Every name is looked for in every folder
    that any of the files names, and all matches are returned.
    """
    files, waiting = set[Path](), [mjcf]
    folders = {mjcf.parent}
    names: set[str] = set()
    while waiting:
        file = waiting.pop()
        if file in files or not file.is_file():
            continue
        files.add(file)
        folders.add(file.parent)
        for element in _elements(file):
            for key, value in element.attrib.items():
                if key in FOLDER_ATTRIBUTES:
                    folders |= {mjcf.parent / value, file.parent / value}
                elif key.startswith("file"):
                    names.add(value)
        waiting += [folder / name for folder, name in product(folders, names)]
    return files


def _elements(file: Path) -> Iterator[ElementTree.Element]:
    """Yield the elements of an XML file; none of a file that is no XML, such as a mesh."""
    try:
        yield from ElementTree.parse(file).getroot().iter()
    except (ElementTree.ParseError, UnicodeDecodeError, ValueError):
        return
