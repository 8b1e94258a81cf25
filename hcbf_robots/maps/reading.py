"""Classes of a map from its files: the map itself, and masks over it."""

import logging
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym import records
from hcbf_gym.arrays import Mask
from hcbf_gym.errors import InvalidInputError, check_options, finite_float, shown, warn_caller
from hcbf_gym.models.grid import Grid
from hcbf_robots.maps import nav2
from hcbf_robots.maps.map_class import MapClass
from hcbf_robots.maps.nav2 import Raster
from hcbf_robots.maps.regrid import onto

Classes = tuple[MapClass, ...]

_LOGGER = logging.getLogger("hcbf_robots.maps")

USUAL: dict[str, object] = {"rank": 1, "unknown": 1, "margin": 0.0}  # of `RankedMap.load`

KNOWN_FREE = 25  # a cell whose occupancy is lower is free, in the graded modes, too
SURELY_OCCUPIED = 65
"""A cell of the map is occupied above that, and unknown between both; a mask counts from free."""

OF_MASK = ("rank", "kind", "name", "margin", "limit", "base", "multiplier")

MOST_LIMITS = 16  # speed limits in one mask, each of which becomes a class


def log(file: str | Path, raster: Raster) -> None:
    """Log how many cells a map shows free, occupied and unknown."""
    occupied, unknown = (int(cells.sum()) for cells in _split(raster))
    free = raster.occupancy.size - occupied - unknown
    _LOGGER.info("map %s: %d cells free, %d occupied, %d unknown", file, free, occupied, unknown)


def source(
    file: str | Path,
    masks: Mapping[str, object] | None,
    rank: int,
    unknown: int | None,
    margin: float,
) -> dict[str, object]:
    """Return what `RankedMap.from_dict` takes to read the same files; what is usual is left out."""
    given = {"rank": rank, "unknown": unknown, "margin": margin}
    described: dict[str, object] = {"file": str(file)}
    if masks:
        described["masks"] = records.plain(masks)
    described |= {name: value for name, value in given.items() if value != USUAL[name]}
    return described


def read(
    file: str | Path,
    masks: Mapping[str, object],
    rank: int,
    unknown: int | None,
    margin: float,
) -> tuple[Grid, Classes]:
    """Read a map and its masks, and log what the map shows; see `RankedMap.load`."""
    if not isinstance(file, str | Path) or not str(file):
        raise InvalidInputError(f"map: file: got {shown(file)}, expected the path of a YAML file")
    file = records.expanded("map: file", str(file))
    raster = nav2.read(file)
    found = of_map(raster, rank, unknown, margin)
    records.check_mapping("map: masks", masks)
    for name, entry in masks.items():
        found += _of_mask_file(Path(file).parent / name, name, entry, raster.grid, unknown)
    strict = np.zeros(raster.grid.shape, dtype=np.bool_)
    for one in found:
        strict |= one.cells & one.is_strict
    if strict.all():
        raise InvalidInputError(
            f"map {file}: got no cell that a robot may be in, expected some that are not strict: "
            "see negate and the thresholds, or unknown=None"
        )
    log(file, raster)
    return raster.grid, tuple(found)


def of_map(raster: Raster, rank: int, unknown: int | None, margin: float) -> list[MapClass]:
    """Return the classes "occupied" and, where it has a rank, "unknown"."""
    occupied, doubtful = _split(raster)
    found = [MapClass("occupied", rank, "keepout", occupied, margin=margin)]
    if unknown is not None:
        found.append(MapClass("unknown", unknown, "unknown", doubtful, margin=margin))
    return found


def _split(raster: Raster) -> tuple[Mask, Mask]:
    """Return which cells (rows, columns) of a map are occupied, and which are unknown."""
    occupied = raster.occupancy > SURELY_OCCUPIED
    return occupied, (raster.occupancy < 0) | (~occupied & (raster.occupancy >= KNOWN_FREE))


def _of_mask_file(
    path: Path, name: str, entry: object, grid: Grid, unknown: int | None
) -> list[MapClass]:
    """Return the classes of a mask's file, on the map's cells."""
    label = f"map: mask {name!r}"
    fields: dict[str, Any] = dict(entry) if isinstance(entry, Mapping) else {"rank": entry}
    records.check_mapping(label, fields)
    check_options(label, fields, OF_MASK)
    if "rank" not in fields:
        raise InvalidInputError(f"{label}: 'rank' is missing, expected an integer")
    raster, classes = nav2.read(path, drawn=True), []
    for one in of_mask(raster, label, {"name": Path(name).stem, "kind": "keepout"} | fields):
        cells, beyond = onto(grid, one.cells, raster.grid)
        classes.append(replace(one, cells=cells))
        if beyond and (unknown is None or unknown > one.rank):
            warn_caller(
                f"{label}: some of its cells, of rank {one.rank}, lie beyond the map, where with "
                f"unknown={unknown} all is "
                f"{'free' if unknown is None else f'of rank {unknown}'}: they are left out; "
                f"expected a larger map, or unknown={one.rank}",
            )
    return classes


def of_mask(raster: Raster, label: str, fields: dict[str, Any]) -> list[MapClass]:
    """Return the classes of a mask: one keepout, or one for each speed limit in it.

    The fields are those of `MapClass` but for the cells, with "base" and "multiplier" in place of
    "limit"; `label` names it in messages.
    """
    base, multiplier = fields.pop("base", None), fields.pop("multiplier", None)
    if base is None and multiplier is None:
        return [MapClass(cells=raster.occupancy >= KNOWN_FREE, **fields)]
    if fields["kind"] != "speed" or "limit" in fields:
        raise InvalidInputError(
            f"{label}: got base and multiplier for the kind {fields['kind']!r}, expected them for "
            "the kind 'speed' alone, and no limit beside them"
        )
    base = finite_float(f"{label}: base", base)
    slope = finite_float(f"{label}: multiplier", multiplier)
    levels = [int(n) for n in np.unique(raster.occupancy) if n > 0 and base + slope * n > 0.0]
    if len(levels) > MOST_LIMITS:
        raise InvalidInputError(
            f"{label}: got {len(levels)} speed limits, expected at most {MOST_LIMITS}"
        )
    stem = fields.pop("name")
    return [
        MapClass(f"{stem} {n}", cells=raster.occupancy == n, limit=base + slope * n, **fields)
        for n in levels
    ]
