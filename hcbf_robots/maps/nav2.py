"""Reads the maps of Nav2's map server unchanged: a YAML file that names a PGM or PNG image."""

import math
import re
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.errors import (
    InvalidInputError,
    choose,
    finite_array,
    finite_float,
    shown,
    warn_caller,
)
from hcbf_gym.models.constants import ON_EARTH
from hcbf_gym.models.grid import Grid, checked_shape

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
"""Occupancy of a cell as in ROS [%]; cells that were never seen are UNKNOWN."""
UNSEEN_GREY = 205  # the pixels by which map savers write cells that were never seen

NEEDED = ("image", "resolution", "origin")
OPTIONAL = ("mode", "negate", "occupied_thresh", "free_thresh")
UNREAD = ("map_type",)  # map servers write it, and do not read it
MODES = ("trinary", "scale", "raw")

LONGEST_TEXT = 65_536  # of a YAML file [bytes]

_KEY_AND_VALUE = re.compile(r"([A-Za-z_][\w-]*)\s*:(?:\s+(.*))?$")
_IMAGE_FORMATS = {"PPM": "PGM", "PNG": "PNG"}  # Pillow's name → the name in messages
_PIXEL_MODES = ("1", "L", "LA", "P", "PA", "RGB", "RGBA")  # Pillow's, of 8 bits a channel


class Raster(NamedTuple):
    """The cells of a map as its files have them."""

    grid: Grid
    # (rows, columns) from FREE to OCCUPIED, or UNKNOWN; row 0 is the lowest
    occupancy: NDArray[np.int16]


def read(path: str | Path, *, drawn: bool = False) -> Raster:
    """Read a map, and warn of unknown keys.

    The modes are the map server's. In "trinary" maps a cell is free, occupied, or unknown between
    both thresholds. In "scale" maps a cell between them has a share of occupancy. In "raw" maps a
    pixel from 0 to 100 is the occupancy. In trinary maps a cell of the grey 205 (50 if `negate` is
    set) was never seen, and is unknown whatever the thresholds.

    Args:
        path: of the YAML file; a relative path of the image in it is relative to the file's folder.
        drawn: whether it is a mask, whose greys were drawn, so that the thresholds decide all.

    Raises:
        InvalidInputError: if a file cannot be read or is too large, a key is missing or
            out of range, or the image is no PGM or PNG of 8 bits.
    """
    path = Path(path)
    keys = _checked_keys(path)
    mode = keys.get("mode", "trinary")
    choose(f"mode of map {path}", mode, dict.fromkeys(MODES))
    low = finite_float(f"map {path}: free_thresh", keys.get("free_thresh", 0.25), minimum=0.0)
    high = finite_float(
        f"map {path}: occupied_thresh", keys.get("occupied_thresh", 0.65), minimum=0.0, maximum=1.0
    )
    if low >= high:
        raise InvalidInputError(
            f"map {path}: free_thresh: got {low}, expected below occupied_thresh, {high}"
        )
    negate = keys.get("negate", 0)
    if negate not in (0, 1):
        raise InvalidInputError(f"map {path}: negate: got {negate!r}, expected 0 or 1")
    if not isinstance(keys["image"], str):
        raise InvalidInputError(
            f"map {path}: image: got {keys['image']!r}, expected the path of a PGM or PNG"
        )
    brightness, is_transparent = _pixels(path.parent / keys["image"], mode)
    origin = finite_array(f"map {path}: origin", keys["origin"], (3,), largest=ON_EARTH)
    grid = Grid(keys["resolution"], tuple(origin.tolist()), brightness.shape)
    darkness = brightness if negate else 1.0 - brightness
    if mode == "raw":
        values = np.rint(255.0 * brightness)
        values[values > OCCUPIED] = UNKNOWN
    else:
        values = np.full(brightness.shape, float(UNKNOWN))
        if mode == "scale":
            values = np.rint(OCCUPIED * (darkness - low) / (high - low))
        values[darkness < low] = FREE
        values[darkness > high] = OCCUPIED
        values[is_transparent] = UNKNOWN
        if mode == "trinary" and not drawn:
            values[np.rint(255.0 * darkness) == 255 - UNSEEN_GREY] = UNKNOWN
    return Raster(grid, values.astype(np.int16)[::-1])


def _checked_keys(path: Path) -> dict[str, Any]:
    """Return the keys of a map's YAML file and their values; refuse a file that lacks some."""
    keys = parse(_text(path), str(path))
    missing = [key for key in NEEDED if key not in keys]
    if missing:
        raise InvalidInputError(
            f"map {path}: {missing} is missing among {shown(list(keys))}, expected {list(NEEDED)}"
        )
    others = sorted(set(keys) - {*NEEDED, *OPTIONAL, *UNREAD})
    if others:
        warn_caller(f"map {path}: the keys {others} are not read, expected {[*NEEDED, *OPTIONAL]}")
    return keys


def _text(path: Path) -> str:
    """Return the content of a text file, or refuse one that is too long or unreadable."""
    try:
        size = path.stat().st_size
        if size <= LONGEST_TEXT:
            return path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise InvalidInputError(
            f"map {path}: got {error}, expected a readable YAML file of Nav2's map server"
        ) from error
    raise InvalidInputError(
        f"map {path}: got a file of {size} bytes, expected at most {LONGEST_TEXT}"
    )


def parse(text: str, name: str) -> dict[str, Any]:
    """Return the keys of a map's YAML text with one level: numbers, texts, and lists of numbers.

    Raises:
        InvalidInputError: on anything else, and on a repeated key; `name` is the map's in messages.
    """
    keys: dict[str, Any] = {}
    open_list: list[Any] | None = None  # of the last key, if its items are on lines of their own
    for number, line in enumerate(text.removeprefix("\ufeff").splitlines(), start=1):
        content = re.sub(r"(^|\s)#.*$", "", line).rstrip()
        if not content.strip() or content in ("---", "..."):
            continue
        if open_list is not None and re.match(r"\s*-\s", content):
            open_list.append(_scalar(content.strip()[1:].strip()))
            continue
        match = _KEY_AND_VALUE.match(content)
        if match is None or match[1] in keys:
            problem = "twice the key" if match else "the line"
            raise InvalidInputError(
                f"map {name}: got {problem} {content!r} (line {number}), expected lines "
                f"'key: value' with keys among {[*NEEDED, *OPTIONAL]}"
            )
        value = (match[2] or "").strip()
        open_list = None if value else []
        keys[match[1]] = _value(value) if value else open_list
    return keys


def _value(text: str) -> Any:
    """Return a scalar, or a list of scalars; lists within a list are not read and remain text."""
    if text.startswith("[") and text.endswith("]"):
        inner = text[1:-1].strip().rstrip(",")
        return [_scalar(item.strip()) for item in inner.split(",")] if inner else []
    return _scalar(text)


def _scalar(text: str) -> Any:
    """Return the number, the truth value or the text that a YAML scalar denotes."""
    if len(text) > 1 and text[0] == text[-1] and text[0] in "\"'":
        return text[1:-1]
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return math.inf if text.lower() in (".inf", "+.inf") else text


def _pixels(path: Path, mode: str) -> tuple[Any, Any]:
    """Return an image's brightness (rows, columns) from 0 to 1, and which pixels are transparent.

    As in the map server, opacity counts as a fourth channel of trinary maps, and only maps of the
    mode "scale" have transparent pixels.
    """
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # size: checked below
            image = Image.open(path, formats=list(_IMAGE_FORMATS))
        with image:
            width, height = image.size
            checked_shape((height, width))  # before anything is decoded
            if image.mode not in _PIXEL_MODES:
                raise InvalidInputError(
                    f"map image {path}: got the mode {image.mode!r}, expected 8 bits a channel"
                )
            channels = np.asarray(image.convert("RGBA"))
    except InvalidInputError:
        raise
    except (OSError, ValueError, SyntaxError, MemoryError, Image.DecompressionBombError) as error:
        formats = " or ".join(_IMAGE_FORMATS.values())
        message = f"map image {path}: got {error}, expected a readable {formats}"
        raise InvalidInputError(message) from error
    is_transparent = channels[..., 3] < 255
    averaged = 4 if mode == "trinary" and is_transparent.any() else 3
    brightness = channels[..., :averaged].astype(np.float64).mean(axis=2) / 255.0
    return brightness, is_transparent & (mode == "scale")
