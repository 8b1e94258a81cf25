"""Is an undeclared fault between command and motion noticed? Fresh seeds, on every robot.

``python -m benchmarks.command_tracking --robots cart go1`` prints, for each robot and fault: in how
many episodes there was an alarm; how many entered a strict region while it was ignored, in how many
of them it came before; how many still enter with ``on_alarm="brake"``.
"""

import itertools
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import gymnasium as gym
import tyro

from benchmarks import faults, walkers
from benchmarks.common import parallel
from hcbf_gym import wrappers
from hcbf_gym.evaluation.attacked import alarm_of, policy_of
from hcbf_gym.evaluation.attacks import ATTACKS
from hcbf_gym.evaluation.episode import samples

ROBOTS = {name: robot.contract for name, robot in walkers.ROBOTS.items()} | {"a1": None}
"""Contracts; the A1, which follows accelerations, has its own environment and alarms."""
POLICIES = (*ATTACKS, "pd")
FAMILIES = ("random", "random-moving")
SEED, UNDISTURBED_SEED = 9_310_000, 9_720_000
ROUND, MOST_ROUNDS = len(FAMILIES) * len(POLICIES), 60
LENGTH = 1000
"""Steps of an episode with a fault, 20 s; undisturbed ones take what time slow robots have."""


def faults_of(robot: str) -> dict[str, faults.Fault]:
    """Return the faults of a robot."""
    return faults.A1 if ROBOTS[robot] is None else faults.WALKER


def environment(robot: str, family: str, capped: bool) -> Any:
    """Return a robot's environment; capped: at 0.8 m/s, where its environment takes a cap."""
    options: dict[str, Any] = {"scenario": family, "disable_env_checker": True}
    if ROBOTS[robot] is None:
        return gym.make("HCBF-A1Regions-v0", **options)
    options |= {"v_max": 0.8} if capped else {}
    return gym.make("hcbf_robots:HCBF-WalkerRegions-v0", robot=ROBOTS[robot], **options)


class Seen(NamedTuple):
    """When an episode entered a strict region, and when its filter alarmed [steps]; ∞: never."""

    entered: float = math.inf
    alarmed: float = math.inf
    reason: int = 0


def run_one(robot: str, fault: str | None, k: int, seed: int, on_alarm: str = "warn") -> Seen:
    """Run the k-th episode of a fault."""
    capped = bool(k // ROUND % 2)
    env: Any = wrappers.SafetyFilter(environment(robot, FAMILIES[k % 2], capped), on_alarm=on_alarm)
    inner, seen = env.unwrapped, Seen()
    walk = samples(env, policy_of(POLICIES[k // 2 % len(POLICIES)], env, seed), seed)
    info = next(walk).info
    strict = [j for j, b in enumerate(inner.barriers) if b.priority == 1 and b.reads_position]
    if info["min_h"][strict].min() < 0.0:
        return seen
    if fault is not None:
        faults_of(robot)[fault](inner.drive)
    most = None if fault is None else LENGTH
    for step, (_, info, *_) in enumerate(itertools.islice(walk, most), 1):
        if alarm_of(info) and seen.alarmed == math.inf:
            seen = seen._replace(alarmed=step, reason=alarm_of(info))
        if info["min_h"][strict].min() < 0.0:
            seen = seen._replace(entered=min(seen.entered, step))
    env.close()
    return seen


def pooled(robot: str, wanted: int) -> Iterator[str]:
    """Yield the lines of a robot's faults, in rounds until so many episodes entered."""
    seen: dict[str, list[tuple[tuple[Any, ...], Seen]]] = {name: [] for name in faults_of(robot)}
    for turn in range(MOST_ROUNDS):
        numbers = range(turn * ROUND, (turn + 1) * ROUND)
        jobs = [(robot, name, k, SEED + k) for name in seen for k in numbers]
        for job, one in zip(jobs, parallel(run_one, jobs), strict=True):
            seen[job[1]].append((job, one))
        if sum(one.entered < math.inf for those in seen.values() for _, one in those) >= wanted:
            break
    warned = braked = total = 0
    for name, those in seen.items():
        entered = [(job, one) for job, one in those if one.entered < math.inf]
        again = parallel(run_one, ((*job, "brake") for job, _ in entered))
        before = sum(one.alarmed < one.entered for _, one in entered)
        still = sum(one.entered < math.inf for one in again)
        warned, braked, total = warned + before, braked + still, total + len(entered)
        alarmed = sum(one.alarmed < math.inf for _, one in those)
        yield (
            f"{name}: {len(those)} episodes, alarm in {alarmed}, entered {len(entered)}, "
            f"warned before {before}, enter with brake {still}"
        )
    yield f"pooled: warned before {warned} of {total}, enter with brake {braked}"


def undisturbed(robot: str, count: int) -> str:
    """Return how many undisturbed episodes alarmed."""
    seen = parallel(run_one, ((robot, None, k, UNDISTURBED_SEED + k) for k in range(count)))
    reasons = [(k, one.reason) for k, one in enumerate(seen) if one.reason]
    return f"undisturbed: {len(reasons)} alarms in {count} episodes {reasons}"


def main(
    robots: tuple[str, ...] = (),
    entering: int = 100,
    calm: int = 300,
) -> None:
    """Print what is seen.

    Args:
        robots: names of `ROBOTS`; without any all whose files are on this machine.
        entering: episodes that enter, of each robot.
        calm: undisturbed episodes of each robot.
    """
    present = (*walkers.contracts(), "a1")
    for robot in robots or present:
        for line in itertools.chain([undisturbed(robot, calm)], pooled(robot, entering)):
            print(f"{robot}: {line}", flush=True)


if __name__ == "__main__":
    from benchmarks import command_tracking  # by its own name, under which workers find it

    tyro.cli(command_tracking.main)
