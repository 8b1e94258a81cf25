"""Times covers of rasters: ``python -m benchmarks.covers [--side 1000] [--before COMMIT]``.

With a commit its cover is timed in the same run, on rasters of `SMALL` cells a side unless the
raster is a map; a checkerboard took it time that grows with the third power of that side.
"""

import argparse
import os
import subprocess
import time
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba
import numpy as np

from hcbf_gym.arrays import Mask
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.maps import RankedMap
from hcbf_gym.maps.cover import Cover

SMALL = 800


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


def of_commit(commit: str) -> Any:
    """Return the class `Cover` of a commit."""
    name = f"{commit}:hcbf_gym/maps/cover.py"
    text = subprocess.run(["git", "show", name], capture_output=True, text=True, check=True).stdout
    module = types.ModuleType("cover_before")
    vars(module)["njit"] = numba.njit
    exec(compile(text.replace("@kernel()", "@njit"), name, "exec"), vars(module))
    return vars(module)["Cover"]


def timed(cover: Any, cells: Mask) -> tuple[Any, float]:
    """Return a cover, or why there is none, and the CPU time it took [s]."""
    cells = cells.copy()  # of the layout for which all is compiled
    begun = time.process_time()
    try:
        made = cover.of(cells)
    except InvalidInputError as error:
        made = error
    return made, time.process_time() - begun


def main() -> None:
    """Time all of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, default=1000)
    parser.add_argument("--before")
    args = parser.parse_args()
    before = of_commit(args.before) if args.before else None
    corner = np.ones((3, 3), dtype=np.bool_)
    _ = Cover.of(corner), before and before.of(corner)  # compiled
    for cells_of in (rasters(args.side), maps()):
        for name, cells in cells_of:
            made, seconds = timed(Cover, cells)
            says = f"{len(made.sizes):,} pieces" if isinstance(made, Cover) else f"refused: {made}"
            line = f"{name:22} {cells.size:>10,} cells {seconds:6.2f} s  {says}"
            if before is not None:
                small = cells if cells.size < 10**6 else cells[:SMALL, :SMALL]
                (now, new), (then, old) = timed(Cover, small), timed(before, small)
                same = isinstance(now, Cover) and np.array_equal(now.corners, then.corners)
                line += f"; {small.size:,} cells {new:.2f} s, before {old:.2f} s, "
                line += "the same pieces" if same else f"{len(then.sizes):,} pieces before"
            print(line, flush=True)


if __name__ == "__main__":
    main()
