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
"""Occupancy of a cell, as ROS counts it; between FREE and OCCUPIED are shares of a hundred."""
GREY = 205  # of a pixel by which map savers write a cell that was never seen

NEEDED = ("image", "resolution", "origin")
OPTIONAL = ("mode", "negate", "occupied_thresh", "free_thresh")
UNREAD = ("map_type",)  # written by map servers, read by none
MODES = ("trinary", "scale", "raw")

LONGEST_TEXT = 65_536  # bytes of a YAML file that describes a map

_KEY = re.compile(r"([A-Za-z_][\w-]*)\s*:(?:\s+(.*))?$")
_IMAGES = {"PPM": "PGM", "PNG": "PNG"}
_PLAIN = ("1", "L", "LA", "P", "PA", "RGB", "RGBA")


class Raster(NamedTuple):
    """A map as it stands in its files."""

    grid: Grid  # where its cells lie
    # (rows, columns) from FREE to OCCUPIED, or UNKNOWN; row 0 is the lowest
    occupancy: NDArray[np.int16]


def read(path: str | Path, *, drawn: bool = False) -> Raster:
    """Read a map. Warns of keys that it does not know.

    Modes are the map server's: "trinary" knows free, occupied and unknown; "scale" the shares
    between both thresholds; "raw" takes a pixel from 0 to 100 for the occupancy itself. In trinary
    maps a cell of the grey 205 (50 where `negate` is set) was never seen: it is unknown whatever
    the thresholds. In the other modes no grey of such a cell depends on them.

    Args:
        path: of the YAML file; its image lies beside it unless the path in it is absolute.
        drawn: whether it is a mask: a grey that somebody has drawn means what thresholds say.

    Raises:
        InvalidInputError: if a file cannot be read or is too large, a key is missing or
            out of range, or the image is no PGM or PNG of 8 bits.
    """
    path = Path(path)
    keys = _keys(path)
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
    shade, clear = _shade(path.parent / keys["image"], mode)
    origin = finite_array(f"map {path}: origin", keys["origin"], (3,), largest=ON_EARTH)
    grid = Grid(keys["resolution"], tuple(origin.tolist()), shade.shape)
    occupied = shade if negate else 1.0 - shade
    if mode == "raw":
        values = np.rint(255.0 * shade)
        values[values > OCCUPIED] = UNKNOWN
    else:
        values = np.full(shade.shape, float(UNKNOWN))
        if mode == "scale":
            values = np.rint(OCCUPIED * (occupied - low) / (high - low))
        values[occupied < low] = FREE
        values[occupied > high] = OCCUPIED
        values[clear] = UNKNOWN
        if mode == "trinary" and not drawn:
            values[np.rint(255.0 * occupied) == 255 - GREY] = UNKNOWN
    return Raster(grid, values.astype(np.int16)[::-1])


def _keys(path: Path) -> dict[str, Any]:
    """Return the keys of a map's file."""
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
    """Return a short text file's content."""
    try:
        size = path.stat().st_size
        text = path.read_text(encoding="utf-8") if size <= LONGEST_TEXT else ""
    except (OSError, ValueError) as error:
        raise InvalidInputError(
            f"map {path}: got {error}, expected a readable YAML file of Nav2's map server"
        ) from error
    if size > LONGEST_TEXT:
        raise InvalidInputError(
            f"map {path}: got a file of {size} bytes, expected at most {LONGEST_TEXT}"
        )
    return text


def parse(text: str, name: str) -> dict[str, Any]:
    """Return the keys of a YAML file with one level: numbers, texts, and lists of numbers.

    Raises:
        InvalidInputError: on anything else, and on a key that is there twice.
    """
    keys: dict[str, Any] = {}
    listed: list[Any] | None = None
    for number, line in enumerate(text.removeprefix("\ufeff").splitlines(), start=1):
        bare = re.sub(r"(^|\s)#.*$", "", line).rstrip()
        if not bare.strip() or bare in ("---", "..."):
            continue
        if listed is not None and re.match(r"\s*-\s", bare):
            listed.append(_scalar(bare.strip()[1:].strip()))
            continue
        found = _KEY.match(bare)
        if found is None or found[1] in keys:
            problem = "twice the key" if found else "the line"
            raise InvalidInputError(
                f"map {name}: got {problem} {bare!r} (line {number}), expected lines 'key: value' "
                f"with keys among {[*NEEDED, *OPTIONAL]}"
            )
        rest = (found[2] or "").strip()
        listed = None if rest else []
        keys[found[1]] = _value(rest) if rest else listed
    return keys


def _value(text: str) -> Any:
    """Return a number, a truth value, a text, or a list of them; of lists in a list the text."""
    if text.startswith("[") and text.endswith("]"):
        inner = text[1:-1].strip().rstrip(",")
        return [_scalar(item.strip()) for item in inner.split(",")] if inner else []
    return _scalar(text)


def _scalar(text: str) -> Any:
    """Return a number, a truth value or a text."""
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


def _shade(path: Path, mode: str) -> tuple[Any, Any]:
    """Return an image's brightness from 0 to 1, and where it is transparent."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # refused here if large
            image = Image.open(path, formats=list(_IMAGES))
        with image:
            width, height = image.size
            checked_shape((height, width))  # before anything is decoded
            if image.mode not in _PLAIN:
                raise InvalidInputError(
                    f"map image {path}: got the mode {image.mode!r}, expected 8 bits a channel"
                )
            colours = np.asarray(image.convert("RGBA"))
    except InvalidInputError:
        raise
    except (OSError, ValueError, SyntaxError, MemoryError, Image.DecompressionBombError) as error:
        raise InvalidInputError(
            f"map image {path}: got {error}, expected a readable {' or '.join(_IMAGES.values())}"
        ) from error
    has_opacity = bool((colours[..., 3] < 255).any())
    channels = 4 if has_opacity and mode == "trinary" else 3
    shade = colours[..., :channels].astype(np.float64).mean(axis=2) / 255.0
    clear = (colours[..., 3] < 255) & (mode == "scale")
    return shade, clear
