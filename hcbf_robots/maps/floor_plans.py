"""Floor plans: a flat, an office and a warehouse with zones, and ways through maps drawn at random.

The plans are map files of Nav2, which `scripts/floor_plans.py` draws. A body of radius `CLEAR` gets
from start to goal without entering anything: zones, too, leave a way.
"""

import json
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym import records
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.errors import InvalidInputError
from hcbf_robots.maps.ranked_map import RankedMap

NAMES = ("flat", "office", "warehouse")
FOLDER = Path(__file__).parent / "plans"

SLOW = 0.5  # speed limit in the zones of the plans [m/s]
CLEAR = 0.7  # what the way from start to goal leaves to everything but speed zones [m]
APART = 3.0  # least distance between start and goal, where the map has such places [m]
_TRIES = 16


def through(floor: RankedMap, rng: np.random.Generator, start: Array, goal: Array) -> None:
    """Draw another path through a map.

    Args:
        floor: the map.
        rng: gives as many numbers for every path.
        start: (2,) where the path's start is written [m].
        goal: (2,) where its end is written [m].
    """
    found = places(floor)
    first, *others = found[rng.integers(len(found), size=1 + _TRIES)]
    apart = np.linalg.norm(np.array(others) - first, axis=1)
    far = np.flatnonzero(apart >= APART)
    last = others[far[0] if far.size else int(np.argmax(apart))]
    start[:], goal[:] = first, last


def draw(plan: str, rng: np.random.Generator, scene: Any) -> None:
    """Fill start and goal of a scene with another path through a plan, one of `NAMES`."""
    through(load(plan), rng, scene.start, scene.goal)


@cache
def load(plan: str) -> RankedMap:
    """Return a plan: occupied cells and what lies beyond the walls are strict, zones are not."""
    slow: dict[str, object] = {"rank": 2, "kind": "speed", "limit": SLOW, "name": "slow"}
    masks: dict[str, int | dict[str, object]] = {
        f"{plan}_keepout.yaml": {"rank": 2, "name": "keepout"},
        f"{plan}_avoid.yaml": {"rank": 3, "name": "avoid"},
        f"{plan}_slow.yaml": slow,
    }
    read = RankedMap.load(FOLDER / f"{plan}.yaml", masks)
    return RankedMap(read.grid, read.classes)  # a scene that is saved holds cells, no paths


def described(data: object) -> RankedMap:
    """Return the map that a plain dict describes, read and covered once."""
    records.check_mapping("map", data)
    return _described(json.dumps(records.plain(data), sort_keys=True))


@lru_cache(maxsize=8)
def _described(text: str) -> RankedMap:
    return RankedMap.from_dict(json.loads(text))


@lru_cache(maxsize=8)
def places(floor: RankedMap) -> Array:
    """Return (K, 2) the middles of cells where a body can be, all joined by paths [m]."""
    from scipy import ndimage

    shut = np.zeros(floor.grid.shape, dtype=np.bool_)
    for one in floor.classes:
        shut |= one.cells & (one.kind != "speed")
    joined: Any = np.zeros(shut.shape, dtype=np.int64)
    ndimage.label(_clearance(shut, floor.grid.resolution) > CLEAR, output=joined)
    if joined.any():
        rows, columns = np.nonzero(joined == 1 + np.argmax(np.bincount(joined.ravel())[1:]))
        found = floor.grid.to_world(np.column_stack([columns, rows]) + 0.5)
        found.flags.writeable = False
        return found
    raise InvalidInputError(
        f"map: got no cell that is {CLEAR} m from everything, expected room for start and goal"
    )


def _clearance(cells: Mask, resolution: float) -> Array:
    """Return (rows, columns) how far the middle of each cell is from occupied squares at least [m].

    Beyond the map everything counts as occupied.
    """
    from scipy import ndimage

    framed = np.pad(~cells, 1)
    steps: Any = ndimage.distance_transform_edt(framed)
    return resolution * (steps[1:-1, 1:-1] - np.sqrt(0.5))
