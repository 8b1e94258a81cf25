"""Guidance on maps: who arrives, through corridors, and out of zones.

``python -m benchmarks.map_guidance --part guided`` runs a part and prints its table; the suite
`map-guidance` runs them all. Maps are those of ``$HCBF_DATA`` and the floor plans of the package.
"""

import contextlib
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from scipy import ndimage

from benchmarks.common import Parts, parallel, print_part, quietly, table
from hcbf_gym import _core, scenarios
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.mapped import MappedRegion
from hcbf_gym.errors import InvalidInputError
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

BODY = 0.3  # Radius of the body on the reduced-order model [m]
V_MAX = 1.0
RESTS = 0.05  # Slower than that a robot is at rest [m/s]
STEP = 0.02  # Of the environments [s]
LONGEST = 15_000  # Steps that a path may take
NAV2: dict[str, dict[str, int]] = {"depot": {"depot_keepout.yaml": 2}, "tb3_sandbox": {}}
MODELS = {"rom": "HCBF-Regions-v0", "cart": "hcbf_robots:HCBF-WalkerRegions-v0"}
ROOM = {"rom": BODY, "cart": 0.55}
"""What start and goal keep from edges [m]: where the body and its margins have room."""


def maps() -> dict[str, RankedMap]:
    """Return the maps that are on this machine."""
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
    """Where a body can be on a map, all joined by paths in the open."""

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
    """What became of one path."""

    arrived: bool
    seconds: float  # how long it took
    rested: float  # the longest time at rest [s]
    entered: bool  # whether a strict cell was entered
    out: float = 0.0  # seconds until the zones were left; 0 where it began outside
    length: float = 0.0  # of the field's path out of them [m]


def walk(
    floor: RankedMap,
    model: str,
    start: tuple[float, float],
    goal: tuple[float, float],
    until_out: bool = False,
) -> Walked:
    """Let PD walk under the guided filter, to the goal, or until it has left the zones."""
    scene = Scenario(
        "map", (), PointReference(goal), start=start, task="reach", v_max=V_MAX, map=floor
    )
    made: Any = gym.make(MODELS[model], scenario=scene, max_episode_steps=LONGEST)
    plant = made.unwrapped.plant
    if model == "rom":
        plant = replace(plant, uncertainty=Uncertainty(body=BODY))
    env: Any = quietly(SafetyFilter, made, plant=plant, guidance="geodesic")
    walked = samples(env, PDTracker.for_env(env), seed=0)
    quietly(next, walked)
    zones = np.zeros(floor.grid.shape, dtype=np.bool_)
    for one in floor.classes:
        zones |= one.cells & (one.kind != "speed" and one.rank > 1)
    path = _path_out(floor, zones, start, goal)
    strict = [c.priority == 1 for c in scene.conditions]
    resting = longest = steps = 0
    out = 0.0 if path == 0.0 else np.inf
    entered = arrived = False
    for steps, (_, info, _, _, arrived, _) in enumerate(walked, 1):
        x = env.unwrapped.rom_state
        resting = resting + 1 if not arrived and np.hypot(x[2], x[3]) < RESTS else 0
        longest = max(longest, resting)
        entered |= bool((np.asarray(info["min_h"])[: len(strict)][strict] < 0.0).any())
        column, row = floor.grid.to_cells(x[None, :2])[0].astype(int)
        if not np.isfinite(out) and not zones[row, column]:
            out = STEP * steps
        if STEP * longest > 10.0 or (until_out and np.isfinite(out)):
            break
    env.close()
    return Walked(bool(arrived), STEP * steps, STEP * longest, entered, float(out), path)


def _path_out(
    floor: RankedMap, zones: Mask, start: tuple[float, float], goal: tuple[float, float]
) -> float:
    """Return the length of the field's path from a start to where it leaves the zones [m]."""
    guide = Geodesic()
    guide.reset([floor], goal, None, BODY, start=start)
    geometry, end = guide.geometry[0], guide.goal[0]
    view = fields.grid(guide.field[0], geometry)
    point, length = np.array(start), 0.0
    while zones[_core.field_cell_of(point[0], point[1], geometry)] and length < 100.0:
        after = np.array(_core.field_descent(view, geometry, end, point[0], point[1], geometry[2]))
        length += float(np.linalg.norm(after - point))
        point = after
    return length


SUMMARY = {
    "ways": "{count}",
    "arrive": "{arrived} of {count}",
    "longest stand [s]": "{rested:.2f}",
    "entered rank 1": "{entered}",
}


def _summary(walked: Sequence[Walked]) -> dict[str, Any]:
    """Return what the columns of `SUMMARY` show."""
    return {
        "count": len(walked),
        "arrived": sum(one.arrived for one in walked),
        "rested": max(one.rested for one in walked),
        "entered": sum(one.entered for one in walked),
    }


def guided_part(count: int) -> Table:
    """Walk random paths on every map."""
    rows = []
    for model in MODELS:
        for name, floor in maps().items():
            places, rng = Places(floor, ROOM[model]), np.random.default_rng(1)
            jobs = [(floor, model, places.draw(rng), places.draw(rng)) for _ in range(count)]
            rows.append({"map": name, "model": model} | _summary(parallel(walk, jobs)))
    columns = {"map": "{map}", "model": "{model}"} | SUMMARY
    return table("PD with guidance, random ways", rows, columns)


def corridor(angle: float) -> tuple[RankedMap, Array]:
    """Return a map with a corridor of 1 m through a turned block [rad], and its two mouths [m]."""
    length, side = 8.0, 0.05
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
    rows: list[dict[str, Any]] = []
    for degrees in (0.0, 30.0, 45.0):
        floor, (start, goal) = corridor(np.radians(degrees))
        ends: Any = (start[0], start[1]), (goal[0], goal[1])
        walked = [walk(floor, "rom", *pair) for pair in (ends, ends[::-1])[: min(count, 2)]]
        took = float(np.mean([one.seconds for one in walked]))
        straight = rows[0]["took"] if rows else took
        rows.append({"turn": degrees, "took": took, "share": took / straight} | _summary(walked))
    columns = {"time [s]": "{took:.2f}", "to straight": "{share:.3f}"}
    return table("A corridor of 1 m", rows, {"turned by": "{turn:.0f}°"} | SUMMARY | columns)


def keepout_part(count: int) -> Table:
    """Begin inside zones of lower ranks, strict pieces in between or not."""
    rows = []
    for name, floor in maps().items():
        places, inside = Places(floor, BODY), np.zeros(floor.grid.shape, dtype=np.bool_)
        regions = tuple(one for one in regions_of(floor) if one.priority == 1)
        strict = MapGround(regions, BODY + 0.1, 0)
        for one in floor.classes:
            inside |= one.cells & (one.kind != "speed" and one.rank > 1)
        inside &= strict.ground.rank[1:-1, 1:-1] == 0
        cells, rng, jobs = np.argwhere(inside), np.random.default_rng(2), []
        while len(jobs) < count and len(cells):
            j, i = cells[rng.integers(len(cells))]
            start, goal = fields.to_world(float(j), float(i), strict.geometry), places.draw(rng)
            with contextlib.suppress(InvalidInputError):  # closed in by walls
                Geodesic().reset([floor], goal, None, BODY, start=start)
                jobs.append((floor, "rom", start, goal, True))
        if not jobs:
            continue
        walked = parallel(walk, jobs)
        late = [one.out - one.length / Pull().speed for one in walked]
        rows.append(
            {
                "map": name,
                "out": sum(np.isfinite(one.out) for one in walked),
                "in_time": sum(one <= 3.0 for one in late),
                "median": np.median([one.out for one in walked]),
                "latest": max(late),
            }
            | _summary(walked)
        )
    return table(
        "Out of a zone",
        rows,
        {
            "map": "{map}", "starts": "{count}", "out": "{out}",
            "within 3 s + way / 0.4 m/s": "{in_time}",
            "time / most over way [s]": "{median:.1f} / {latest:.1f}",
            "longest stand [s]": "{rested:.2f}", "entered rank 1": "{entered}",
        },
    )  # fmt: skip


PARTS: Parts = {  # paths, directions and starts, of each map
    "guided": (guided_part, 100, 2),
    "corridors": (corridors_part, 2, 2),
    "keepout": (keepout_part, 100, 2),
}

if __name__ == "__main__":
    print_part(PARTS)
