"""Maps: exactness of their cover, hostile episodes, speed zones, scans, walkers, and costs.

``python -m benchmarks.maps --part hostile --count 200`` runs a part and prints its table; the suite
`maps` runs them all. Entries are judged by the exact squares, at every step of the physics.
"""

import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import joblib
import numpy as np
import tyro
from rich.console import Console

from benchmarks.judges import squares
from benchmarks.map_guidance import maps
from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.envs.task import PHYSICS_DT, SUBSTEPS
from hcbf_gym.errors import choose
from hcbf_gym.evaluation import attacks
from hcbf_gym.evaluation.attacked import policy_of
from hcbf_gym.evaluation.episode import samples
from hcbf_gym.evaluation.statistics import BOUNDED, counted
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.programs import FilterStatus
from hcbf_gym.scenarios import Scenario
from hcbf_gym.scenarios.references import PointReference
from hcbf_gym.wrappers import SafetyFilter, VectorSafetyFilter
from hcbf_robots.maps import Grid, MapClass, RankedMap, Scan, points_of
from hcbf_robots.maps.cover import Cover

BODY = 0.3
"""Radius of the body on the reduced-order model [m]."""
V_MAX = 1.5
STEPS = 400
"""Control steps of a hostile episode."""
RECENT = 50
"""So many steps after a class has paid its cells may be entered: the robot coasts on."""
NEAR = 1.0
"""Within which the cover's shortfall counts [m]."""
FAR = 10.0
"""Within which one point in a hundred is judged, too: the cover exceeds nowhere [m]."""
FIRST_SEED = 24_000_000
TURNS = (0.0, 0.6)
"""Yaws of a map's origin at which its cover is judged [rad]."""
WALKERS: dict[str, tuple[str, dict[str, Any], float, float]] = {
    "a1": ("HCBF-A1Regions-v0", {"body": "footprint"}, 0.9, V_MAX),
    "cart": ("HCBF-WalkerRegions-v0", {"robot": "cart"}, 0.6, 1.2),
    "go1": ("HCBF-WalkerRegions-v0", {"robot": "tests/robots/contracts/go1.json"}, 0.8, V_MAX),
}
"""name → environment, its arguments, how far a start is from edges [m], cap on the speed [m/s]."""
BEAMS, RANGE, LATENCY, LOST = 360, 6.0, 0.1, 0.1
"""Of the range sensor: beams, range [m], age of a scan [s], and share of scans that are lost."""


class Hostile(NamedTuple):
    """What one hostile episode showed.

    Attributes:
        least: distance of the robot's point from the exact squares [m], less its body.
        fastest: the most by which the limit of a zone was passed [m/s].
        crossed: how often a keepout of a lower rank was entered.
        unpaid: how often of these no report had said that it pays.
        status: (7,) steps with each status.
    """

    least: float
    fastest: float
    crossed: int
    unpaid: int
    status: Integers


def strict_cells(floor: RankedMap) -> Mask:
    """Return (rows, columns) the cells that no robot may enter."""
    return np.logical_or.reduce([one.cells for one in floor.classes if one.is_strict])


def start_on(floor: RankedMap, clear: float, rng: np.random.Generator) -> tuple[float, float]:
    """Return a place that keeps `clear` from every strict cell of a map and from its edge [m]."""
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


def turned(floor: RankedMap, yaw: float) -> RankedMap:
    """Return a map with another yaw of its origin [rad]."""
    x, y, _ = floor.grid.origin
    grid = Grid(floor.grid.resolution, (x, y, yaw), floor.grid.shape)
    return RankedMap(grid, floor.classes)


def exact(count: int) -> Table:
    """Judge the covered distance at `count` random points of each map."""
    rows = []
    for name, floor in maps().items():
        for yaw in TURNS:
            ranked, rng = turned(floor, yaw), np.random.default_rng(FIRST_SEED)
            cells, (height, width) = strict_cells(ranked), ranked.grid.shape
            worst, short = -np.inf, []
            for _ in range(max(1, count // 100_000)):
                at = rng.uniform([-20.0, -20.0], [width + 20.0, height + 20.0], (100_000, 2))
                points = ranked.grid.to_world(at)
                true = squares.distances(ranked.grid, cells, points, NEAR)
                covered = ranked.distance(points, 1)
                near = true < NEAR
                worst = max(worst, float((covered - true)[near].max(initial=-np.inf)))
                few = slice(0, 1000)
                true_far = squares.distances(ranked.grid, cells, points[few], FAR)
                further = (covered[few] - true_far)[true_far < FAR]
                worst = max(worst, float(further.max(initial=-np.inf)))
                short.append((true - np.maximum(covered, 0.0))[near])
            gap = np.quantile(np.concatenate(short), 0.95) / ranked.grid.resolution
            pieces = sum(
                len(b.pieces) for b in ranked.conditions if b.priority == 1 and b.reads_position
            )
            rows.append([name, f"{yaw:.1f}", str(pieces), f"{worst:+.1e}", f"{gap:.2f}"])
    header = ("map", "yaw [rad]", "pieces", "exceeds by [m]", "95 % short by [cells]")
    return Table(f"covered distance at {count} points a map", header, rows)


def attack(floor: RankedMap, number: int, body: float) -> Hostile:
    """Run a hostile episode on the reduced-order model, judged by the exact squares.

    Args:
        floor: the map.
        number: of the episode; attacks take turns.
        body: radius of the robot [m].
    """
    rng = np.random.default_rng(FIRST_SEED + number)
    name = tuple(attacks.ATTACKS)[number % len(attacks.ATTACKS)]
    start = start_on(floor, body + 0.05, rng)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made: Any = gym.make(
            "HCBF-Regions-v0", scenario=scene_on(floor, start), max_episode_steps=STEPS
        )
        env = SafetyFilter(made, margin=body)
        walk = samples(env, policy_of(name, env, number), number)
        next(walk)
    inner = made.unwrapped
    cells, way, pays = strict_cells(floor), [], []
    status = np.zeros(7, dtype=np.int64)
    zones = [one for one in floor.classes if one.kind == "speed"]
    over, start_of = -np.inf, inner.rom_state
    for _, info, *_ in walk:
        state, start_of = start_of, inner.rom_state
        u = info["safety_filter"]["u_safe"]
        for _ in range(SUBSTEPS):
            state = np.array(_core.double_integrator_step(state, u, PHYSICS_DT, V_MAX))
            way.append(state)
        status[int(info["safety_filter"]["status"])] += 1
        pays.append(info["safety_filter"]["slack"] > 0.0)
    passed, paid = np.array(way), np.array(pays)
    env.close()
    for zone in zones:
        at = np.floor(floor.grid.to_cells(passed[:, :2])).astype(np.int64)
        inside = np.all((at >= 0) & (at < floor.grid.shape[::-1]), axis=1)
        inside[inside] = zone.cells[at[inside, 1], at[inside, 0]]
        speed = np.hypot(passed[inside, 2], passed[inside, 3])
        over = max(over, float((speed - (zone.limit or 0.0)).max(initial=-np.inf)))
    least = squares.distances(floor.grid, cells, passed[:, :2], NEAR).min()
    crossed = unpaid = 0
    for k, one in enumerate(floor.classes):
        if one.rank > 1 and one.kind != "speed":
            away = squares.distances(floor.grid, one.cells, passed[:, :2], NEAR)
            entries = entered_at(away.reshape(-1, SUBSTEPS).min(axis=1) < body)
            crossed += len(entries)
            unpaid += sum(not paid[max(0, t - RECENT) : t + 1, k].any() for t in entries)
    return Hostile(float(least) - body, over, crossed, unpaid, status)


def entered_at(inside: Mask) -> Integers:
    """Return the steps at which a place is entered, of (n,) whether a step is inside."""
    return 1 + np.flatnonzero(inside[1:] & ~inside[:-1])


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
        slow = MapClass("slow", 1, "speed", zone, limit=0.5)
        others = tuple(one for one in floor.classes if one.kind != "speed")
        strict[name] = RankedMap(floor.grid, (*others, slow))
    return _attacked(strict, count, "hostile episodes with strict speed zones of .5 m/s")


def _attacked(floors: dict[str, RankedMap], count: int, title: str) -> Table:
    rows = []
    for name, floor in floors.items():
        job = joblib.delayed(attack)
        found: Any = joblib.Parallel(n_jobs=-1)(job(floor, k, BODY) for k in range(count))
        seen: list[Hostile] = list(found)
        entered = sum(one.least < 0.0 for one in seen)
        status = np.sum([one.status for one in seen], axis=0)
        worse = [s for s in FilterStatus if s >= FilterStatus.VIOLATED and status[s]]
        bad = [f"{s.name} {status[s]}" for s in worse]
        over = max(one.fastest for one in seen)
        rows.append([
            name, str(count), counted(entered, count), f"{min(one.least for one in seen):+.4f}",
            f"{over:+.3f}" if np.isfinite(over) else "", str(sum(one.crossed for one in seen)),
            str(sum(one.unpaid for one in seen)), ", ".join(bad),
        ])  # fmt: skip
    header = (
        "map", "episodes", f"entered ({BOUNDED})", "least [m]", "over a limit [m/s]",
        "lower ranks entered", "of these unpaid", "steps",
    )  # fmt: skip
    return Table(title, header, rows)


def walk(robot: str, floor: RankedMap, number: int) -> tuple[float, float]:
    """Attack a walker; return its least distance from strict cells [m], the body's if it has one.

    Args:
        robot: a name of `WALKERS`.
        floor: the map.
        number: of the episode.
    """
    env_id, options, clear, v_max = WALKERS[robot]
    rng = np.random.default_rng(FIRST_SEED + number)
    scene = scene_on(floor, start_on(floor, clear, rng), v_max)
    name = tuple(attacks.ATTACKS)[number % len(attacks.ATTACKS)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env = SafetyFilter(gym.make(env_id, scenario=scene, max_episode_steps=STEPS, **options))
        walked = samples(env, policy_of(name, env, number), number)
        next(walked)
        strict = [one.rank == 1 and one.kind != "speed" for one in floor.classes]
        least = body = np.inf
        for _, info, *_ in walked:
            count = len(strict)
            least = min(least, info["min_h"][:count][strict].min())
            if "min_body_h" in info:
                body = min(body, info["min_body_h"][:count][strict].min())
        env.close()
    return float(least), float(body)


def walkers(count: int) -> Table:
    """Attack A1, cart and Go1 on the densest map; a covered distance above 0 is an exact one."""
    name, floor = max(maps().items(), key=lambda item: len(item[1].conditions[0].pieces))
    rows = []
    for robot in WALKERS:
        job = joblib.delayed(walk)
        found: Any = joblib.Parallel(n_jobs=-1)(job(robot, floor, k) for k in range(count))
        least, body = np.array(list(found)).T
        entered = int((np.minimum(least, body) < 0.0).sum())
        body_least = f"{body.min():+.3f}" if np.isfinite(body.min()) else ""
        rows.append([
            robot, name, str(count), counted(entered, count), f"{least.min():+.3f}", body_least,
        ])  # fmt: skip
    header = ("robot", "map", "episodes", f"entered ({BOUNDED})", "least [m]", "body [m]")
    return Table("walkers on a map", header, rows)


class Sensor:
    """A range sensor on a robot, late by `LATENCY`, of which a share of scans is lost.

    Args:
        boxes: what it sees: (k, 3) centre and radius of discs [m].
        rng: decides which scans are lost.
    """

    def __init__(self, boxes: Array, rng: np.random.Generator):
        self._boxes, self._rng = boxes, rng
        self._taken: list[tuple[float, Scan]] = []
        self._next = 0.0

    def at(self, time: float, x: Array) -> Scan:
        """Return the newest scan that has come through at a time [s]."""
        if time >= self._next - 1e-9:
            self._next += 0.1
            if self._rng.random() >= LOST or not self._taken:
                self._taken.append((time, self._look(x)))
        come = [one for one in self._taken if one[0] <= time - LATENCY + 1e-9] or self._taken[:1]
        self._taken = self._taken[-4:]
        return come[-1][1]

    def _look(self, x: Array) -> Scan:
        angles = np.linspace(-np.pi, np.pi, BEAMS, endpoint=False)
        beams = np.column_stack([np.cos(angles), np.sin(angles)])
        to = self._boxes[:, :2] - x[:2]
        along = beams @ to.T
        across2 = (to**2).sum(axis=1) - along**2
        half2 = self._boxes[:, 2] ** 2 - across2
        hit = (half2 > 0.0) & (along > 0.0)
        reach = np.where(hit, along - np.sqrt(np.maximum(half2, 0.0)), np.inf).min(axis=1)
        ranges = np.where(reach < RANGE, reach, np.inf)
        return Scan("laser", points_of(ranges, angles), (float(x[0]), float(x[1]), 0.0))


def seen_only(robot: str, number: int) -> float:
    """Attack a walker among discs that are in no map; return its least distance from them [m].

    Args:
        robot: a name of `WALKERS`.
        number: of the episode.
    """
    env_id, options, clear, v_max = WALKERS[robot]
    rng = np.random.default_rng(FIRST_SEED + number)
    discs = np.column_stack([rng.uniform(-3.0, 3.0, (8, 2)), rng.uniform(0.15, 0.5, 8)])
    gap = np.hypot(discs[:, 0], discs[:, 1]) - discs[:, 2]
    discs = discs[gap > clear + 0.2]
    floor = RankedMap(
        Grid(0.1, (-8.0, -8.0, 0.0), (160, 160)),
        (MapClass("walls", 1, "keepout", _frame(160)),),
    )
    wanted = tuple(attacks.ATTACKS)[number % len(attacks.ATTACKS)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = scene_on(floor, (0.0, 0.0), v_max)
        made: Any = gym.make(env_id, scenario=scene, max_episode_steps=STEPS, **options)
        inner, sensor = made.unwrapped, Sensor(discs, rng)
        own = inner.plant

        def barriers(env: Any, observation: Any, info: Any) -> Sequence[Any]:
            return (*inner.barriers, sensor.at(float(inner.time), inner.truth))

        env = SafetyFilter(made, plant=_with(own, barriers))
        attack, least = attacks.make(wanted, number), np.inf

        def act(observation: Any, info: Any) -> Any:
            at = inner.truth
            away = at[:2] - discs[:, :2]
            far = np.linalg.norm(away, axis=1)
            order = np.argsort(far - discs[:, 2])
            seen = attacks.Surroundings(
                at[:2], at[2:], (far - discs[:, 2])[order], (away / far[:, None])[order],
                float(inner.time),
            )  # fmt: skip
            return attack.act(seen)

        for sample in samples(env, act, number):
            if sample.action is None:
                continue
            here = np.linalg.norm(inner.truth[:2] - discs[:, :2], axis=1) - discs[:, 2]
            least = min(least, float(here.min(initial=np.inf)))
        env.close()
    return least


def _with(plant: Any, barriers: Any) -> Any:
    """Return a plant with another reader of its barriers."""
    fields = {name: value for name, value in vars(plant).items() if name != "barriers"}
    return type(plant)(barriers=barriers, **fields)


def _frame(side: int) -> Mask:
    """Return (side, side) cells, true along the edges."""
    cells = np.zeros((side, side), dtype=np.bool_)
    cells[[0, -1]], cells[:, [0, -1]] = True, True
    return cells


def scans(count: int) -> Table:
    """Attack cart and Go1 among obstacles that only a late and lossy scan shows."""
    rows = []
    for robot in ("cart", "go1"):
        job = joblib.delayed(seen_only)
        found: Any = joblib.Parallel(n_jobs=-1)(job(robot, k) for k in range(count))
        least = np.array(list(found))
        entered = int((least < 0.0).sum())
        rows.append([robot, str(count), counted(entered, count), f"{least.min():+.3f}"])
    header = ("robot", "episodes", f"entered ({BOUNDED})", "least [m]")
    return Table("obstacles in no map, scans at 10 Hz, 100 ms late, one in ten lost", header, rows)


def costs(count: int) -> Table:
    """Time covers, changes, steps and batches; best of several where it is one number."""
    rows = []
    for name, floor in maps().items():
        cells = strict_cells(floor)
        cover = Cover.of(cells)
        window = (0, 0, min(200, cells.shape[0]), min(200, cells.shape[1]))
        rng = np.random.default_rng(0)
        other = cells.copy()
        other[: window[2], : window[3]] ^= rng.random((window[2], window[3])) < 1e-3
        whole = min(_timed(lambda cells=cells: Cover.of(cells)) for _ in range(5))
        part = min(
            _timed(lambda c=cover, o=other, w=window: c.after(o, w))  # type: ignore[misc]
            for _ in range(5)
        )
        added = _step_cost(floor, count)
        rows.append([
            name, str(len(cover.sizes)), f"{1e3 * whole:.1f}", f"{1e3 * part:.1f}",
            f"{np.median(added):.1f}", f"{np.quantile(added, 0.99):.1f}",
        ])  # fmt: skip
    rows.append(["random-map, batch of 1,024", f"{_batch_rate():.0f} steps/s", "", "", "", ""])
    header = ("map", "pieces", "cover [ms]", "window [ms]", "filter, median [µs]", "99 % [µs]")
    return Table("what maps cost", header, rows)


def _timed(call: Callable[[], Any]) -> float:
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def _step_cost(floor: RankedMap, count: int) -> Array:
    """Return (k,) what the filter takes of a step on a map [µs]."""
    rng = np.random.default_rng(0)
    scene = scene_on(floor, start_on(floor, BODY + 0.05, rng))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made: Any = gym.make("HCBF-Regions-v0", scenario=scene, max_episode_steps=10**9)
        env: Any = SafetyFilter(made, margin=BODY)
        env.reset(seed=0)
    edge, taken, inner = attacks.make("edge", 0), [], 0.0
    step = env.env.step

    def timed(u: Array) -> Any:
        nonlocal inner
        begin = time.perf_counter()
        found = step(u)
        inner = time.perf_counter() - begin
        return found

    env.env.step = timed
    for k in range(count):
        if k % 200 == 0:
            env.reset(options={"start": start_on(floor, BODY + 0.05, rng)})
        wanted = edge.act(attacks.observe(env))
        begin = time.perf_counter()
        env.step(wanted)
        taken.append(1e6 * (time.perf_counter() - begin - inner))
    return np.array(taken)


def _batch_rate(number: int = 1024, steps: int = 200) -> float:
    """Return the environment steps per second of a filtered native batch on random maps."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made: Any = gym.make_vec("HCBF-Regions-v0", num_envs=number, scenario="random-map")
        env = VectorSafetyFilter(made)
        env.reset(seed=0)
    rng = np.random.default_rng(0)
    u = rng.uniform(-5.0, 5.0, (steps, number, 2)).astype(np.float32)
    env.step(u[0])
    best = np.inf
    for first in range(0, steps, 50):
        begin = time.perf_counter()
        for k in range(first, first + 50):
            env.step(u[k])
        best = min(best, time.perf_counter() - begin)
    return 50 * number / best


PARTS: dict[str, tuple[Callable[[int], Table], int, int]] = {
    "exact": (exact, 1_000_000, 100_000),
    "hostile": (hostile, 2_000, 8),
    "zones": (zones, 100, 4),
    "walkers": (walkers, 200, 1),
    "scans": (scans, 100, 2),
    "costs": (costs, 5_000, 200),
}
"""part → what makes its table, and the count of a full and of a quick run."""


def run(quick: bool) -> dict[str, Any]:
    """Return the tables of every part: cells of text."""
    made = {name: make(few if quick else many) for name, (make, many, few) in PARTS.items()}
    return {name: one._asdict() for name, one in made.items()}


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the tables of the figures by the names of the parts."""
    return {name: Table(**one) for name, one in figures.items()}


def main(part: str, count: int | None = None) -> None:
    """Run a part and print its table.

    Args:
        part: a name of `PARTS`.
        count: points, episodes a map, or steps; None is that of a full run.
    """
    make, many, _ = choose("part", part, PARTS)
    Console().print(make(many if count is None else count).rich())


if __name__ == "__main__":
    tyro.cli(main)
