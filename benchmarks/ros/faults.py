"""Fault by fault on the node's core: zero in time, the reason named, and motion again after it.

The same cases go through rclpy in `live_faults`.
"""

import warnings
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from benchmarks.ros.drive import HARDEST, TICK, Drive
from hcbf_gym.arrays import Array
from hcbf_gym.errors import SafetyWarning
from hcbf_robots.maps.nav2 import Raster
from hcbf_robots.ros.sources import grid_of

STEP = 0.05
"""A period of the node [s]."""
SOURCES = {
    "observation_sources": ["scan", "map"],
    "scan.topic": "scan",
    "scan.source_timeout": 0.5,
    "map.type": "map",
    "map.topic": "map",
    "map.unknown": 0,
    "map.source_timeout": 0.9,
}
Tick = Callable[[], Any]


Rig = Any
"""`drive.Drive` or `rig.Base`: a robot with `pose`, `twist`, `wanted`, `stamp()` and `set_back(s)`,
whose messages `say_command`, `say_odometry` and `say_scan` replace."""


class Case(NamedTuple):
    """One fault."""

    within: float | None  # after which the robot is at zero, with a period more; None: never
    reason: str  # that diagnostics contain; one of several with | between
    without: str = ""  # the messages that are missing meanwhile
    tamper: Callable[[Rig, np.random.Generator], Tick] | None = None  # begins; returns each tick's
    again: float = 0.2  # after which the robot moves again [s]
    lasts: float | None = None  # zero comes for at least so long [s]; None: until the fault ends
    clock: float = 1.0  # speed of the node's clock


def _nan_command(rig: Rig, rng: np.random.Generator) -> Tick:
    bad = (np.nan, np.inf, -np.inf)[rng.integers(3)]
    return lambda: rig.say_command((bad, 0.0, 0.0))


def _repeated(rig: Rig, rng: np.random.Generator) -> Tick:
    stamp, pose = rig.stamp(), rig.pose
    return lambda: rig.say_odometry(pose, stamp)


def _late(rig: Rig, rng: np.random.Generator) -> Tick:
    past = deque[Any]()

    def tick() -> None:
        past.append((rig.pose, rig.stamp()))
        rig.say_odometry(*past[len(past) // 8])  # as if the link were eight times too slow

    return tick


def _bad_odometry(rig: Rig, rng: np.random.Generator) -> Tick:
    bad, k = (np.nan, np.inf, 1e9)[rng.integers(3)], int(rng.integers(6))

    def tick() -> None:
        numbers = np.array([*rig.pose, *np.asarray(rig.twist)])
        numbers[k] = bad
        rig.say_odometry(numbers[:3], twist=numbers[3:])

    return tick


def _frozen(rig: Rig, rng: np.random.Generator) -> Tick:
    pose, twist = rig.pose, rig.twist
    return lambda: rig.say_odometry(pose, twist=twist)


def _jump(rig: Rig, rng: np.random.Generator) -> Tick:
    turn = rng.uniform(-np.pi, np.pi)
    rig.pose = rig.pose + rng.uniform(0.6, 3.0) * np.array([np.cos(turn), np.sin(turn), 0.0])
    return lambda: None


def _old_scan(rig: Rig, rng: np.random.Generator) -> Tick:
    stamp = rig.stamp()
    return lambda: rig.say_scan(stamp=stamp)


def _nan_scan(rig: Rig, rng: np.random.Generator) -> Tick:
    bad = np.full(72, np.nan)
    bad[: rng.integers(36)] = 2.0
    return lambda: rig.say_scan(bad)


def _clock_back(rig: Rig, rng: np.random.Generator) -> Tick:
    rig.set_back(rng.uniform(0.5, 50.0))
    return lambda: None


def _reordered(rig: Rig, rng: np.random.Generator) -> Tick:
    held: list[Any] = []

    def tick() -> None:
        held.append((rig.pose, rig.stamp(), "odom", rig.twist))
        if len(held) == 4:
            for k in rng.permutation(4).tolist():
                rig.say_odometry(*held[k])
            held.clear()

    return tick


STANDS, RESPONSE = "odometry: the pose stands", "robot: the position does not"
CASES = {
    "planner killed": Case(0.25, "command: ", "command"),
    "command NaN": Case(0.0, "command: got", "command", _nan_command),
    "command in a wrong frame": Case(
        0.0, "command: frame 'map'", "command",
        lambda rig, rng: lambda: rig.say_command(rig.wanted, "map"),
    ),
    "odometry missing": Case(0.2, "odometry: ", "odometry"),
    "odometry repeated": Case(0.2, "odometry: ", "odometry", _repeated),
    "odometry later and later": Case(0.25, "odometry: |robot: ", "odometry", _late, again=2.8),
    "odometry NaN or far away": Case(0.0, "odometry: got", "odometry", _bad_odometry),
    "odometry in a wrong frame": Case(
        0.0, "odometry: frame 'map'", "odometry",
        lambda rig, rng: lambda: rig.say_odometry(frame="map"),
    ),
    "pose frozen": Case(0.35, f"{STANDS}|{RESPONSE}", "odometry", _frozen, again=2.5),
    "pose jumps": Case(0.02, "odometry: the pose has jumped", "", _jump, 0.4, lasts=0.15),
    "scan missing": Case(0.5, "scan: ", "scan"),
    "scan repeated": Case(0.5, "scan: ", "scan", _old_scan),
    "scan NaN": Case(0.0, "scan: ", "scan", _nan_scan),
    "scan in a wrong frame": Case(
        0.0, "scan: frame 'laser'", "scan", lambda rig, rng: lambda: rig.say_scan(frame="laser")
    ),
    "map missing": Case(0.9, "map: ", "map", again=0.4),
    "clock goes back": Case(0.0, "clock: has gone back", "", _clock_back, 0.3, lasts=STEP),
    # from the first reading on, which comes up to a tick later
    "clock stands": Case(0.15 + TICK, "clock: has stood still", clock=0.0),
    "duplicated": Case(
        None, "", "", lambda rig, rng: lambda: (rig.say_odometry(), rig.say_command(rig.wanted)),
    ),
    "reordered": Case(None, "", "odometry", _reordered),
    "30 % lost": Case(
        None, "", "odometry",
        lambda rig, rng: lambda: rig.say_odometry() if rng.random() > 0.3 else None,
    ),
}  # fmt: skip
"""name → fault."""


class Trial(NamedTuple):
    """What one trial showed."""

    in_time: bool  # at zero in time, and until the fault ends; of no fault, whether it moved
    stands: bool  # no farther than until the command of zero, and by braking after it
    named: bool  # the diagnostic contained the reason
    again: bool  # it moved again
    messages: tuple[str, ...]
    away: float  # from the fault on [m]; 0 of no fault


def try_case(name: str, seed: int) -> Trial:
    """Let one fault happen at a random time and speed."""
    case, rng = CASES[name], np.random.default_rng([seed, *name.encode()])
    raster = Raster(grid_of(0.1, (-10.0, -10.0, 0.0), 200, 200), np.zeros((200, 200), np.int16))

    def say_map(d: Drive) -> None:
        if d.ticks % 20 == 0:
            d.core.hear_source("map", d.core.of_grid("map", raster), d.now.ros, d.now, "odom")

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SafetyWarning)
        d = Drive(SOURCES, wanted=(rng.uniform(0.2, 0.9), 0.0, rng.uniform(-0.3, 0.3)))
        d.run(1.0 + TICK * float(rng.integers(20)), each=say_map)
        moved, first, ticks = _moves(d.commands[-1]), len(d.decisions), len(d.speeds)
        begun, tick = d.now.steady, case.tamper(d, rng) if case.tamper else lambda: None

        def each(d: Drive) -> None:
            tick()
            if case.without != "map":
                say_map(d)

        publishes = {what: case.without != what for what in ("odometry", "scan", "command")}
        lasts = 1.0 if case.within is None else case.lasts or case.within + 0.4
        d.run(lasts, clock=case.clock, each=each, **publishes)
        during, did, speeds = d.decisions[first:], d.commands[first:], d.speeds[ticks:]
        d.run(case.again + 0.5, each=say_map)
    messages = tuple(dict.fromkeys(one.message for _, one in during))
    again = moved and _moves(d.commands[-1])
    if case.within is None:
        return Trial(all(map(_moves, did)), True, True, again, messages, 0.0)
    zero = next((k for k, velocity in enumerate(did) if not _moves(velocity)), len(did))
    after = during[zero:]
    in_time = bool(after) and after[0][0].steady <= begun + case.within + STEP + 1e-6
    in_time = in_time and not any(map(_moves, did[zero:]))
    named = bool(after) and all(
        any(reason in one.message for reason in case.reason.split("|")) for _, one in after
    )
    away, fastest = TICK * sum(speeds), max(speeds)
    until = case.within + STEP + TICK
    stands = away <= fastest * until + fastest**2 / (2.0 * HARDEST[0]) + 1e-6
    return Trial(in_time, stands, named, again, messages, away)


def _moves(velocity: Array) -> bool:
    return float(np.abs(velocity).max()) > 1e-9


def lines(quick: bool) -> Iterator[str]:
    """Yield fault by fault how many trials passed."""
    trials = 3 if quick else 100
    yield f"{trials} trials each: in time, stands, named, again"
    for name in CASES:
        found = [try_case(name, seed) for seed in range(trials)]
        counts = [sum(bool(one[k]) for one in found) for k in range(4)]
        away = max(one.away for one in found)
        yield f"{name:26} {' '.join(f'{n:4}' for n in counts)}   {away:.2f} m"
        for seed, one in enumerate(found):
            if not all(one[:4]):
                yield f"   MISS seed {seed}: {one[:4]} {str(one.messages)[:200]}"
