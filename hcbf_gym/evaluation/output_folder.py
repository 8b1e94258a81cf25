"""Output folders, of which each holds one study: a run resumes its own study and no other."""

import contextlib
import itertools
import json
from collections.abc import Mapping
from pathlib import Path

from hcbf_gym.errors import InvalidInputError
from hcbf_gym.records import SETTINGS, check_place, make_folder, whole

Settings = Mapping[str, object]  # all that decides the results of a study; JSON types only


def open_folder(folder: Path, settings: Settings, overwrite: bool | None = None) -> None:
    """Make a folder for one study, or open the folder that already holds it.

    Args:
        folder: the folder of the study's results.
        settings: the study's settings.
        overwrite: accept a folder of any content, also with unreadable settings, and replace files
            of the same names; None for a command without such an option.

    Raises:
        InvalidInputError: if the folder holds another study or anything else; it is left as it is.
    """
    check_folder(folder, settings, overwrite)
    make_folder(folder)
    text = json.dumps(settings, indent=1, sort_keys=True, allow_nan=False) + "\n"
    write_text(folder / SETTINGS, text)


def free_folder(base: Path, settings: Settings) -> Path:
    """Return the first of the folders base, base-2, base-3, … that holds no other study."""
    numbered = (Path(f"{base}-{k}") for k in itertools.count(2))
    for folder in itertools.chain([base], numbered):
        with contextlib.suppress(InvalidInputError):
            check_folder(folder, settings)
            return folder
    raise AssertionError


def check_folder(folder: Path, settings: Settings, overwrite: bool | None = None) -> None:
    """Refuse a folder that `open_folder` would refuse.

    Raises:
        InvalidInputError: if the folder holds another study or anything else.
    """
    path = folder / SETTINGS
    flag = "" if overwrite is None else ", or --overwrite"
    check_place("output", folder)
    if folder.is_file():
        raise InvalidInputError(f"output: got the file {folder}, expected a folder")
    if path.is_dir():
        raise InvalidInputError(
            f"output: got the folder {path}, expected a file there; delete it, or give another "
            "--output"
        )
    if overwrite:
        return
    if path.exists():
        differing = _differences(path, json.loads(json.dumps(settings, allow_nan=False)), flag)
        if differing:
            raise InvalidInputError(
                f"output: {folder} holds another study, which differs in {differing}; "
                f"expected another --output, or the same study{flag}"
            )
    elif folder.exists() and any(folder.iterdir()):
        raise InvalidInputError(
            f"output: {folder} holds other files, expected an empty folder, a new one, or one "
            f"that this study began{flag}"
        )


def write_json(path: Path, data: object) -> None:
    """Write data as JSON, whole or not at all; NaN and infinity are refused."""
    write_text(path, json.dumps(data, indent=1, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Write a file, whole or not at all."""
    with whole(path) as partial:
        partial.write_text(text, encoding="utf-8")


def _differences(path: Path, settings: Settings, flag: str) -> list[str]:
    """Return the names of the settings that differ from those in a file at `path`."""
    try:
        saved = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InvalidInputError(
            f"output: got {path} that cannot be read ({error}), expected the settings of a "
            f"study; give another --output{flag}"
        ) from error
    if not isinstance(saved, dict):
        return sorted(settings)
    missing = object()  # differs from every setting, None included
    names = {*saved, *settings}
    return sorted(n for n in names if saved.get(n, missing) != settings.get(n, missing))
