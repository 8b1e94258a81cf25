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
from functools import partial
from operator import mul
from typing import Any, NamedTuple

import gymnasium as gym
import joblib
import numpy as np
import tyro

from benchmarks.velocity_loops import LoopEpisode
from hcbf_gym import wrappers
from hcbf_gym.evaluation.attacked import alarm_of, policy_of
from hcbf_gym.evaluation.attacks import ATTACKS
from hcbf_gym.evaluation.episode import samples

CONTRACTS = "tests/robots/contracts"
ROBOTS = {
    "cart": "cart",
    "holonomic-cart": "holonomic-cart",
    "go1": f"{CONTRACTS}/go1.json",
    "berkeley_humanoid": f"{CONTRACTS}/berkeley_humanoid.json",
    "a1": None,
}
"""Contracts; the A1, which follows accelerations, has an environment and alarms of its own."""
POLICIES = (*ATTACKS, "pd")
FAMILIES = ("random", "random-moving")
SEED = 9_310_000
UNDISTURBED_SEED = 9_720_000
LOOP_SEED = 9_810_000
SHARE_SEED = 9_910_000
MOST_ROUNDS = 60
LENGTH = 1000
"""Steps of an episode with a fault, 20 s; undisturbed ones take what time slow robots have."""


SHARES = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.1, 1.2, 1.3, 1.4, 1.5)
"""Of what it is told, that a robot does."""


def following(change: Callable[[Any], Any]) -> Callable[[Any], None]:
    """Return a fault: the controller is told a change of what it was told."""

    def arm(drive: Any) -> None:
        act = drive.act

        def changed() -> None:
            told = drive.command.copy()
            drive.command[:] = change(told)
            act()
            drive.command[:] = told

        drive.act = changed

    return arm


def late_following(seconds: float) -> Callable[[Any], None]:
    """Return a fault: what the controller is told comes late [s]."""

    def arm(drive: Any) -> None:
        count = round(seconds / drive.simulation.walker.period)
        waiting = deque(np.zeros((count, len(drive.command))))

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


def known_as(change: Callable[[Any, Any], Any]) -> Callable[[Any], None]:
    """Return a fault of the A1: another position is known, by its start and the true one (2,)."""

    def arm(walker: Any) -> None:
        plain, start = walker.estimate, walker.truth[:2].copy()

        def bent(time: float) -> Any:
            estimate = plain(time)
            x, lag = estimate.x.copy(), estimate.lag.copy()
            x[:2] = change(start, x[:2])
            lag[:2] += x[:2] - estimate.x[:2]
            return estimate._replace(x=x, lag=lag)

        walker.estimate = bent

    return arm


def late_position(seconds: float) -> Callable[[Any], None]:
    """Return a fault of the A1: its position is late [s]."""

    def arm(walker: Any) -> None:
        waiting = deque([walker.truth[:2].copy()] * round(seconds / 0.02))

        def late(start: Any, now: Any) -> Any:
            waiting.append(now.copy())
            return waiting.popleft()

        known_as(late)(walker)

    return arm


def slippery(friction: float) -> Callable[[Any], None]:
    """Return a fault of the A1: feet that find less friction than is declared."""

    def arm(walker: Any) -> None:
        simulation = walker.simulation
        simulation.model.geom_friction[simulation._feet, 0] = friction

    return arm


def late_torques(seconds: float) -> Callable[[Any], None]:
    """Return a fault of the A1: torques come late [s]."""

    def arm(walker: Any) -> None:
        waiting = walker.simulation._delayed
        for _ in range(round(seconds / walker.simulation.model.opt.timestep) - len(waiting)):
            waiting.appendleft(waiting[0].copy())

    return arm


def turned(u: Any, by: float) -> Any:
    """Return an acceleration (2,) in axes that are off by an angle [rad]."""
    return np.array(
        [math.cos(by) * u[0] - math.sin(by) * u[1], math.sin(by) * u[0] + math.cos(by) * u[1]]
    )


def late_actions(seconds: float) -> Callable[[Any], None]:
    """Return a fault: a wrapper inside that delays actions [s]."""

    def arm(drive: Any) -> None:
        waiting = deque(np.zeros((round(seconds / 0.02), 2)))

        def late(k: int, u: Any) -> Any:
            waiting.append(u)
            return waiting.popleft()

        acting(late)(drive)

    return arm


ACTING = {
    "every third action reversed": acting(lambda k, u: -u if k % 3 == 0 else u),
    "actions times .5": acting(lambda k, u: 0.5 * u),
}
WALKER_FAULTS: dict[str, Callable[[Any], None]] = {
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
    **ACTING,
}
A1_FAULTS: dict[str, Callable[[Any], None]] = {
    "dead position": known_as(lambda start, now: start),
    "half the way": known_as(lambda start, now: start + 0.5 * (now - start)),
    "position 500 ms late": late_position(0.5),
    "torques 16 ms late": late_torques(0.016),
    "floor .1": slippery(0.1),
    "floor .3": slippery(0.3),
    "compass off by 1.2": acting(lambda k, u: turned(u, 1.2)),
    "actions 200 ms late": late_actions(0.2),
    **ACTING,
}


def faults_of(robot: str) -> dict[str, Callable[[Any], None]]:
    """Return the faults of a robot."""
    return A1_FAULTS if ROBOTS[robot] is None else WALKER_FAULTS


def environment(robot: str, family: str, capped: bool) -> Any:
    """Return a robot's environment; capped: at .8 m/s, where its environment takes a cap."""
    if ROBOTS[robot] is None:
        return gym.make("HCBF-A1Regions-v0", scenario=family, disable_env_checker=True)
    options: dict[str, Any] = {"v_max": 0.8} if capped else {}
    return gym.make(
        "HCBF-WalkerRegions-v0", robot=ROBOTS[robot], scenario=family, disable_env_checker=True,
        **options,
    )  # fmt: skip


class Seen(NamedTuple):
    """When an episode entered a strict region, and when its filter alarmed [steps]; ∞: never."""

    entered: float
    alarmed: float
    reason: int


def run(robot: str, fault: str | float | None, k: int, seed: int, on_alarm: str = "warn") -> Seen:
    """Run the k-th episode of a fault; a number is the share that is done of what is told."""
    warnings.simplefilter("ignore")
    capped = bool(k // (2 * len(POLICIES)) % 2)
    env: Any = wrappers.SafetyFilter(environment(robot, FAMILIES[k % 2], capped), on_alarm=on_alarm)
    inner = env.unwrapped
    walk = samples(env, policy_of(POLICIES[k // 2 % len(POLICIES)], env, seed), seed)
    info = next(walk).info
    strict = [j for j, b in enumerate(inner.barriers) if b.priority == 1 and b.reads_position]
    if info["min_h"][strict].min() < 0.0:
        return Seen(math.inf, math.inf, 0)
    if fault is not None:
        arm = faults_of(robot)[fault] if isinstance(fault, str) else following(partial(mul, fault))
        arm(inner.drive)
    entered = alarmed = math.inf
    reason = 0
    most = None if fault is None else LENGTH
    for step, (_, info, *_) in enumerate(itertools.islice(walk, most), 1):
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
    faults = faults_of(robot)
    entered = {name: [] for name in faults}
    seen = dict.fromkeys(faults, 0)
    alarmed = dict.fromkeys(faults, 0)
    size = len(FAMILIES) * len(POLICIES)
    with joblib.Parallel(n_jobs=2) as parallel:
        for turn in range(rounds):
            jobs = [
                (name, turn * size + k, SEED + turn * size + k)
                for name in faults
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


def shares(robot: str, count: int) -> Iterator[str]:
    """Yield in how many episodes it is seen that a robot does a share of what it is told."""
    for share in SHARES:
        seen = _all(
            joblib.Parallel(n_jobs=2)(
                joblib.delayed(run)(robot, share, k, SHARE_SEED + k) for k in range(count)
            )
        )
        alarmed = sum(one.alarmed < math.inf for one in seen)
        yield f"{robot}: does {share:g} of what it is told: alarm in {alarmed} of {count} episodes"


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
    share: int = 36,
) -> None:
    """Print what is seen.

    Args:
        robots: names of `ROBOTS`.
        quick: one round of the faults, few undisturbed episodes.
        entering: episodes that enter, of each robot.
        calm: undisturbed episodes of each robot.
        loop: loops of `VelocityFilter`.
        share: episodes of each share of what it is told that a robot does.
    """
    if loop:
        print(loops(4 if quick else loop), flush=True)
    for robot in robots:
        print(undisturbed(robot, 8 if quick else calm), flush=True)
        for line in pooled(robot, entering, 1 if quick else MOST_ROUNDS):
            print(line, flush=True)
        if share and not quick and ROBOTS[robot] is not None:
            for line in shares(robot, share):
                print(line, flush=True)


if __name__ == "__main__":
    from benchmarks import told_and_done  # under its own name, by which workers find it

    tyro.cli(told_and_done.main)
