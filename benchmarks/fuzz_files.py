"""Contracts, outlines and logs that are malformed at random: refused in words, or valid."""

import functools
import json
import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.suites.mutations import mutated
from hcbf_gym.barriers import HalfPlane
from hcbf_gym.errors import HcbfError
from hcbf_robots import Command, VelocityFilter, carts
from hcbf_robots.identification.log import identify_log
from hcbf_robots.walkers import Walker, footprint
from tests.studies import drives

IN_WORDS = ("expected", "missing", "meet", "drive for")  # one of them is in each refusal
COMMAND = Command(1.2, 2.5, look_ahead=0.25)  # The shipped cart's


def lines(count: int) -> Iterator[str]:
    """Yield how many of `count` malformed contracts, footprints and logs were refused in words."""
    for name, use in {"contract": _contract, "footprint": _footprint, "log": _log}.items():
        refused = taken = 0
        for k in range(count):
            with tempfile.TemporaryDirectory() as folder:
                try:
                    use(np.random.default_rng([9, k]), Path(folder))
                    taken += 1
                except HcbfError as error:
                    refused += 1
                    if not any(word in str(error) for word in IN_WORDS):
                        raise AssertionError(f"{name} {k}: {error}: what was expected?") from error
        yield f"{name}: {refused} refused in words, {taken} taken"


def _contract(rng: np.random.Generator, folder: Path) -> None:
    data: Any = json.loads((carts.FOLDER / "cart.json").read_text(encoding="utf-8"))
    data["mjcf"] = str(carts.FOLDER / data["mjcf"])
    file = folder / "robot.json"
    file.write_text(json.dumps(mutated(data, rng), default=str), encoding="utf-8")
    VelocityFilter(file, [HalfPlane("wall", 1, (-1.0, 0.0), -3.0)])


def _footprint(rng: np.random.Generator, folder: Path) -> None:
    angles = np.sort(rng.uniform(0.0, math.tau, 6))
    corners: Any = (rng.uniform(0.2, 0.5, 6) * np.array([np.cos(angles), np.sin(angles)])).T
    how = int(rng.integers(1, 6))
    if how == 1:
        corners = corners + rng.uniform(0.6, 2.0, 2)
    elif how == 2:
        corners = corners * (1.0, 0.0)
    elif how == 3:
        corners[int(rng.integers(6)), int(rng.integers(2))] = rng.choice([np.nan, np.inf, 1e4])
    elif how == 4:
        corners = str(corners.tolist())[: int(rng.integers(1, 60))]
    else:
        corners = corners[: int(rng.integers(0, 3))]
    footprint.reach(corners)


def _log(rng: np.random.Generator, folder: Path) -> None:
    rows = np.array(_drive(), dtype=np.float64)
    how = int(rng.integers(7))
    if how == 0:  # time runs backwards
        rows[int(rng.integers(20, len(rows))), 0] -= rng.uniform(1.0, 9.0)
    elif how == 1:
        rows[:, 6] = np.degrees(rows[:, 6])
    elif how == 2:
        rows[:, 7] *= rng.uniform(0.2, 0.6)
    elif how == 3:
        rows[:, 3] = 0.5
    elif how == 4:
        rows = rows[: int(rng.integers(0, 200))]
    elif how == 5:
        named = [k for k, name in enumerate(drives.HEADER) if name != "cmd_vy"]
        rows[int(rng.integers(len(rows))), int(rng.choice(named))] = np.inf
    else:
        shifted = np.isfinite(rows[:, 1])
        rows[shifted, 0] += rng.uniform(20.0, 1e6)
    cells = [[None if np.isnan(one) else one for one in row] for row in rows]
    identify_log(drives.write(folder / "drive.csv", cells, differential=True), COMMAND)


@functools.cache
def _drive() -> list[list[float | None]]:
    """Return the lines of one drive of the shipped cart, driven once."""
    return drives.recorded(drives.drive(Walker.load("cart"), 0), 0)
