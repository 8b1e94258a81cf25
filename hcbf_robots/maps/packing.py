"""Writes maps of arrays as plain dicts that JSON can hold, and reads them."""

import base64
import binascii
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from hcbf_gym import records
from hcbf_gym.arrays import Mask
from hcbf_gym.errors import InvalidInputError, check_options
from hcbf_gym.models.grid import Grid
from hcbf_robots.maps.map_class import MapClass

KEYS = ("resolution", "origin", "shape", "classes")


def packed(grid: Grid, classes: tuple[MapClass, ...]) -> dict[str, object]:
    """Return a map as a plain dict, its cells packed into text."""
    return {
        "resolution": grid.resolution,
        "origin": list(grid.origin),
        "shape": list(grid.shape),
        "classes": [
            {"name": region.name, "rank": region.rank, "kind": region.kind}
            | {"cells": _packed_cells(region.cells), "limit": region.limit, "margin": region.margin}
            for region in classes
        ],
    }


def unpacked(data: Mapping[str, Any]) -> tuple[Grid, tuple[MapClass, ...]]:
    """Return the grid and the classes of a dict that `packed` wrote."""
    check_options("map", data, KEYS)
    missing = [key for key in KEYS if key not in data]
    if missing:
        raise InvalidInputError(
            f"map: {missing} is missing, expected {list(KEYS)}, or 'file' for a map in files"
        )
    grid = Grid(data["resolution"], data["origin"], data["shape"])
    entries = data["classes"]
    if not isinstance(entries, list | tuple):
        raise InvalidInputError(f"map: classes: got {entries!r}, expected a list")
    classes = []
    for entry in entries:
        records.check_mapping("map: class", entry)
        fields = {**entry, "cells": _unpacked_cells(entry.get("cells"), grid.shape)}
        classes.append(records.build("map: class", MapClass, fields))
    return grid, tuple(classes)


def _packed_cells(cells: Mask) -> str:
    """Return the bits of all cells, row by row, compressed and in base 64."""
    return base64.b64encode(zlib.compress(np.packbits(cells).tobytes(), 9)).decode("ascii")


def _unpacked_cells(text: Any, shape: tuple[int, int]) -> Mask:
    """Return the cells (rows, columns) of a text; decompression ends where it has too many."""
    count = shape[0] * shape[1]
    size = -(-count // 8)  # bytes, rounded up
    try:
        reader = zlib.decompressobj()
        data = reader.decompress(base64.b64decode(text, validate=True), size + 1)
    except (TypeError, ValueError, binascii.Error, zlib.error) as error:
        raise InvalidInputError(
            f"map: class: cells: got no packed cells ({error}), expected what to_dict wrote"
        ) from error
    if len(data) != size:
        raise InvalidInputError(
            f"map: class: cells: got {8 * len(data)} cells or more, expected {count}"
        )
    return np.unpackbits(np.frombuffer(data, np.uint8), count=count).astype(bool).reshape(shape)
