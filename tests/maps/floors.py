"""Small maps for tests, drawn anew from a seed."""

import os
from pathlib import Path

import numpy as np

from hcbf_robots.maps import Grid, MapClass, RankedMap

MAPS = Path(os.environ.get("HCBF_DATA", "nowhere")) / "maps"
WITHOUT_MAPS = "needs HCBF_DATA, a folder with maps that are not the project's own"

ORIGINS = ((0.0, 0.0, 0.0), (-3.0, 2.0, 0.5), (10.0, -7.0, -2.2))


def cells(seed, shape=(60, 80)):
    """Return rooms with walls, a turned wall and clutter."""
    rng = np.random.default_rng(seed)
    found = np.zeros(shape, dtype=np.bool_)
    for _ in range(6):
        r, c = rng.integers(0, shape[0] - 2), rng.integers(0, shape[1] - 2)
        h, w = rng.integers(1, 20), rng.integers(1, 4)
        h, w = (h, w) if rng.random() < 0.5 else (w, h)
        found[r : r + h, c : c + w] = True
    angle, (r, c) = rng.uniform(0.0, np.pi), rng.uniform(10, 50, 2)
    for s in np.arange(0.0, 25.0, 0.2):
        i, j = int(r + s * np.sin(angle)), int(c + s * np.cos(angle))
        if 0 <= i < shape[0] and 0 <= j < shape[1]:
            found[i, j] = True
    found |= rng.random(shape) < 0.003
    return found


def room(seed=0, origin=(0.0, 0.0, 0.0), **others):
    """Return a map of 3 m x 4 m with a strict class; `others`: name -> further classes."""
    strict = MapClass("walls", 1, "keepout", cells(seed))
    return RankedMap(Grid(0.05, origin, strict.cells.shape), (strict, *others.values()))


def on_map(ranked, start):
    """Return a scene of this package on a map, as a dict."""
    return {
        "name": "room",
        "barriers": [],
        "reference": {"kind": "point", "goal": [2.0, 1.5]},
        "start": list(start),
        "map": ranked.to_dict(),
        "task": "reach",
        "v_max": 1.5,
    }


def true_distance(ranked, mask, points):
    """Return (N,) the distance from the union of the true cells' closed squares [m]."""
    at = ranked.grid.to_cells(points)
    low = np.argwhere(mask)[:, ::-1]
    near = np.clip(at[:, None], low[None], low[None] + 1)
    gap = np.linalg.norm(near - at[:, None], axis=2).min(axis=1, initial=np.inf)
    return gap * ranked.grid.resolution
