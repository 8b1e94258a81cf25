"""Reads the classes of a map from its files: the map itself, and masks over it."""

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

_LOGGER = logging.getLogger("hcbf_robots.maps")
DEFAULTS: dict[str, object] = {"rank": 1, "unknown": 1, "margin": 0.0}  # of `RankedMap.load`

FREE_BELOW, OCCUPIED_ABOVE = 25, 65
"""Occupancies [%]: cells of a map between both are unknown. In a mask all from 25 on counts."""

MASK_FIELDS = ("rank", "kind", "name", "margin", "limit", "base", "multiplier")
MOST_LIMITS = 16  # speed limits in one mask, each of which becomes a class


def log(file: str | Path, raster: Raster) -> None:
    """Log how many cells of a map are free, occupied and unknown."""
    occupied, unknown = (int(cells.sum()) for cells in _split(raster))
    free = raster.occupancy.size - occupied - unknown
    _LOGGER.info("map %s: %d cells free, %d occupied, %d unknown", file, free, occupied, unknown)


def read(
    file: str | Path,
    masks: Mapping[str, object],
    rank: int,
    unknown: int | None,
    margin: float,
) -> tuple[Grid, tuple[MapClass, ...], dict[str, object]]:
    """Return the fields of a `RankedMap` from its files: the grid, the classes and the source.

    The numbers of the map's cells are logged. `RankedMap.load` has the arguments.
    """
    if not isinstance(file, str | Path) or not str(file):
        raise InvalidInputError(f"map: file: got {shown(file)}, expected the path of a YAML file")
    source: dict[str, object] = {"file": str(file)}
    file = records.expanded("map: file", str(file))
    raster = nav2.read(file)
    classes = of_map(raster, rank, unknown, margin)
    records.check_mapping("map: masks", masks)
    for name, entry in masks.items():
        classes += _of_mask_file(Path(file).parent / name, name, entry, raster.grid, unknown)
    strict = np.zeros(raster.grid.shape, dtype=np.bool_)
    for region in classes:
        if region.is_strict:
            strict |= region.cells
    if strict.all():
        raise InvalidInputError(
            f"map {file}: got no cell that a robot may be in, expected some that are not strict: "
            "see negate and the thresholds, or unknown=None"
        )
    log(file, raster)
    if masks:
        source["masks"] = records.plain(masks)
    options = {"rank": rank, "unknown": unknown, "margin": margin}
    source |= {name: value for name, value in options.items() if value != DEFAULTS[name]}
    return raster.grid, tuple(classes), source


def of_map(raster: Raster, rank: int, unknown: int | None, margin: float) -> list[MapClass]:
    """Return the classes "occupied" and, where unknown cells have a rank, "unknown" of a map."""
    occupied_cells, unknown_cells = _split(raster)
    classes = [MapClass("occupied", rank, "keepout", occupied_cells, margin=margin)]
    if unknown is not None:
        classes.append(MapClass("unknown", unknown, "unknown", unknown_cells, margin=margin))
    return classes


def _split(raster: Raster) -> tuple[Mask, Mask]:
    """Return the occupied and the unknown cells (rows, columns) of a map."""
    is_occupied = raster.occupancy > OCCUPIED_ABOVE
    is_unseen, is_doubtful = raster.occupancy < 0, raster.occupancy >= FREE_BELOW
    return is_occupied, is_unseen | (is_doubtful & ~is_occupied)


def _of_mask_file(
    path: Path, name: str, entry: object, grid: Grid, unknown: int | None
) -> list[MapClass]:
    """Return the classes of a mask's file, transferred to the grid of the map.

    `entry` is the mask's rank, or its fields (`MASK_FIELDS`). `unknown` is the rank of all outside
    the map, or None if it is free.
    """
    label = f"map: mask {name!r}"
    fields: dict[str, Any] = dict(entry) if isinstance(entry, Mapping) else {"rank": entry}
    records.check_mapping(label, fields)
    check_options(label, fields, MASK_FIELDS)
    if "rank" not in fields:
        raise InvalidInputError(f"{label}: 'rank' is missing, expected an integer")
    raster, classes = nav2.read(path, drawn=True), []
    for region in of_mask(raster, label, {"name": Path(name).stem, "kind": "keepout"} | fields):
        cells, is_outside = onto(grid, region.cells, raster.grid)
        classes.append(replace(region, cells=cells))
        if is_outside and (unknown is None or unknown > region.rank):
            outside = "free" if unknown is None else f"of rank {unknown}"
            warn_caller(
                f"{label}: some of its cells, of rank {region.rank}, lie beyond the map, where "
                f"with unknown={unknown} all is {outside}: they are left out; "
                f"expected a larger map, or unknown={region.rank}",
            )
    return classes


def of_mask(raster: Raster, label: str, fields: dict[str, Any]) -> list[MapClass]:
    """Return the classes of a mask: one keepout, or one for each speed limit in it.

    The fields are those of `MapClass` without "cells". Graded speed limits have "base" and
    "multiplier" in place of "limit". `label` is the mask's name in messages.
    """
    base, multiplier = fields.pop("base", None), fields.pop("multiplier", None)
    if base is None and multiplier is None:
        return [MapClass(cells=raster.occupancy >= FREE_BELOW, **fields)]
    if fields["kind"] != "speed" or "limit" in fields:
        raise InvalidInputError(
            f"{label}: got base and multiplier for the kind {fields['kind']!r}, expected them for "
            "the kind 'speed' alone, and no limit beside them"
        )
    base = finite_float(f"{label}: base", base)
    multiplier = finite_float(f"{label}: multiplier", multiplier)
    levels = [level for level in np.unique(raster.occupancy).tolist() if level > 0]
    limits = {level: base + multiplier * level for level in levels}
    limits = {level: limit for level, limit in limits.items() if limit > 0.0}  # Nav2: others free
    if len(limits) > MOST_LIMITS:
        raise InvalidInputError(
            f"{label}: got {len(limits)} speed limits, expected at most {MOST_LIMITS}"
        )
    name = fields.pop("name")
    return [
        MapClass(f"{name} {level}", cells=raster.occupancy == level, limit=limit, **fields)
        for level, limit in limits.items()
    ]
