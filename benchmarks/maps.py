"""Maps: exactness of their cover, hostile episodes, speed zones and walkers.

``python -m benchmarks.maps --part hostile --count 200`` runs a part and prints its table; the suite
`maps` runs them all. Entries are judged by the exact squares, at every step of the physics.
"""

import os
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from benchmarks.common import Parts, parallel, print_part, table
from benchmarks.judges import squares
from benchmarks.map_guidance import maps
from hcbf_gym import _core
from hcbf_gym.arrays import Integers, Mask
from hcbf_gym.envs.task import PHYSICS_DT, SUBSTEPS
from hcbf_gym.evaluation import attacks
from hcbf_gym.evaluation.attacked import AttackedEpisode, policy_of
from hcbf_gym.evaluation.episode import samples
from hcbf_gym.evaluation.statistics import BOUNDED, counted
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.programs import FilterStatus
from hcbf_gym.scenarios import Scenario
from hcbf_gym.scenarios.references import PointReference
from hcbf_gym.wrappers import SafetyFilter
from hcbf_robots.maps import Grid, MapClass, RankedMap

BODY = 0.3  # Radius of the body on the reduced-order model [m]
V_MAX = 1.5
STEPS = 400  # Control steps of a hostile episode
RECENT = 50  # So many steps after a class has paid its cells may be entered: the robot coasts on
NEAR = 1.0  # Within which the cover's shortfall counts [m]
FAR = 10.0  # Within which one point in a hundred is judged, too: the cover exceeds nowhere [m]
FIRST_SEED = 24_000_000
TURNS = (0.0, 0.6)  # Yaws of a map's origin at which its cover is judged [rad]
GO1 = "tests/robots/contracts/go1.json"
WALKER = "hcbf_robots:HCBF-WalkerRegions-v0"
WALKERS: dict[str, tuple[str, dict[str, Any], float, float]] = {
    "a1": ("HCBF-A1Regions-v0", {"body": "footprint"}, 0.9, V_MAX),
    "cart": (WALKER, {"robot": "cart"}, 0.6, 1.2),
    "go1": (WALKER, {"robot": GO1}, 0.8, V_MAX),
}
"""name → environment, its arguments, how far a start is from edges [m], cap on the speed [m/s]."""


class Hostile(NamedTuple):
    """What one hostile episode showed."""

    least: float  # distance of the robot's point from the exact squares [m], less its body
    fastest: float  # the most by which the limit of a zone was passed [m/s]
    crossed: int  # how often a keepout of a lower rank was entered
    unpaid: int  # how often no report before that had a slack of it
    status: Integers  # (7,) steps with each status


def strict_cells(floor: RankedMap) -> Mask:
    """Return (rows, columns) the cells that no robot may enter."""
    return np.logical_or.reduce([one.cells for one in floor.classes if one.is_strict])


def start_on(floor: RankedMap, clear: float, rng: np.random.Generator) -> tuple[float, float]:
    """Return a place that is `clear` of every strict cell of a map and of its edge [m]."""
    rows, columns = floor.grid.shape
    edge = clear / floor.grid.resolution
    for _ in range(10_000):
        at = floor.grid.to_world(rng.uniform([edge, edge], [[columns - edge, rows - edge]]))
        if clear < floor.distance(at, 1)[0] < 3.0:
            return float(at[0, 0]), float(at[0, 1])
    raise RuntimeError(f"no place on the map that is {clear} m from every strict cell")


def scene_on(floor: RankedMap, start: tuple[float, float], v_max: float = V_MAX) -> Scenario:
    """Return a scene without a task but to withstand."""
    goal = PointReference((start[0] + 1e3, start[1]))
    return Scenario("map", (), goal, start=start, task="reach", v_max=v_max, map=floor)


def exact(count: int) -> Table:
    """Judge the covered distance at `count` random points of each map."""
    rows = []
    for name, floor in maps().items():
        for yaw in TURNS:
            grid = Grid(floor.grid.resolution, (*floor.grid.origin[:2], yaw), floor.grid.shape)
            ranked, rng = RankedMap(grid, floor.classes), np.random.default_rng(FIRST_SEED)
            cells, (height, width) = strict_cells(ranked), grid.shape
            worst, short = -np.inf, []
            for _ in range(max(1, count // 100_000)):
                at = rng.uniform([-20.0, -20.0], [width + 20.0, height + 20.0], (100_000, 2))
                points = grid.to_world(at)
                true = squares.distances(grid, cells, points, NEAR)
                covered = ranked.distance(points, 1)
                near, few = true < NEAR, slice(0, 1000)
                true_far = squares.distances(grid, cells, points[few], FAR)
                further = (covered[few] - true_far)[true_far < FAR]
                over = np.concatenate(((covered - true)[near], further))
                worst = max(worst, float(over.max(initial=-np.inf)))
                short.append((true - np.maximum(covered, 0.0))[near])
            strict = [b for b in ranked.conditions if b.priority == 1 and b.reads_position]
            rows.append(
                {"map": name, "yaw": yaw, "pieces": sum(len(b.pieces) for b in strict)}
                | {"worst": worst, "gap": np.quantile(np.concatenate(short), 0.95)}
                | {"side": grid.resolution}
            )
    return table(
        f"covered distance at {count} points a map",
        rows,
        {
            "map": "{map}", "yaw [rad]": "{yaw:.1f}", "pieces": "{pieces}",
            "exceeds by [m]": "{worst:+.1e}",
            "95 % short by [cells]": lambda r: f"{r['gap'] / r['side']:.2f}",
        },
    )  # fmt: skip


def attack(floor: RankedMap, number: int, body: float) -> Hostile:
    """Run a hostile episode of a body [m] on the reduced-order model; attacks take turns."""
    rng = np.random.default_rng(FIRST_SEED + number)
    scene = scene_on(floor, start_on(floor, body + 0.05, rng))
    made: Any = gym.make("HCBF-Regions-v0", scenario=scene, max_episode_steps=STEPS)
    env = SafetyFilter(made, margin=body)
    walk = samples(env, policy_of(attack_of(number), env, number), number)
    next(walk)
    inner = made.unwrapped
    path, pays, status = [], [], np.zeros(7, dtype=np.int64)
    start_of = inner.rom_state
    for _, info, *_ in walk:
        state, start_of = start_of, inner.rom_state
        for _ in range(SUBSTEPS):
            u = info["safety_filter"]["u_safe"]
            state = np.array(_core.double_integrator_step(state, u, PHYSICS_DT, V_MAX))
            path.append(state)
        status[int(info["safety_filter"]["status"])] += 1
        pays.append(info["safety_filter"]["slack"] > 0.0)
    passed, paid = np.array(path), np.array(pays)
    env.close()
    over, crossed, unpaid = -np.inf, 0, 0
    for k, one in enumerate(floor.classes):
        if one.kind == "speed":
            at = np.floor(floor.grid.to_cells(passed[:, :2])).astype(np.int64)
            inside = np.all((at >= 0) & (at < floor.grid.shape[::-1]), axis=1)
            inside[inside] = one.cells[at[inside, 1], at[inside, 0]]
            speed = np.hypot(passed[inside, 2], passed[inside, 3])
            over = max(over, float((speed - (one.limit or 0.0)).max(initial=-np.inf)))
        elif one.rank > 1:
            away = squares.distances(floor.grid, one.cells, passed[:, :2], NEAR)
            within = away.reshape(-1, SUBSTEPS).min(axis=1) < body
            entries = 1 + np.flatnonzero(within[1:] & ~within[:-1])
            crossed += len(entries)
            unpaid += sum(not paid[max(0, t - RECENT) : t + 1, k].any() for t in entries)
    least = squares.distances(floor.grid, strict_cells(floor), passed[:, :2], NEAR).min()
    return Hostile(float(least) - body, over, crossed, unpaid, status)


def attack_of(number: int) -> str:
    """Return the attack of an episode."""
    return tuple(attacks.ATTACKS)[number % len(attacks.ATTACKS)]


def hostile(count: int) -> Table:
    """Attack the reduced-order model with a body on every map."""
    return _attacked(maps(), count, "hostile episodes, a body of .3 m")


def zones(count: int) -> Table:
    """Attack it where speed zones are strict."""
    strict: dict[str, RankedMap] = {}
    for name, floor in maps().items():
        rng = np.random.default_rng(len(name))
        zone = np.zeros(floor.grid.shape, dtype=np.bool_)
        for _ in range(12):
            r, c = (int(rng.integers(n)) for n in zone.shape)
            zone[r : r + 40, c : c + 60] = True
        others = tuple(one for one in floor.classes if one.kind != "speed")
        slow = MapClass("slow", 1, "speed", zone, limit=0.5)
        strict[name] = RankedMap(floor.grid, (*others, slow))
    return _attacked(strict, count, "hostile episodes with strict speed zones of .5 m/s")


def _attacked(floors: dict[str, RankedMap], count: int, title: str) -> Table:
    rows = []
    for name, floor in floors.items():
        seen: list[Hostile] = parallel(attack, ((floor, k, BODY) for k in range(count)))
        status, over = np.sum([one.status for one in seen], axis=0), max(s.fastest for s in seen)
        bad = [s for s in FilterStatus if s >= FilterStatus.VIOLATED and status[s]]
        rows.append({
            "map": name, "count": count, "least": min(one.least for one in seen),
            "entered": counted(sum(one.least < 0.0 for one in seen), count),
            "over": f"{over:+.3f}" if np.isfinite(over) else "",
            "crossed": sum(one.crossed for one in seen), "unpaid": sum(one.unpaid for one in seen),
            "steps": ", ".join(f"{s.name} {status[s]}" for s in bad),
        })  # fmt: skip
    return table(
        title,
        rows,
        {
            "map": "{map}", "episodes": "{count}", f"entered ({BOUNDED})": "{entered}",
            "least [m]": "{least:+.4f}", "over a limit [m/s]": "{over}",
            "lower ranks entered": "{crossed}", "of these unpaid": "{unpaid}", "steps": "{steps}",
        },
    )  # fmt: skip


def walk(robot: str, floor: RankedMap, number: int) -> tuple[float, float]:
    """Attack a walker; return the least distance of it and of its body from strict cells [m]."""
    env_id, options, clear, v_max = WALKERS[robot]
    rng = np.random.default_rng(FIRST_SEED + number)
    scene = scene_on(floor, start_on(floor, clear, rng), v_max)
    options = options | {"max_episode_steps": STEPS}
    seen = AttackedEpisode(attack_of(number), scene, number, env_id, options).run()
    return seen.least_h, seen.least_body_h


def walkers(count: int) -> Table:
    """Attack A1, cart and Go1 on the densest map; a covered distance above 0 is an exact one.

    The Go1 is left out where its files are not: they are in ``$HCBF_DATA``.
    """
    name, floor = max(maps().items(), key=lambda item: len(item[1].conditions[0].pieces))
    rows = []
    for robot in WALKERS if os.environ.get("HCBF_DATA") else ("a1", "cart"):
        least, body = np.array(parallel(walk, ((robot, floor, k) for k in range(count)))).T
        entered = counted(int((np.minimum(least, body) < 0.0).sum()), count)
        rows.append({
            "robot": robot, "map": name, "count": count, "entered": entered, "least": least.min(),
            "body": f"{body.min():+.3f}" if np.isfinite(body.min()) else "",
        })  # fmt: skip
    columns = {
        "robot": "{robot}", "map": "{map}", "episodes": "{count}",
        f"entered ({BOUNDED})": "{entered}", "least [m]": "{least:+.3f}", "body [m]": "{body}",
    }  # fmt: skip
    return table("walkers on a map", rows, columns)


PARTS: Parts = {
    "exact": (exact, 1_000_000, 100_000),
    "hostile": (hostile, 2_000, 8),
    "zones": (zones, 100, 4),
    "walkers": (walkers, 200, 1),
}

if __name__ == "__main__":
    print_part(PARTS)
