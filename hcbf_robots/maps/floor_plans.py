"""Floor plans (a flat, an office, a warehouse, with zones), and random starts and goals in maps.

The plans are map files of Nav2, which `scripts/floor_plans.py` draws. A body of radius `CLEAR` can
move from start to goal without entering anything but slow zones.
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
SLOW = 0.5  # speed limit in the plans' slow zones [m/s]
CLEAR = 0.7  # distance of the path from start to goal to everything but speed zones [m]
APART = 3.0  # least distance between start and goal, where the map has such places [m]
_GOAL_CANDIDATES = 16


def through(floor: RankedMap, rng: np.random.Generator, start: Array, goal: Array) -> None:
    """Draw a start and a goal in a map, between which a path exists.

    Args:
        floor: the map.
        rng: the source of randomness; every call takes the same number of draws.
        start: (2,) overwritten with the start [m].
        goal: (2,) overwritten with the goal [m].
    """
    free = places(floor)
    drawn = free[rng.integers(len(free), size=1 + _GOAL_CANDIDATES)]
    candidates = drawn[1:]
    distances = np.linalg.norm(candidates - drawn[0], axis=1)
    far = np.flatnonzero(distances >= APART)
    start[:] = drawn[0]
    goal[:] = candidates[far[0] if far.size else int(np.argmax(distances))]


def draw(plan: str, rng: np.random.Generator, scene: Any) -> None:
    """Draw start and goal of a scene in a plan, one of `NAMES`; see `through`."""
    through(load(plan), rng, scene.start, scene.goal)


@cache
def load(plan: str) -> RankedMap:
    """Return a plan as a map: occupied and unknown cells are strict (rank 1), zones are not."""
    slow: dict[str, object] = {"rank": 2, "kind": "speed", "limit": SLOW, "name": "slow"}
    masks: dict[str, int | dict[str, object]] = {
        f"{plan}_keepout.yaml": {"rank": 2, "name": "keepout"},
        f"{plan}_avoid.yaml": {"rank": 3, "name": "avoid"},
        f"{plan}_slow.yaml": slow,
    }
    loaded = RankedMap.load(FOLDER / f"{plan}.yaml", masks)
    return RankedMap(loaded.grid, loaded.classes)  # so that saved scenes have cells, not file names


def described(data: object) -> RankedMap:
    """Return the map that a plain dict describes; the same dict gives the same, cached map."""
    records.check_mapping("map", data)
    return _described(json.dumps(records.plain(data), sort_keys=True))


@lru_cache(maxsize=8)
def _described(text: str) -> RankedMap:
    return RankedMap.from_dict(json.loads(text))


@lru_cache(maxsize=8)
def places(floor: RankedMap) -> Array:
    """Return the centres (K, 2) of the largest connected area for a body of radius `CLEAR` [m]."""
    from scipy import ndimage

    closed = np.zeros(floor.grid.shape, dtype=np.bool_)
    for region in floor.classes:
        if region.kind != "speed":
            closed |= region.cells
    labels: Any = np.zeros(closed.shape, dtype=np.int64)  # 0 for no area
    ndimage.label(_clearance(closed, floor.grid.resolution) > CLEAR, output=labels)
    if not labels.any():
        raise InvalidInputError(
            f"map: got no cell that is {CLEAR} m from everything, expected room for start and goal"
        )
    largest = 1 + np.argmax(np.bincount(labels.ravel())[1:])
    rows, columns = np.nonzero(labels == largest)
    centres = floor.grid.to_world(np.column_stack([columns, rows]) + 0.5)
    centres.flags.writeable = False
    return centres


def _clearance(cells: Mask, resolution: float) -> Array:
    """Return (rows, columns) a lower bound on each centre's distance from occupied cells [m].

    All outside the map counts as occupied. The transform measures between centres of cells, and an
    occupied cell reaches half of its diagonal beyond its centre.
    """
    from scipy import ndimage

    free = np.pad(~cells, 1)
    distances: Any = ndimage.distance_transform_edt(free)
    return resolution * (distances[1:-1, 1:-1] - np.sqrt(0.5))
