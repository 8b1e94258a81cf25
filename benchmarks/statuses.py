"""How often each status occurs, on every plant, and what entries no status announced.

``python -m benchmarks.statuses --plants rom cart --episodes 60`` prints a table; an entry counts as
announced where a step at or before it was VIOLATED, UNSAFE or BACKUP.
"""

import itertools
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import tyro
from rich.console import Console

from benchmarks.common import table
from hcbf_gym import wrappers
from hcbf_gym.evaluation.attacked import policy_of
from hcbf_gym.evaluation.episode import samples
from hcbf_gym.evaluation.jobs import Runs, in_order
from hcbf_gym.programs import FilterStatus

HOSTILE = ("nearest", "corner", "edge", "slam", "bang-bang")  # in turn
ANNOUNCED = FilterStatus.VIOLATED
COUNTED = ("entered", "unannounced", "fell", "reached")
CONTRACTS = Path(__file__).parents[1] / "tests/robots/contracts"
ROM, A1 = "HCBF-Regions-v0", "HCBF-A1Regions-v0"
WALKER = "hcbf_robots:HCBF-WalkerRegions-v0"
ROBOTS = {"cart": "cart", "holonomic": "holonomic-cart"} | {
    name: str(CONTRACTS / f"{file}.json")
    for name, file in (("go1", "go1"), ("humanoid", "berkeley_humanoid"))
}
PLANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "rom": (ROM, {"scenario": "random"}),
    "rom-moving": (ROM, {"scenario": "random-moving"}),
    "rom-map": (ROM, {"scenario": "random-map"}),
    **{name: (WALKER, {"robot": robot, "scenario": "random"}) for name, robot in ROBOTS.items()},
    **{
        f"{name}-moving": (WALKER, {"robot": ROBOTS[name], "scenario": "random-moving"})
        for name in ("cart", "go1")
    },
    "a1": (A1, {"scenario": "random"}),
    "a1-moving": (A1, {"scenario": "random-moving"}),
    "a1-body": (A1, {"scenario": "random-wide", "body": "footprint"}),
}


@dataclass(frozen=True)
class Episode:
    """One episode of a plant under an attack or a policy."""

    plant: str
    policy: str
    seed: int


def run(episode: Episode) -> dict[str, Any]:
    """Run an episode; return what is counted, steps up to the first entry by their status."""
    warnings.simplefilter("ignore")
    env_id, options = PLANTS[episode.plant]
    env: Any = wrappers.SafetyFilter(gym.make(env_id, **options))
    walk = samples(env, policy_of(episode.policy, env, episode.seed), episode.seed)
    info = next(walk).info
    strict = [
        k for k, b in enumerate(env.unwrapped.barriers) if b.priority == 1 and b.reads_position
    ]
    key = "min_body_h" if "min_body_h" in info else "min_h"
    calm = np.zeros(len(FilterStatus), dtype=np.int64)
    entered = announced = bool(np.min(info[key][strict]) < 0.0)
    unproved = 0
    for _, info, *_ in walk:
        status = int(info["safety_filter"]["status"])
        unproved += status < ANNOUNCED and not info["safety_filter"].get("proved", 1)
        calm[status] += not entered
        announced |= not entered and status >= ANNOUNCED
        entered |= bool(np.min(info[key][strict]) < 0.0)
    env.close()
    return {
        "calm": calm, "not proved": int(unproved), "entered": entered,
        "unannounced": entered and not announced, "fell": bool(info.get("fallen", 0.0)),
        "reached": bool(info["is_success"]),
    }  # fmt: skip


def main(
    plants: tuple[str, ...] = tuple(PLANTS),
    episodes: int = 60,
    policies: tuple[str, ...] = ("hostile", "pd"),
    first_seed: int = 31_000_000,
) -> None:
    """Print a table, a line a plant and kind of policy: shares of steps, counts of episodes.

    Args:
        plants: their names.
        episodes: of each plant and kind of policy.
        policies: "hostile" takes attacks in turn; else a policy's name.
        first_seed: of the episodes.
    """
    lines = []
    for plant, policy in itertools.product(plants, policies):
        names = HOSTILE if policy == "hostile" else (policy,)
        jobs = [Episode(plant, names[k % len(names)], first_seed + k) for k in range(episodes)]
        seen = in_order(Runs().over(run, jobs, f"{plant}, {policy}"))
        calm = np.sum([one["calm"] for one in seen], axis=0)
        steps = max(1, int(calm.sum()))
        shares = {s.name: f"{calm[s] / steps:.3%}" for s in FilterStatus if s >= ANNOUNCED}
        shares["not proved"] = f"{sum(one['not proved'] for one in seen) / steps:.2%}"
        counts = {key: sum(one[key] for one in seen) for key in COUNTED}
        lines.append({"plant": plant, "policies": policy, "steps": steps} | shares | counts)
    Console().print(table("statuses", lines, {key: f"{{{key}}}" for key in lines[0]}).rich())


if __name__ == "__main__":
    from benchmarks import statuses  # by its own name, under which workers find it

    tyro.cli(statuses.main)
