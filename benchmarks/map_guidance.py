"""Guidance on maps: how fast fields are, who arrives, through corridors, and out of zones.

``python -m benchmarks.map_guidance --part guided`` runs a part and prints its table; the suite
`map-guidance` runs them all. Maps are those of ``$HCBF_DATA`` and the floor plans of the package.
"""

import os
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import joblib
import numpy as np
import tyro
from rich.console import Console
from scipy import ndimage

from hcbf_gym import _core, scenarios
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import BarrierSet
from hcbf_gym.barriers.mapped import MappedRegion
from hcbf_gym.errors import InvalidInputError, choose
from hcbf_gym.evaluation.episode import samples
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.guidance import Geodesic, Pull
from hcbf_gym.guidance import field as fields
from hcbf_gym.guidance.map_ground import MapGround
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.policies import PDTracker
from hcbf_gym.scenarios import Scenario
from hcbf_gym.scenarios.references import PointReference
from hcbf_gym.wrappers import SafetyFilter
from hcbf_robots.maps import Grid, MapClass, RankedMap

BODY = 0.3
"""Radius of the body on the reduced-order model [m]."""
V_MAX = 1.0
STANDS = 0.05
"""Slower than that a robot stands [m/s]."""
STEP = 0.02
"""Of the environments [s]."""
LONGEST = 15_000
"""Steps that a way may take."""
NAV2: dict[str, dict[str, int]] = {"depot": {"depot_keepout.yaml": 2}, "tb3_sandbox": {}}
MODELS = {"rom": "HCBF-Regions-v0", "cart": "HCBF-WalkerRegions-v0"}
ROOM = {"rom": BODY, "cart": 0.55}
"""What start and goal keep from edges [m]: where the body and its margins have room."""


def maps() -> dict[str, RankedMap]:
    """Return the maps that are at hand."""
    found: dict[str, RankedMap] = {}
    folder = os.environ.get("HCBF_DATA")
    for name, masks in NAV2.items() if folder else ():
        found[name] = RankedMap.load(Path(str(folder)) / "maps" / f"{name}.yaml", masks)
    for name in scenarios.names():
        if name.startswith("map-"):
            floor = scenarios.make(name, np.random.default_rng(0)).map
            assert isinstance(floor, RankedMap)
            found[name.removeprefix("map-")] = floor
    return found


def regions_of(floor: RankedMap) -> tuple[MappedRegion, ...]:
    """Return the classes of a map that are regions."""
    return tuple(one for one in floor.conditions if isinstance(one, MappedRegion))


class Places:
    """Where a body can be on a map, all joined by ways in the open.

    Args:
        floor: the map.
        room: what the places keep from every region [m].
    """

    def __init__(self, floor: RankedMap, room: float):
        self.base = MapGround(regions_of(floor), room, 0)
        joined, _ = ndimage.label(self.base.ground.rank[1:-1, 1:-1] == 0)  # pyright: ignore[reportGeneralTypeIssues] - one array and a number
        sizes = np.bincount(joined.ravel())
        self.cells = np.argwhere(joined == 1 + int(np.argmax(sizes[1:])))

    def draw(self, rng: np.random.Generator) -> tuple[float, float]:
        """Return one of them [m]."""
        j, i = self.cells[rng.integers(len(self.cells))]
        return fields.to_world(float(j), float(i), self.base.geometry)


class Walked(NamedTuple):
    """What became of one way.

    Attributes:
        arrived: whether the goal was reached.
        seconds: how long it took.
        stood: the longest time of standing [s].
        entered: whether a strict cell was entered.
        out: seconds until the zones were left; 0 where it began outside.
        way_out: length of the field's way out of them [m].
    """

    arrived: bool
    seconds: float
    stood: float
    entered: bool
    out: float = 0.0
    way_out: float = 0.0


def walk(
    floor: RankedMap,
    model: str,
    start: tuple[float, float],
    goal: tuple[float, float],
    guidance: Any = "geodesic",
    until_out: bool = False,
) -> Walked:
    """Let PD walk a way under the filter with guidance.

    Args:
        floor: the map.
        model: a name of `MODELS`.
        start: [m].
        goal: [m].
        guidance: as the filter takes it.
        until_out: whether the way ends where it has left the zones.
    """
    scene = Scenario(
        "map", (), PointReference(goal), start=start, task="reach", v_max=V_MAX, map=floor
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made: Any = gym.make(MODELS[model], scenario=scene, max_episode_steps=LONGEST)
        plant = made.unwrapped.plant
        if model == "rom":
            plant = replace(plant, uncertainty=Uncertainty(body=BODY))
        env: Any = SafetyFilter(made, plant=plant, guidance=guidance)
        walked = samples(env, PDTracker.for_env(env), seed=0)
        next(walked)
    zones = np.zeros(floor.grid.shape, dtype=np.bool_)
    for one in floor.classes:
        zones |= one.cells & (one.kind != "speed" and one.rank > 1)
    path = _way_out(floor, zones, start, goal)
    strict = [c.priority == 1 for c in scene.conditions]
    standing = longest = steps = 0
    out = 0.0 if path == 0.0 else np.inf
    entered = arrived = False
    for steps, (_, info, _, _, arrived, _) in enumerate(walked, 1):
        x = env.unwrapped.rom_state
        stands = not arrived and np.hypot(x[2], x[3]) < STANDS
        standing = standing + 1 if stands else 0
        longest = max(longest, standing)
        entered |= bool((np.asarray(info["min_h"])[: len(strict)][strict] < 0.0).any())
        column, row = floor.grid.to_cells(x[None, :2])[0].astype(int)
        if not np.isfinite(out) and not zones[row, column]:
            out = STEP * steps
        if STEP * longest > 10.0 or (until_out and np.isfinite(out)):
            break
    env.close()
    return Walked(bool(arrived), STEP * steps, STEP * longest, entered, float(out), path)


def _way_out(
    floor: RankedMap, zones: Mask, start: tuple[float, float], goal: tuple[float, float]
) -> float:
    """Return how long the field's way is from a start to where it leaves the zones [m]."""
    way = Geodesic()
    way.reset([floor], goal, None, BODY, start=start)
    view, geometry, end = fields.grid(way.field[0], way.geometry[0]), way.geometry[0], way.goal[0]
    point, length = np.array(start), 0.0
    while zones[_core.field_cell_of(point[0], point[1], geometry)] and length < 100.0:
        after = _further(view, geometry, end, point)
        length += float(np.linalg.norm(after - point))
        point = after
    return length


def _further(view: Any, geometry: Array, goal: Array, point: Array) -> Array:
    """Return the point one cell further down the field."""
    return np.array(_core.field_descent(view, geometry, goal, point[0], point[1], geometry[2]))


def fields_part(count: int) -> Table:
    """Measure fields, and those after a change, on every map, on one core."""
    rows = []
    for name, floor in maps().items():
        places, rng = Places(floor, BODY), np.random.default_rng(0)
        scene = BarrierSet([[floor]])
        shape = floor.grid.shape
        took: dict[str, list[float]] = {"ground": [], "field": [], "change": []}
        for _ in range(count):
            way, goal, start = Geodesic(), places.draw(rng), places.draw(rng)
            began = time.process_time()
            MapGround(regions_of(floor), BODY, 0)
            took["ground"].append(time.process_time() - began)
            began = time.process_time()
            way.reset(scene, goal, None, BODY, start=start)
            took["field"].append(time.process_time() - began)
            column, row = floor.grid.to_cells([places.draw(rng)])[0].astype(int)
            strict = next(k for k, one in enumerate(floor.classes) if one.is_strict)
            for present in (True, False):
                scene = BarrierSet([[_with_square(floor, strict, row, column, present)]])
                began = time.process_time()
                way.follow(scene, np.zeros(1))
                took["change"].append(time.process_time() - began)
            scene = BarrierSet([[floor]])
        cells = f"{shape[1]} x {shape[0]}"
        rows.append([name, cells, *(_milliseconds(took[key][1:]) for key in took)])
    header = ["map", "cells", "ground [ms]", "field with ground [ms]", "after a change [ms]"]
    return Table("Fields, mean / max", header, rows)


def _with_square(floor: RankedMap, k: int, row: int, column: int, present: bool) -> RankedMap:
    """Return a map with a square of half a metre put into a class, or as it was, uncovered."""
    if not present:
        return floor
    cells = floor.classes[k].cells.copy()
    half = max(1, round(0.25 / floor.grid.resolution))
    cells[max(0, row - half) : row + half, max(0, column - half) : column + half] = True
    window = cells[max(0, row - half) : row + half, max(0, column - half) : column + half]
    corner = max(0, row - half), max(0, column - half)
    return floor.update(corner, {floor.classes[k].name: window})


def _milliseconds(seconds: Sequence[float]) -> str:
    return f"{1e3 * np.mean(seconds):.1f} / {1e3 * np.max(seconds):.1f}"


def guided_part(count: int, models: Sequence[str] = ("rom", "cart")) -> Table:
    """Walk random ways on every map."""
    rows = []
    for model in models:
        for name, floor in maps().items():
            places = Places(floor, ROOM[model])
            rng = np.random.default_rng(1)
            ways = [(places.draw(rng), places.draw(rng)) for _ in range(count)]
            walked = _walk_all(floor, model, ways)
            rows.append([name, model, *_summary(walked)])
    return Table("PD with guidance, random ways", ["map", "model", *SUMMARY], rows)


SUMMARY = ("ways", "arrive", "longest stand [s]", "entered rank 1")


def _summary(walked: Sequence[Walked]) -> list[str]:
    """Return the cells of `SUMMARY`."""
    arrived = sum(one.arrived for one in walked)
    return [
        str(len(walked)),
        f"{arrived} of {len(walked)}",
        f"{max(one.stood for one in walked):.2f}",
        str(sum(one.entered for one in walked)),
    ]


def _walk_all(
    floor: RankedMap, model: str, ways: Sequence[tuple[Any, Any]], **options: Any
) -> list[Walked]:
    """Walk all ways on all cores; a fork inherits what is covered already."""
    walk_one = joblib.delayed(walk)
    found: Any = joblib.Parallel(n_jobs=-1)(
        walk_one(floor, model, start, goal, **options) for start, goal in ways
    )
    return list(found)


def corridor(angle: float, length: float = 8.0, side: float = 0.05) -> tuple[RankedMap, Array]:
    """Return a map with a corridor of 1 m through a block, turned, and its two mouths (2, 2) [m].

    Args:
        angle: by which it is turned on the grid [rad].
        length: of the block [m].
        side: of a cell [m].
    """
    half = 0.5 * length + 1.5
    n = round(2.0 * half / side)
    grid = Grid(side, (-half, -half, 0.0), (n, n))
    x, y = (np.stack(np.meshgrid(*2 * (np.arange(n) + 0.5,))) * side - half).reshape(2, n, n)
    along, across = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    block = (np.abs(along) < 0.5 * length - 1.0) & (np.abs(across) > 0.5)
    walls = block | (np.abs(along) > 0.5 * length + 0.5) | (np.abs(across) > 0.5 * length)
    mouths = np.outer([-0.5 * length, 0.5 * length], [np.cos(angle), np.sin(angle)])
    return RankedMap(grid, (MapClass("walls", 1, "keepout", walls),)), mouths


def corridors_part(count: int) -> Table:
    """Walk through a corridor of 1 m, straight and turned on the grid."""
    rows, straight = [], np.nan
    for degrees in (0.0, 30.0, 45.0):
        floor, (start, goal) = corridor(np.radians(degrees))
        way = (start[0], start[1]), (goal[0], goal[1])
        ways = (way, way[::-1])[: max(1, min(count, 2))]
        walked = [walk(floor, "rom", begin, end) for begin, end in ways]
        took = float(np.mean([one.seconds for one in walked]))
        straight = took if degrees == 0.0 else straight
        rows.append([f"{degrees:.0f}°", *_summary(walked), f"{took:.2f}", f"{took / straight:.3f}"])
    return Table("A corridor of 1 m", ["turned by", *SUMMARY, "time [s]", "to straight"], rows)


def keepout_part(count: int) -> Table:
    """Begin inside zones of lower ranks, strict pieces in the way or not."""
    rows = []
    for name, floor in maps().items():
        places = Places(floor, BODY)
        inside = np.zeros(floor.grid.shape, dtype=np.bool_)
        strict = MapGround(
            tuple(one for one in regions_of(floor) if one.priority == 1), BODY + 0.1, 0
        )
        for one in floor.classes:
            inside |= one.cells & (one.kind != "speed" and one.rank > 1)
        inside &= strict.ground.rank[1:-1, 1:-1] == 0
        cells = np.argwhere(inside)
        rng, ways = np.random.default_rng(2), []
        while len(ways) < count and len(cells):
            j, i = cells[rng.integers(len(cells))]
            start, goal = fields.to_world(float(j), float(i), strict.geometry), places.draw(rng)
            way = Geodesic()
            try:
                way.reset([floor], goal, None, BODY, start=start)
            except InvalidInputError:  # closed in by walls
                continue
            ways.append((start, goal))
        if not ways:
            continue
        walked = _walk_all(floor, "rom", ways, until_out=True)
        late = [one.out - one.way_out / Pull().speed for one in walked]
        in_time = sum(one <= 3.0 for one in late)
        rows.append(
            [
                name,
                str(len(walked)),
                str(sum(np.isfinite(one.out) for one in walked)),
                str(in_time),
                f"{np.median([one.out for one in walked]):.1f} / {max(late):.1f}",
                f"{max(one.stood for one in walked):.2f}",
                str(sum(one.entered for one in walked)),
            ]
        )
    header = [
        "map", "starts", "out", "within 3 s + way / 0.4 m/s", "time / most over way [s]",
        "longest stand [s]", "entered rank 1",
    ]  # fmt: skip
    return Table("Out of a zone", header, rows)


PARTS: dict[str, Callable[[int], Table]] = {
    "fields": fields_part,
    "guided": guided_part,
    "corridors": corridors_part,
    "keepout": keepout_part,
}
COUNTS = {"fields": 100, "guided": 100, "corridors": 2, "keepout": 100}
"""Goals and windows, ways, directions and starts of a full run, for each map."""


def run(quick: bool) -> dict[str, Any]:
    """Return the tables of all parts, in JSON's terms."""
    found = {name: part(2 if quick else COUNTS[name]) for name, part in PARTS.items()}
    return {name: one._asdict() for name, one in found.items()}


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the tables of the figures by the names of the parts."""
    return {name: Table(**one) for name, one in figures.items()}


def main(part: str = "fields", count: int | None = None) -> None:
    """Run a part, and print its table.

    Args:
        part: fields, guided, corridors or keepout.
        count: for each map; what is asked if not given.
    """
    choose("part", part, PARTS)
    Console().print(PARTS[part](COUNTS[part] if count is None else count).rich())


if __name__ == "__main__":
    from benchmarks import map_guidance  # under its own name, by which workers find it

    tyro.cli(map_guidance.main)
