"""Fault by fault on the node's core: zero in time, the reason named, on again when it has gone."""

import warnings
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from benchmarks.ros.drive import ANGLES, HARDEST, SCAN, TICK, Drive
from hcbf_gym.arrays import Array
from hcbf_gym.errors import SafetyWarning
from hcbf_robots.maps.nav2 import Raster
from hcbf_robots.ros.sources import grid_of
from hcbf_robots.ros.watches import Now

Rng = np.random.Generator
STEP = 0.05
"""A period of the node [s]."""
MAP = {
    "observation_sources": ["map"],
    "map.type": "map",
    "map.topic": "map",
    "map.unknown": 0,
    "map.source_timeout": 0.6,
}


class Case(NamedTuple):
    """One fault.

    Attributes:
        does: lets it happen for a while, and returns when it began [s of the steady clock].
        within: after which the robot is at zero, with a period more; None: it goes on.
        reason: what the diagnostic must hold; one of several with | between.
        given: parameters beside the robot's.
        again: after which it moves again when all is well [s].
        lasts: whether the reason is named for as long as the robot stands.
    """

    does: Callable[[Drive, Rng], float]
    within: float | None
    reason: str
    given: Mapping[str, Any] = MappingProxyType({})
    again: float = 0.2
    lasts: bool = True


def _planner_killed(d: Drive, rng: Rng) -> float:
    begun = d.now.steady
    d.run(0.8, command=False)
    return begun


def _nan_command(d: Drive, rng: Rng) -> float:
    bad = [np.nan, np.inf, -np.inf][rng.integers(3)]

    def each(d: Drive) -> None:
        if d.ticks % 5 == 0:
            d.core.hear_command((bad, 0.0, 0.0), d.now, d.now.ros)

    begun = d.now.steady
    d.run(0.6, command=False, each=each)
    return begun


def _command_frame(d: Drive, rng: Rng) -> float:
    begun = d.now.steady
    d.run(
        0.6,
        command=False,
        each=lambda d: d.core.hear_command(d.wanted, d.now, d.now.ros, "map"),
    )
    return begun


def _no_odometry(d: Drive, rng: Rng) -> float:
    begun = d.now.steady
    d.run(0.8, odometry=False)
    return begun


def _stale_odometry(d: Drive, rng: Rng) -> float:
    begun, stamp, pose = d.now.steady, d.now.ros, d.pose
    d.run(0.8, odometry=False, each=lambda d: d.say_odometry(pose, stamp))
    return begun


def _late_odometry(d: Drive, rng: Rng) -> float:
    """Its stamps stay behind by more and more."""
    begun, since = d.now.steady, d.now.ros

    def each(d: Drive) -> None:
        d.say_odometry(stamp=since + 0.1 * (d.now.ros - since))

    d.run(1.0, odometry=False, each=each)
    return begun


def _nan_odometry(d: Drive, rng: Rng) -> float:
    begun, k = d.now.steady, int(rng.integers(6))
    bad = [np.nan, np.inf, 1e9][rng.integers(3)]

    def each(d: Drive) -> None:
        numbers = np.array([*d.pose, d.velocity[0], 0.0, d.velocity[1]])
        numbers[k] = bad
        d.say_odometry(numbers[:3], twist=numbers[3:])

    d.run(0.6, odometry=False, each=each)
    return begun


def _odometry_frame(d: Drive, rng: Rng) -> float:
    begun = d.now.steady
    d.run(0.6, odometry=False, each=lambda d: d.say_odometry(frame="map"))
    return begun


def _frozen_pose(d: Drive, rng: Rng) -> float:
    begun, pose, twist = d.now.steady, d.pose, (d.velocity[0], 0.0, d.velocity[1])
    d.run(0.8, odometry=False, each=lambda d: d.say_odometry(pose, twist=twist))
    return begun


def _jump(d: Drive, rng: Rng) -> float:
    begun, turn = d.now.steady, rng.uniform(-np.pi, np.pi)
    d.pose = d.pose + rng.uniform(0.4, 3.0) * np.array([np.cos(turn), np.sin(turn), 0.0])
    d.run(0.15)
    return begun


def _no_scan(d: Drive, rng: Rng) -> float:
    begun = d.now.steady
    d.run(1.2, scan=False)
    return begun


def _stale_scan(d: Drive, rng: Rng) -> float:
    begun, stamp = d.now.steady, d.now.ros
    d.run(1.2, scan=False, each=lambda d: d.say_scan(stamp=stamp))
    return begun


def _nan_scan(d: Drive, rng: Rng) -> float:
    begun, bad = d.now.steady, np.full(ANGLES.size, np.nan)
    bad[: rng.integers(ANGLES.size // 2)] = 2.0
    d.run(0.6, scan=False, each=lambda d: d.say_scan(bad))
    return begun


def _scan_frame(d: Drive, rng: Rng) -> float:
    begun = d.now.steady
    d.run(0.6, scan=False, each=lambda d: d.say_scan(frame="laser"))
    return begun


def _say_map(d: Drive) -> None:
    if d.ticks % 20 == 0:
        raster = Raster(grid_of(0.1, (-20.0, -20.0, 0.0), 400, 400), np.zeros((400, 400), np.int16))
        d.core.hear_source("map", d.core.of_grid("map", raster), d.now.ros, d.now, "odom")


def _no_map(d: Drive, rng: Rng) -> float:
    begun = d.now.steady
    d.run(1.2)
    return begun


def _clock_back(d: Drive, rng: Rng) -> float:
    begun = d.now.steady
    d.now = Now(d.now.ros - rng.uniform(0.1, 100.0), d.now.steady)
    d.run(0.05, odometry=False)
    return begun


def _clock_stands(d: Drive, rng: Rng) -> float:
    begun = d.now.steady
    d.run(0.8, clock=0.0)
    return begun


def _duplicated(d: Drive, rng: Rng) -> float:
    def each(d: Drive) -> None:
        d.say_odometry()
        d.core.hear_command(d.wanted, d.now, d.now.ros)

    begun = d.now.steady
    d.run(1.0, each=each)
    return begun


def _reordered(d: Drive, rng: Rng) -> float:
    held: list[tuple[Any, ...]] = []

    def each(d: Drive) -> None:
        held.append((d.pose, d.now.ros, (d.velocity[0], 0.0, d.velocity[1])))
        if len(held) == 4:
            for k in rng.permutation(4).tolist():
                d.say_odometry(held[k][0], held[k][1], twist=held[k][2])
            held.clear()

    begun = d.now.steady
    d.run(1.0, odometry=False, each=each)
    return begun


def _lost(d: Drive, rng: Rng) -> float:
    def each(d: Drive) -> None:
        if d.ticks % 2 == 0 and rng.random() > 0.3:
            d.say_odometry()
        if d.ticks % 5 == 0 and rng.random() > 0.3:
            d.core.hear_command(d.wanted, d.now, d.now.ros)
        if d.ticks % 10 == 0 and rng.random() > 0.3:
            d.say_scan()

    begun = d.now.steady
    d.run(1.0, odometry=False, command=False, scan=False, each=each)
    return begun


_SCAN = {**SCAN, "source_timeout": 0.5}
CASES = {
    "planner killed": Case(_planner_killed, 0.25, "command: "),
    "command NaN": Case(_nan_command, 0.05, "command: got"),
    "command in a wrong frame": Case(_command_frame, 0.0, "command: frame 'map'"),
    "odometry missing": Case(_no_odometry, 0.2, "odometry: "),
    "odometry repeated": Case(_stale_odometry, 0.2, "odometry: "),
    "odometry later and later": Case(
        _late_odometry, 0.25, "odometry: |robot: the position does not", again=2.8
    ),
    "odometry NaN or far away": Case(_nan_odometry, 0.0, "odometry: got"),
    "odometry in a wrong frame": Case(_odometry_frame, 0.0, "odometry: frame 'map'"),
    "pose frozen": Case(
        _frozen_pose, 0.35, "odometry: the pose stands|robot: the position does not", again=2.5
    ),
    "pose jumps": Case(_jump, 0.02, "odometry: the pose has jumped", again=0.4),
    "scan missing": Case(_no_scan, 0.5, "scan: ", _SCAN),
    "scan repeated": Case(_stale_scan, 0.5, "scan: ", _SCAN),
    "scan NaN": Case(_nan_scan, 0.0, "scan: ", _SCAN),
    "scan in a wrong frame": Case(_scan_frame, 0.0, "scan: frame 'laser'", _SCAN),
    "map missing": Case(_no_map, 0.6, "map: ", MAP, again=0.3),
    "clock goes back": Case(_clock_back, 0.0, "clock: has gone back", again=0.3, lasts=False),
    # from the first reading on, which comes up to a tick later
    "clock stands": Case(_clock_stands, 0.15 + TICK, "clock: has stood still"),
    "duplicated": Case(_duplicated, None, "", _SCAN),
    "reordered": Case(_reordered, None, "", _SCAN),
    "30 % lost": Case(_lost, None, "", _SCAN),
}
"""name → fault."""


class Trial(NamedTuple):
    """What one trial showed.

    Attributes:
        in_time: whether the robot was at zero in time, and stayed it while the fault lasted; of
            what is no fault, whether it went on.
        stands: whether it went no farther from the fault on than until it is told zero, and then
            to stop at its accelerations.
        named: whether the diagnostic held the reason.
        again: whether it went on by itself.
        says: the diagnostics, for people.
        away: how far it went [m]; 0 of what is no fault.
    """

    in_time: bool
    stands: bool
    named: bool
    again: bool
    says: tuple[str, ...]
    away: float


def try_case(name: str, seed: int) -> Trial:
    """Let one fault happen at a random time and speed."""
    case, rng = CASES[name], np.random.default_rng([seed, *name.encode()])
    each = _say_map if case.given is MAP else None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SafetyWarning)
        d = Drive(case.given, wanted=(rng.uniform(0.2, 0.9), 0.0, rng.uniform(-0.3, 0.3)))
        d.run(1.0 + TICK * float(rng.integers(20)), each=each)
        moved, first = _moves(d.told[-1]), len(d.decisions)
        ticks = len(d.speeds)
        begun = case.does(d, rng)
        during, did, speeds = d.decisions[first:], d.told[first:], d.speeds[ticks:]
        d.run(case.again, each=each)
        d.run(0.5, each=each)
    says = tuple(dict.fromkeys(one.says for _, one in during))
    again = moved and _moves(d.told[-1])
    if case.within is None:
        return Trial(all(map(_moves, did)), True, True, again, says, 0.0)
    zero = next((k for k, velocity in enumerate(did) if not _moves(velocity)), len(did))
    after = during[zero:]
    in_time = bool(after) and after[0][0].steady <= begun + case.within + STEP + 1e-6
    in_time = in_time and not any(map(_moves, did[zero:]))
    told = [one for _, one in (after if case.lasts else after[:1])]
    reasons = case.reason.split("|")
    named = all(any(reason in one.says for reason in reasons) for one in told)
    away, fastest = TICK * sum(speeds), max(speeds)
    until = case.within + STEP + TICK
    stands = away <= fastest * until + fastest**2 / (2.0 * HARDEST[0]) + 1e-6
    return Trial(in_time, stands, bool(told) and named, again, says, away)


def _moves(velocity: Array) -> bool:
    """Return whether the base moves."""
    return float(np.abs(velocity).max()) > 1e-9
