"""Is an undeclared fault between command and motion noticed? Fresh seeds, on every robot.

``python -m benchmarks.command_tracking --robots cart go1`` prints, for each robot: of the episodes
that enter a strict region while the alarm is ignored, in how many the filter had warned before,
and how many still enter with ``on_alarm="brake"``; then the alarms of undisturbed episodes. As the
suite `monitor` it counts the warnings about wrappers between filter and robot.
"""

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from operator import mul
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import tyro

from benchmarks.common import parallel, table
from benchmarks.velocity_loops import LoopEpisode
from hcbf_gym import wrappers
from hcbf_gym.evaluation.attacked import AttackedEpisode, alarm_of, policy_of
from hcbf_gym.evaluation.attacks import ATTACKS
from hcbf_gym.evaluation.episode import samples
from hcbf_gym.evaluation.tables import Table

CONTRACTS = "tests/robots/contracts"
ROBOTS = {
    "cart": "cart",
    "holonomic-cart": "holonomic-cart",
    "go1": f"{CONTRACTS}/go1.json",
    "berkeley_humanoid": f"{CONTRACTS}/berkeley_humanoid.json",
    "a1": None,
}
"""Contracts; the A1, which follows accelerations, has its own environment and alarms."""
POLICIES = (*ATTACKS, "pd")
FAMILIES = ("random", "random-moving")
SEED, UNDISTURBED_SEED, LOOP_SEED, SHARE_SEED = 9_310_000, 9_720_000, 9_810_000, 9_910_000
MOST_ROUNDS = 60
LENGTH = 1000
"""Steps of an episode with a fault, 20 s; undisturbed ones take what time slow robots have."""
SHARES = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.1, 1.2, 1.3, 1.4, 1.5)  # of a command, executed

Arm = Callable[[Any], None]
"""Puts a fault into a drive."""


class Between(gym.ActionWrapper):
    """A wrapper of a careless user: from all actions of an episode it makes the present one."""

    def __init__(self, env: gym.Env, change: Callable[[list[Any]], Any]):
        super().__init__(env)
        self._change, self._past = change, []

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """Begin with no action."""
        self._past = []
        return self.env.reset(**options)

    def action(self, action: Any) -> Any:
        """Return what is applied in its place."""
        self._past.append(np.array(action))
        return self._change(self._past)


WRAPPERS: dict[str, Callable[[gym.Env], gym.Env] | None] = {
    "none": None,
    "delay of 10 steps": partial(Between, change=lambda u: u[-11] if len(u) > 10 else np.zeros(2)),
    "hold of 25 steps": partial(Between, change=lambda u: u[(len(u) - 1) // 25 * 25]),
    "gain of 2": partial(Between, change=lambda u: 2.0 * u[-1]),
}
"""What is between filter and robot."""


def late(seconds: float, first: Any, period: float = 0.02) -> Callable[[Any], Any]:
    """Return a function of values that returns the value of some time ago [s]."""
    waiting = deque([first] * round(seconds / period))

    def one(value: Any) -> Any:
        waiting.append(value)
        return waiting.popleft()

    return one


def following(change: Callable[[Any], Any]) -> Arm:
    """Return a fault: the controller gets a change of the command."""

    def arm(drive: Any) -> None:
        act = drive.act

        def changed() -> None:
            commanded = drive.command.copy()
            drive.command[:] = change(commanded)
            act()
            drive.command[:] = commanded

        drive.act = changed

    return arm


def late_following(seconds: float) -> Arm:
    """Return a fault: the controller gets a command late [s]."""

    def arm(drive: Any) -> None:
        period = drive.simulation.walker.period
        following(late(seconds, np.zeros(len(drive.command)), period))(drive)

    return arm


def floor(friction: float) -> Arm:
    """Return a fault: an undeclared floor."""

    def arm(drive: Any) -> None:
        model = drive.simulation.model
        model.geom_friction[model.geom("floor").id, 0] = friction

    return arm


def compass(off: float) -> Arm:
    """Return a fault: a heading that is off [rad]."""

    def arm(drive: Any) -> None:
        plain = type(drive.simulation)

        class Turned(plain):
            @property
            def yaw(self) -> float:
                return plain.yaw.fget(self) + off  # type: ignore[attr-defined]

        drive.simulation.__class__ = Turned

    return arm


def scaled_odometry(share: float) -> Arm:
    """Return a fault: odometry counts a share of the path and of the velocity; 0 is dead."""

    def arm(drive: Any) -> None:
        plain, start = drive.odometry, drive.truth.copy()
        start[2:] = 0.0

        def scaled() -> tuple[Any, float]:
            body, yaw = plain()
            return start + share * (body - start), yaw

        drive.odometry = scaled

    return arm


def late_odometry(seconds: float) -> Arm:
    """Return a fault: odometry is late, with fresh stamps [s]."""

    def arm(drive: Any) -> None:
        plain = drive.odometry
        past = late(seconds, plain())

        def delayed() -> tuple[Any, float]:
            body, yaw = plain()
            return past((body.copy(), yaw))

        drive.odometry = delayed

    return arm


def acting(change: Callable[[int, Any], Any]) -> Arm:
    """Return a fault: a wrapper inside that keeps the space changes the k-th action."""

    def arm(drive: Any) -> None:
        hold, count = drive.hold, itertools.count()
        drive.hold = lambda u, *rest: hold(change(next(count), u), *rest)

    return arm


def late_actions(seconds: float) -> Arm:
    """Return a fault: a wrapper inside that delays actions [s]."""

    def arm(drive: Any) -> None:
        past = late(seconds, np.zeros(2))
        acting(lambda k, u: past(u))(drive)

    return arm


def known_as(change: Callable[[Any, Any], Any]) -> Arm:
    """Return a fault of the A1: another position is known, by its start and the true one (2,)."""

    def arm(walker: Any) -> None:
        plain, start = walker.estimate, walker.truth[:2].copy()

        def wrong(time: float) -> Any:
            estimate = plain(time)
            x, lag = estimate.x.copy(), estimate.lag.copy()
            x[:2] = change(start, x[:2])
            lag[:2] += x[:2] - estimate.x[:2]
            return estimate._replace(x=x, lag=lag)

        walker.estimate = wrong

    return arm


def late_position(seconds: float) -> Arm:
    """Return a fault of the A1: its position is late [s]."""

    def arm(walker: Any) -> None:
        past = late(seconds, walker.truth[:2].copy())
        known_as(lambda start, now: past(now.copy()))(walker)

    return arm


def slippery(friction: float) -> Arm:
    """Return a fault of the A1: feet that find less friction than is declared."""

    def arm(walker: Any) -> None:
        simulation = walker.simulation
        simulation.model.geom_friction[simulation._feet, 0] = friction

    return arm


def late_torques(seconds: float) -> Arm:
    """Return a fault of the A1: torques come late [s]."""

    def arm(walker: Any) -> None:
        waiting = walker.simulation._delayed
        for _ in range(round(seconds / walker.simulation.model.opt.timestep) - len(waiting)):
            waiting.appendleft(waiting[0].copy())

    return arm


def turned(u: Any, by: float) -> Any:
    """Return an acceleration (2,) in axes that are off by an angle [rad]."""
    cos, sin = math.cos(by), math.sin(by)
    return np.array([cos * u[0] - sin * u[1], sin * u[0] + cos * u[1]])


ACTING = {
    "every third action reversed": acting(lambda k, u: -u if k % 3 == 0 else u),
    "actions times .5": acting(lambda k, u: 0.5 * u),
}
WALKER_FAULTS: dict[str, Arm] = {
    "dead odometry": scaled_odometry(0.0),
    "half odometry": scaled_odometry(0.5),
    "odometry 500 ms late": late_odometry(0.5),
    "does not move": following(partial(mul, 0.0)),
    "follows by half": following(partial(mul, 0.5)),
    "follows 1.5 times": following(partial(mul, 1.5)),
    "reverses": following(partial(mul, -1.0)),
    "follows 500 ms late": late_following(0.5),
    "floor .03": floor(0.03),
    "floor .1": floor(0.1),
    "compass off by 1.2": compass(1.2),
    **ACTING,
}
A1_FAULTS: dict[str, Arm] = {
    "dead position": known_as(lambda start, now: start),
    "half the position": known_as(lambda start, now: start + 0.5 * (now - start)),
    "position 500 ms late": late_position(0.5),
    "torques 16 ms late": late_torques(0.016),
    "floor .1": slippery(0.1),
    "floor .3": slippery(0.3),
    "compass off by 1.2": acting(lambda k, u: turned(u, 1.2)),
    "actions 200 ms late": late_actions(0.2),
    **ACTING,
}


def faults_of(robot: str) -> dict[str, Arm]:
    """Return the faults of a robot."""
    return A1_FAULTS if ROBOTS[robot] is None else WALKER_FAULTS


def environment(robot: str, family: str, capped: bool) -> Any:
    """Return a robot's environment; capped: at .8 m/s, where its environment takes a cap."""
    options: dict[str, Any] = {"scenario": family, "disable_env_checker": True}
    if ROBOTS[robot] is None:
        return gym.make("HCBF-A1Regions-v0", **options)
    options |= {"v_max": 0.8} if capped else {}
    return gym.make("hcbf_robots:HCBF-WalkerRegions-v0", robot=ROBOTS[robot], **options)


class Seen(NamedTuple):
    """When an episode entered a strict region, and when its filter alarmed [steps]; ∞: never."""

    entered: float
    alarmed: float
    reason: int


def run_one(
    robot: str, fault: str | float | None, k: int, seed: int, on_alarm: str = "warn"
) -> Seen:
    """Run the k-th episode of a fault; a number is the executed share of the command."""
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


def pooled(robot: str, wanted: int, rounds: int) -> Iterator[str]:
    """Yield the lines of a robot's faults, in rounds until so many episodes entered."""
    seen: dict[str, list[tuple[tuple[Any, ...], Seen]]] = {name: [] for name in faults_of(robot)}
    size, entering = len(FAMILIES) * len(POLICIES), 0
    for turn in range(rounds):
        numbers = range(turn * size, (turn + 1) * size)
        jobs = [(robot, name, k, SEED + k) for name in seen for k in numbers]
        for job, one in zip(jobs, parallel(run_one, jobs), strict=True):
            seen[job[1]].append((job, one))
            entering += one.entered < math.inf
        if entering >= wanted:
            break
    warned = braked = apart = total = 0
    for name, those in seen.items():
        entered = [(job, one) for job, one in those if one.entered < math.inf]
        again = parallel(run_one, ((*job, "brake") for job, _ in entered))
        before = sum(one.alarmed < one.entered for _, one in entered)
        still = sum(one.entered < math.inf for one in again)
        warned, total = warned + before, total + len(entered)
        braked += still * (name != "floor .03")
        apart += len(entered) * (name != "floor .03")
        alarmed = sum(one.alarmed < math.inf for _, one in those)
        yield (
            f"{robot}: {name}: {len(those)} episodes, alarm in {alarmed}, entered "
            f"{len(entered)}, warned before {before}, enter with brake {still}"
        )
    yield (
        f"{robot}: pooled: warned before {warned} of {total}, enter with brake {braked} of {apart}"
    )


def undisturbed(robot: str, count: int) -> str:
    """Return how many undisturbed episodes alarmed."""
    seen = parallel(run_one, ((robot, None, k, UNDISTURBED_SEED + k) for k in range(count)))
    reasons = [(k, one.reason) for k, one in enumerate(seen) if one.reason]
    return f"{robot}: undisturbed: {len(reasons)} alarms in {count} episodes {reasons}"


def shares(robot: str, count: int) -> Iterator[str]:
    """Yield in how many episodes a share of the command is seen."""
    for share in SHARES:
        seen = parallel(run_one, ((robot, share, k, SHARE_SEED + k) for k in range(count)))
        alarmed = sum(one.alarmed < math.inf for one in seen)
        yield f"{robot}: {share:g} of the command: alarm in {alarmed} of {count} episodes"


def loops(count: int) -> str:
    """Return how many loops of `VelocityFilter` alarmed, 30 % of the messages lost, with jitter."""
    episodes = [
        LoopEpisode(
            ("cart", "holonomic-cart")[k % 2], tuple(ATTACKS)[k // 2 % len(ATTACKS)],
            FAMILIES[k // 16 % 2], LOOP_SEED + k, (20.0, 50.0, 100.0)[k % 3], 1.2, lost=0.3,
        )
        for k in range(count)
    ]  # fmt: skip
    seen = parallel(LoopEpisode.run, ((one,) for one in episodes))
    reasons = [(k, one.alarm) for k, one in enumerate(seen) if one.alarm]
    return f"VelocityFilter: {len(reasons)} alarms in {count} loops {reasons}"


def run(quick: bool) -> dict[str, Any]:
    """Count the episodes with a warning about a wrapper, on the reduced-order model and the A1."""
    rows = []
    for env, count in (("HCBF-Regions-v0", 200), ("HCBF-A1Regions-v0", 100)):
        for fault, wrapper in WRAPPERS.items():
            episodes = [
                AttackedEpisode(
                    ("pd", "nearest", "bang-bang", "edge")[k % 4], "random", 70_000 + k, env,
                    {"max_episode_steps": 400}, inside=wrapper,
                )
                for k in range(2 if quick else count)
            ]  # fmt: skip
            seen = parallel(AttackedEpisode.run, ((one,) for one in episodes))
            warned = sum(outcome.warned for outcome in seen)
            rows.append({"env": env, "fault": fault, "episodes": len(episodes), "warned": warned})
    return {"monitor": rows}


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return how often the filter warned."""
    columns = {"environment": "{env}", "between filter and robot": "{fault}",
               "episodes": "{episodes}", "warned": "{warned}"}  # fmt: skip
    return {"warnings": table("does the filter notice?", figures["monitor"], columns)}


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
        share: episodes of each executed share of the command.
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
    from benchmarks import command_tracking  # by its own name, under which workers find it

    tyro.cli(command_tracking.main)
