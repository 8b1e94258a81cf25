"""Gaps of 17 free cells of 5 cm, passed under a pure pursuit that knows nothing of the filter."""

import math
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.judges.squares import distances
from benchmarks.ros.drive import TICK
from benchmarks.ros.ride import Ride, pursuit, write_map
from hcbf_robots.maps import Grid

CELLS, SIDE = 17, 0.05
"""Free cells of the gap, and their side [m]."""
WALL = 2.0, 0.15
"""Where the wall begins, and how thick it is [m]."""
LONGEST = 60.0
"""A drive ends then [s]."""


def drive(seed: int, *, oblique: bool) -> tuple[bool, float]:
    """Return whether the cart passed, and how near its circle came to the true cells [m].

    Every drive has its own place of the cells under the gap's middle, and its own speed.
    """
    rng = np.random.default_rng([39, seed])
    shut = np.zeros((160, 120), dtype=np.bool_)
    shut[:, 80:83] = True
    shut[72 : 72 + CELLS, 80:83] = False
    middle = rng.uniform(-0.5, 0.5) * SIDE
    origin = (WALL[0] - 80 * SIDE, middle - (72 + 0.5 * CELLS) * SIDE)
    start = np.array([rng.uniform(-0.5, 0.3), middle + rng.uniform(-0.02, 0.02), 0.0])
    if oblique:
        start[1:] = rng.uniform(-0.8, 0.8), rng.uniform(-1.0, 1.0)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "gap.yaml"
        write_map(file, shut, SIDE, origin)
        given = {
            "observation_sources": ["walls"],
            "walls.type": "map",
            "walls.file": str(file),
            "walls.unknown": 0,
        }
        planner = pursuit([(1.0, middle), (4.0, middle)], rng.uniform(0.25, 0.5))
        d = Ride(planner, given, start=start)
    while TICK * d.ticks < LONGEST and d.pose[0] < WALL[0] + WALL[1] + d.reach + 0.3:
        d.run(0.2)
    grid = Grid(SIDE, (*origin, 0.0), shut.shape)
    apart = float(distances(grid, shut, d.path[:, :2], 1.0).min()) - d.reach
    return d.pose[0] > WALL[0] + WALL[1] + d.reach, apart


def lines(quick: bool) -> Iterator[str]:
    """Yield how many passed."""
    count = 3 if quick else 20
    for oblique, needed in ((False, count), (True, math.floor(0.95 * count))):
        found = [drive(seed, oblique=oblique) for seed in range(count)]
        passed, apart = sum(one[0] for one in found), min(one[1] for one in found)
        miss = "" if passed >= needed and apart >= 0.0 else "MISS "
        yield (
            f"{miss}{'oblique' if oblique else 'straight'}: {passed} of {count} pass, "
            f"{apart:+.3f} m between circle and cells at least"
        )
