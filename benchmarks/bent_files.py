"""Contracts, outlines and logs bent at random: each is refused in words, or whole."""

import dataclasses
import functools
import json
import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym.barriers import HalfPlane
from hcbf_gym.errors import HcbfError
from hcbf_robots import Command, VelocityFilter, carts
from hcbf_robots.identification.log import identify_log
from hcbf_robots.walkers import Walker, footprint, walker_parts
from tests.studies import drives

IN_WORDS = ("expected", "missing", "meet", "drive for")
"""One of them stands in each sentence that refuses."""
WRONG = (math.nan, math.inf, -1.0, 0.0, 1e300, "fast", None, [], {}, True, [1.0, 2.0])
SECTIONS = {
    "command": walker_parts.Command,
    "action": walker_parts.Action,
    "body": walker_parts.Body,
    "fall": walker_parts.Fall,
    "physics": walker_parts.Physics,
}
"""Of a contract."""
COMMAND = Command(1.2, 2.5, look_ahead=0.25)
"""The shipped cart's."""


def bent(quick: bool, count: int) -> Iterator[str]:
    """Yield how many bent contracts, footprints and logs were refused in words."""
    kinds = {"contract": _bent_contract, "footprint": _bent_footprint, "log": _bent_log}
    for name, make in kinds.items():
        refused = taken = 0
        for k in range(8 if quick else count // len(kinds)):
            with tempfile.TemporaryDirectory() as folder:
                try:
                    make(np.random.default_rng([9, k]), Path(folder))
                    taken += 1
                except HcbfError as error:
                    refused += 1
                    text = str(error)
                    if not any(word in text for word in IN_WORDS):
                        raise AssertionError(f"{name} {k}: {text}: what was expected?") from error
        yield f"{name}: {refused} refused in words, {taken} taken"


def _bent_contract(rng: np.random.Generator, folder: Path) -> None:
    data: Any = json.loads((carts.FOLDER / "cart.json").read_text(encoding="utf-8"))
    data["mjcf"] = str(carts.FOLDER / data["mjcf"])
    place, key, kind = data, str(rng.choice(list(data))), Walker
    if isinstance(data[key], dict) and rng.random() < 0.7:
        place, kind = data[key], SECTIONS[key]
        key = str(rng.choice(list(place)))
    how, wrong = rng.integers(3), WRONG[int(rng.integers(len(WRONG)))]
    spare = place is data and not _needed(SECTIONS.get(key, Walker))  # a section
    if (how == 0 and (spare or key not in _needed(kind))) or (how == 2 and spare and wrong == {}):
        _bent_contract(rng, folder)  # that would be whole
        return
    if how == 0:
        del place[key]
    elif how == 1:
        place[f"{key}_"] = place.pop(key)
    else:
        place[key] = wrong
    file = folder / "robot.json"
    file.write_text(json.dumps(data), encoding="utf-8")
    VelocityFilter(file, [HalfPlane("wall", 1, (-1.0, 0.0), -3.0)])


def _needed(kind: type) -> set[str]:
    """Return the keys that a contract, or a section of it, must have."""
    return {
        one.name
        for one in dataclasses.fields(kind)
        if one.default is dataclasses.MISSING and one.default_factory is dataclasses.MISSING
    }


def _bent_footprint(rng: np.random.Generator, folder: Path) -> None:
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


def _bent_log(rng: np.random.Generator, folder: Path) -> None:
    rows = np.array(_drive(), dtype=np.float64)
    how = int(rng.integers(7))
    if how == 0:  # time goes back
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
    lines = [[None if np.isnan(one) else one for one in row] for row in rows]
    file = drives.write(folder / "drive.csv", lines, differential=True)
    identify_log(file, COMMAND)


@functools.cache
def _drive() -> list[list[float | None]]:
    """Return the lines of one drive of the shipped cart, driven once."""
    return drives.recorded(drives.drive(Walker.load("cart"), 0), 0)
