"""Is a robot noticed that does not do what it is told? Faults that nobody declared, fresh seeds.

``python -m benchmarks.told_and_done --robots cart go1`` prints, for each robot: of the episodes
that enter a strict region while the alarm is ignored, in how many the filter had warned before,
and how many still enter with ``on_alarm="brake"``; then the alarms of undisturbed episodes.
"""

import itertools
import math
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import gymnasium as gym
import joblib
import numpy as np
import tyro

from benchmarks.velocity_loops import LoopEpisode
from hcbf_gym import wrappers
from hcbf_gym.evaluation.attacked import alarm_of, wants
from hcbf_gym.evaluation.attacks import ATTACKS

CONTRACTS = "tests/robots/contracts"
ROBOTS = {
    "cart": "cart",
    "holonomic-cart": "holonomic-cart",
    "go1": f"{CONTRACTS}/go1.json",
    "berkeley_humanoid": f"{CONTRACTS}/berkeley_humanoid.json",
}
POLICIES = (*ATTACKS, "pd")
FAMILIES = ("random", "random-moving")
SEED = 9_310_000
UNDISTURBED_SEED = 9_710_000
LOOP_SEED = 9_810_000
MOST_ROUNDS = 60


def following(change: Callable[[Any], Any]) -> Callable[[Any], None]:
    """Return a fault: the controller is told a change of what it was told."""

    def arm(drive: Any) -> None:
        act = drive.act

        def changed() -> None:
            told = drive.told.copy()
            drive.told[:] = change(told)
            act()
            drive.told[:] = told

        drive.act = changed

    return arm


def late_following(seconds: float) -> Callable[[Any], None]:
    """Return a fault: what the controller is told comes late [s]."""

    def arm(drive: Any) -> None:
        count = round(seconds / drive.simulation.walker.period)
        waiting = deque(np.zeros((count, len(drive.told))))

        def late(told: Any) -> Any:
            waiting.append(told)
            return waiting.popleft()

        following(late)(drive)

    return arm


def floor(friction: float) -> Callable[[Any], None]:
    """Return a fault: a floor that nobody declared."""

    def arm(drive: Any) -> None:
        model = drive.simulation.model
        model.geom_friction[model.geom("floor").id, 0] = friction

    return arm


def compass(off: float) -> Callable[[Any], None]:
    """Return a fault: a heading that is off [rad]."""

    def arm(drive: Any) -> None:
        plain = type(drive.simulation)

        class Turned(plain):
            @property
            def yaw(self) -> float:
                return plain.yaw.fget(self) + off  # type: ignore[attr-defined]

        drive.simulation.__class__ = Turned

    return arm


def scaled_odometry(share: float) -> Callable[[Any], None]:
    """Return a fault: odometry counts a share of the way and of the velocity; 0 is dead."""

    def arm(drive: Any) -> None:
        plain, start = drive.odometry, drive.truth.copy()
        start[2:] = 0.0

        def bent() -> tuple[Any, float]:
            body, yaw = plain()
            return start + share * (body - start), yaw

        drive.odometry = bent

    return arm


def late_odometry(seconds: float) -> Callable[[Any], None]:
    """Return a fault: odometry is late, with fresh stamps [s]."""

    def arm(drive: Any) -> None:
        plain = drive.odometry
        waiting = deque([plain()] * round(seconds / 0.02))

        def late() -> tuple[Any, float]:
            body, yaw = plain()
            waiting.append((body.copy(), yaw))
            return waiting.popleft()

        drive.odometry = late

    return arm


def acting(change: Callable[[int, Any], Any]) -> Callable[[Any], None]:
    """Return a fault: a wrapper inside that keeps the space changes the k-th action."""

    def arm(drive: Any) -> None:
        hold, count = drive.hold, itertools.count()
        drive.hold = lambda u, *rest: hold(change(next(count), u), *rest)

    return arm


FAULTS: dict[str, Callable[[Any], None]] = {
    "dead odometry": scaled_odometry(0.0),
    "half odometry": scaled_odometry(0.5),
    "odometry 500 ms late": late_odometry(0.5),
    "stands": following(lambda told: 0.0 * told),
    "follows by half": following(lambda told: 0.5 * told),
    "follows 1.5 times": following(lambda told: 1.5 * told),
    "drives the other way": following(lambda told: -told),
    "follows 500 ms late": late_following(0.5),
    "floor .03": floor(0.03),
    "floor .1": floor(0.1),
    "compass off by 1.2": compass(1.2),
    "every third action reversed": acting(lambda k, u: -u if k % 3 == 0 else u),
    "actions times .5": acting(lambda k, u: 0.5 * u),
}


class Seen(NamedTuple):
    """When an episode entered a strict region, and when its filter alarmed [steps]; ∞: never."""

    entered: float
    alarmed: float
    reason: int


def run(robot: str, fault: str | None, k: int, seed: int, on_alarm: str = "warn") -> Seen:
    """Run the k-th episode of a fault."""
    warnings.simplefilter("ignore")
    options: dict[str, Any] = {"v_max": 0.8} if k // (2 * len(POLICIES)) % 2 else {}
    env: Any = wrappers.SafetyFilter(
        gym.make(
            "HCBF-WalkerRegions-v0", robot=ROBOTS[robot], scenario=FAMILIES[k % 2],
            disable_env_checker=True, **options,
        ),
        on_alarm=on_alarm,
    )  # fmt: skip
    inner = env.unwrapped
    observation, info = env.reset(seed=seed)
    strict = [j for j, b in enumerate(inner.barriers) if b.priority == 1 and b.reads_position]
    if info["min_h"][strict].min() < 0.0:
        return Seen(math.inf, math.inf, 0)
    if fault is not None:
        FAULTS[fault](inner.walker)
    wanted = wants(POLICIES[k // 2 % len(POLICIES)], env, seed)
    entered = alarmed = math.inf
    reason, step, ended = 0, 0, False
    while not ended:
        observation, _, terminated, truncated, info = env.step(wanted(observation, info))
        step, ended = step + 1, terminated or truncated
        if alarm_of(info) and alarmed == math.inf:
            alarmed, reason = step, alarm_of(info)
        if info["min_h"][strict].min() < 0.0:
            entered = min(entered, step)
    env.close()
    return Seen(entered, alarmed, reason)


def _all(seen: Any) -> list[Seen]:
    """Return what a pool has run."""
    return list(seen)


def pooled(robot: str, wanted: int, rounds: int) -> Iterator[str]:
    """Yield the lines of a robot's faults, in rounds until so many episodes entered."""
    entered = {name: [] for name in FAULTS}
    seen = dict.fromkeys(FAULTS, 0)
    alarmed = dict.fromkeys(FAULTS, 0)
    size = len(FAMILIES) * len(POLICIES)
    with joblib.Parallel(n_jobs=2) as parallel:
        for turn in range(rounds):
            jobs = [
                (name, turn * size + k, SEED + turn * size + k)
                for name in FAULTS
                for k in range(size)
            ]
            for job, one in zip(
                jobs, _all(parallel(joblib.delayed(run)(robot, *job) for job in jobs)), strict=True
            ):
                seen[job[0]] += 1
                alarmed[job[0]] += one.alarmed < math.inf
                if one.entered < math.inf:
                    entered[job[0]].append((job, one))
            if sum(map(len, entered.values())) >= wanted:
                break
        warned = braked = apart = total = 0
        for name, those in entered.items():
            again = _all(parallel(joblib.delayed(run)(robot, *job, "brake") for job, _ in those))
            before = sum(one.alarmed < one.entered for _, one in those)
            still = sum(one.entered < math.inf for one in again)
            warned, total = warned + before, total + len(those)
            braked += still * (name != "floor .03")
            apart += len(those) * (name != "floor .03")
            yield (
                f"{robot}: {name}: {seen[name]} episodes, alarm in {alarmed[name]}, entered "
                f"{len(those)}, warned before {before}, enter with brake {still}"
            )
    yield (
        f"{robot}: pooled: warned before {warned} of {total}, enter with brake {braked} of {apart}"
    )


def undisturbed(robot: str, count: int) -> str:
    """Return how many undisturbed episodes alarmed."""
    seen = joblib.Parallel(n_jobs=2)(
        joblib.delayed(run)(robot, None, k, UNDISTURBED_SEED + k) for k in range(count)
    )
    reasons = [(k, one.reason) for k, one in enumerate(seen) if one.reason]  # type: ignore[union-attr]
    return f"{robot}: undisturbed: {len(reasons)} alarms in {count} episodes {reasons}"


def loops(count: int) -> str:
    """Return how many loops of `VelocityFilter` alarmed, 30 % of the messages lost, with jitter."""
    episodes = [
        LoopEpisode(
            ("cart", "holonomic-cart")[k % 2], tuple(ATTACKS)[k // 2 % len(ATTACKS)],
            FAMILIES[k // 16 % 2], LOOP_SEED + k, (20.0, 50.0, 100.0)[k % 3], 1.2, lost=0.3,
        )
        for k in range(count)
    ]  # fmt: skip
    seen = joblib.Parallel(n_jobs=2)(joblib.delayed(one.run)() for one in episodes)
    reasons = [(k, one.alarm) for k, one in enumerate(seen) if one.alarm]  # type: ignore[union-attr]
    return f"VelocityFilter: {len(reasons)} alarms in {count} loops {reasons}"


def main(
    robots: tuple[str, ...] = tuple(ROBOTS),
    quick: bool = False,
    entering: int = 100,
    calm: int = 300,
    loop: int = 100,
) -> None:
    """Print what is seen.

    Args:
        robots: names of `ROBOTS`.
        quick: one round of the faults, few undisturbed episodes.
        entering: episodes that enter, of each robot.
        calm: undisturbed episodes of each robot.
        loop: loops of `VelocityFilter`.
    """
    if loop:
        print(loops(4 if quick else loop), flush=True)
    for robot in robots:
        print(undisturbed(robot, 8 if quick else calm), flush=True)
        for line in pooled(robot, entering, 1 if quick else MOST_ROUNDS):
            print(line, flush=True)


if __name__ == "__main__":
    from benchmarks import told_and_done  # under its own name, by which workers find it

    tyro.cli(told_and_done.main)
