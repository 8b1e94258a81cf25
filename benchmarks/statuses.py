"""How often each status is said, on every plant, and what entries no status announced.

``python -m benchmarks.statuses --plants rom cart --episodes 60`` prints a table; an entry counts as
announced where a step at or before it was VIOLATED, UNSAFE or BACKUP.
"""

import functools
import json
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from hcbf_gym import wrappers
from hcbf_gym.evaluation import attacks
from hcbf_gym.evaluation.attacked import policy_of
from hcbf_gym.evaluation.episode import samples
from hcbf_gym.evaluation.jobs import Runs
from hcbf_gym.programs import FilterStatus

FIRST_SEED = 31_000_000
HOSTILE = ("nearest", "corner", "edge", "slam", "bang-bang")
"""Policies of hostile episodes, in turn."""
ANNOUNCED = FilterStatus.VIOLATED


class Case(NamedTuple):
    """A plant and a family of scenes.

    Attributes:
        env: the environment's id.
        options: of the environment.
        scenario: a family of random scenes.
    """

    env: str
    options: dict[str, Any]
    scenario: str


def cases(contracts: Path) -> dict[str, Case]:
    """Return the plants by name.

    Args:
        contracts: the folder of learned walkers' contracts.
    """
    walker, a1 = "HCBF-WalkerRegions-v0", "HCBF-A1Regions-v0"
    go1, humanoid = str(contracts / "go1.json"), str(contracts / "berkeley_humanoid.json")
    return {
        "rom": Case("HCBF-Regions-v0", {}, "random"),
        "rom-moving": Case("HCBF-Regions-v0", {}, "random-moving"),
        "rom-map": Case("HCBF-Regions-v0", {}, "random-map"),
        "cart": Case(walker, {"robot": "cart"}, "random"),
        "cart-moving": Case(walker, {"robot": "cart"}, "random-moving"),
        "holonomic": Case(walker, {"robot": "holonomic-cart"}, "random"),
        "go1": Case(walker, {"robot": go1}, "random"),
        "go1-moving": Case(walker, {"robot": go1}, "random-moving"),
        "humanoid": Case(walker, {"robot": humanoid}, "random"),
        "a1": Case(a1, {}, "random"),
        "a1-moving": Case(a1, {}, "random-moving"),
        "a1-body": Case(a1, {"body": "footprint"}, "random-wide"),
    }


@dataclass(frozen=True)
class Episode:
    """One episode.

    Args:
        plant: name of a case.
        policy: an attack's or a policy's name.
        seed: of environment and attack.
        contracts: the folder of learned walkers' contracts.
    """

    plant: str
    policy: str
    seed: int
    contracts: str


class Count(NamedTuple):
    """What one episode showed.

    Attributes:
        statuses: steps by `FilterStatus`.
        calm: steps by status up to the first entry.
        entered: whether rank 1 was entered.
        announced: whether a status said so at or before it.
        fell: whether the robot fell.
        reached: whether it reached its goal.
        unproved: steps that were not proved, without an alarm of a status.
    """

    statuses: list[int]
    calm: list[int]
    entered: bool
    announced: bool
    fell: bool
    reached: bool
    unproved: int


def run(episode: Episode) -> Count:
    """Run an episode, and count."""
    warnings.simplefilter("ignore")
    case = cases(Path(episode.contracts))[episode.plant]
    env: Any = gym.make(case.env, scenario=case.scenario, **case.options)
    env = wrappers.SafetyFilter(env)
    walk = samples(env, policy_of(episode.policy, env, episode.seed), episode.seed)
    info = next(walk).info
    strict = [
        k for k, b in enumerate(env.unwrapped.barriers) if b.priority == 1 and b.reads_position
    ]
    told = "min_body_h" if "min_body_h" in info else "min_h"
    statuses, calm = np.zeros((2, len(FilterStatus)), dtype=np.int64)
    entered = bool(np.min(info[told][strict]) < 0.0)
    announced, unproved = entered, 0
    for _, info, *_ in walk:
        report = info["safety_filter"]
        status = int(report["status"])
        statuses[status] += 1
        unproved += status < ANNOUNCED and not report.get("proved", 1)
        calm[status] += not entered
        announced |= not entered and status >= ANNOUNCED
        entered |= bool(np.min(info[told][strict]) < 0.0)
    fell = bool(info.get("fallen", 0.0))
    env.close()
    return Count(
        statuses.tolist(), calm.tolist(), entered, announced, fell, bool(info["is_success"]),
        int(unproved),
    )  # fmt: skip


@dataclass(frozen=True)
class Args:
    """Count statuses on plants.

    Attributes:
        plants: names of plants; all unless given.
        episodes: of each plant and kind of policy.
        policies: "hostile" takes the attacks in turn; else a policy's name.
        first_seed: of the episodes.
        contracts: the folder of learned walkers' contracts.
        output: a JSON file of the counts; none unless given.
        workers: episodes at once.
    """

    plants: tuple[str, ...] = ()
    episodes: int = 60
    policies: tuple[str, ...] = ("hostile", "pd")
    first_seed: int = FIRST_SEED
    contracts: Path = Path("tests/robots/contracts")
    output: Path | None = None
    workers: int | None = None


def main(args: Args) -> None:
    """Print a table, a line a plant and kind of policy."""
    header = ("plant", "policies", "episodes", "steps", "VIOLATED", "UNSAFE", "BACKUP",
              "not proved", "entered", "unannounced", "fell", "reached")  # fmt: skip
    table, lines = Table(*header), []
    for plant in args.plants or tuple(cases(args.contracts)):
        for kind in args.policies:
            names = [name for name in HOSTILE if name in attacks.ATTACKS]
            jobs = [
                Episode(
                    plant, names[k % len(names)] if kind == "hostile" else kind,
                    args.first_seed + k, str(args.contracts.resolve()),
                )
                for k in range(args.episodes)
            ]  # fmt: skip
            runs = Runs(workers=args.workers)
            counts = [count for _, count in runs.over(run, jobs)]
            line = summary(plant, kind, counts)
            lines.append(line)
            table.add_row(*map(str, line.values()))
            print(json.dumps(line), flush=True)
    Console().print(table)
    if args.output is not None:
        args.output.write_text(json.dumps(lines, indent=1) + "\n", encoding="utf-8")


def summary(plant: str, kind: str, counts: list[Count]) -> dict[str, Any]:
    """Return a line of the table: shares of the steps before an entry, counts of episodes."""
    calm = np.sum([count.calm for count in counts], axis=0)
    total = max(1, int(calm.sum()))
    share = functools.partial(lambda k: f"{100.0 * calm[k] / total:.3f} %")
    unproved = sum(count.unproved for count in counts)
    return {
        "plant": plant,
        "policies": kind,
        "episodes": len(counts),
        "steps": total,
        "VIOLATED": share(FilterStatus.VIOLATED),
        "UNSAFE": share(FilterStatus.UNSAFE),
        "BACKUP": share(FilterStatus.BACKUP),
        "not proved": f"{100.0 * unproved / total:.2f} %",
        "entered": sum(count.entered for count in counts),
        "unannounced": sum(count.entered and not count.announced for count in counts),
        "fell": sum(count.fell for count in counts),
        "reached": sum(count.reached for count in counts),
    }


if __name__ == "__main__":
    main(tyro.cli(Args))
