"""Times covers of rasters: ``python -m benchmarks.covers [--side 1000]``."""

import argparse
import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from hcbf_gym.arrays import Mask
from hcbf_gym.errors import InvalidInputError
from hcbf_robots.maps import RankedMap
from hcbf_robots.maps.cover import Cover


def rasters(side: int) -> Iterator[tuple[str, Mask]]:
    """Yield name → cells that are hard to cover."""
    rng = np.random.default_rng(0)
    r, c = np.indices((side, side))
    yield "checkerboard", (r + c) % 2 == 0
    yield "dots", (r % 2 == 0) & (c % 2 == 0)
    for share in (0.02, 0.1, 0.3, 0.5, 0.7, 0.9):
        yield f"random {share:.0%}", rng.random((side, side)) < share
    yield "stripes", r % 2 == 0
    yield "diagonal stripes", (r + c) % 3 == 0
    yield "steep stripes", (3 * r + c) % 7 == 0
    yield "crooked stripes", (1.618 * r + c) % 5.0 < 1.0
    yield "triangle", r + c >= side
    yield "comb", (r < 2) | (c % 2 == 0)
    x, y = c - side / 2.0, r - side / 2.0
    yield "spiral", (np.hypot(x, y) / 2.5 - np.arctan2(y, x) / np.pi) % 2.0 < 1.0
    yield "rings", np.hypot(x, y) % 3.0 < 1.0
    yield "full", np.ones((side, side), dtype=np.bool_)
    yield "noise in rooms", (rng.random((side, side)) < 0.01) | (r % 100 == 0) | (c % 100 == 0)


def maps() -> Iterator[tuple[str, Mask]]:
    """Yield name → occupied and unknown cells of the maps in $HCBF_DATA."""
    for file in sorted(Path(os.environ.get("HCBF_DATA", "nothing"), "maps").glob("*.yaml")):
        for one in RankedMap.load(file, unknown=2).classes:
            yield f"{file.stem} {one.name}", one.cells


def timed(cells: Mask) -> tuple[Cover | InvalidInputError, float]:
    """Return the cover, or why there is none, and the CPU time it took [s]."""
    begun = time.process_time()
    made: Cover | InvalidInputError
    try:
        made = Cover.of(cells)
    except InvalidInputError as error:
        made = error
    return made, time.process_time() - begun


def main() -> None:
    """Time all of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, default=1000)
    args = parser.parse_args()
    for cells_of in (rasters(args.side), maps()):
        for name, cells in cells_of:
            made, seconds = timed(cells)
            says = f"{len(made.sizes):,} pieces" if isinstance(made, Cover) else f"refused: {made}"
            print(f"{name:22} {cells.size:>10,} cells {seconds:6.2f} s  {says}", flush=True)


if __name__ == "__main__":
    main()
