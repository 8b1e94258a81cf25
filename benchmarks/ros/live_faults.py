"""Fault by fault through real rclpy: the node in a process of its own, on a clock of the robot's.

    python -m benchmarks.ros.live_faults [trials]

The cases are those of `faults`; planner, odometry, scan, map and /clock are this process. Zero is
told in time, with its reason, and the node goes on by itself. Three trials take six minutes.
"""
# pyright: reportMissingImports=false

import math
import os
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rclpy
from lifecycle_msgs.msg import Transition
from nav_msgs.msg import OccupancyGrid

from benchmarks.ros.rig import ALONE, PERIOD, SLACK, Base, Planner, process
from hcbf_robots.ros.running import LATCHED

PARAMETERS = """hcbf_filter:
  ros__parameters:
    use_sim_time: true
    max_forward: 1.0
    max_turn: 2.0
    look_ahead: 0.2
    reach: 0.3
    observation_sources: [laser, map]
    laser: {type: scan, topic: scan, source_timeout: 0.5}
    map: {type: map, topic: map, unknown: 0, source_timeout: 0.9}
"""
WANTED = 0.3, 0.4
TICK = 0.02
"""Of the base [s]."""
HELD_UP = 0.1
"""A trial in which the machine held this process up for longer is repeated: that is a fault [s]."""


class Rig:
    """A planner, a base and a map, all heard by the node."""

    def __init__(self) -> None:
        self.planner = Planner()
        self.base = self.planner.base = Base(self.planner, clock=1000.0)
        self._map = self.planner.create_publisher(OccupancyGrid, "map", LATCHED)
        self.map = True
        self.planner.create_timer(0.3, self._say_map)
        self.rng = np.random.default_rng(41)

    def _say_map(self) -> None:
        if self.map:
            message = OccupancyGrid(data=[0] * 40_000)
            message.header.stamp, message.header.frame_id = self.base.stamp(), "odom"
            message.info.resolution, message.info.width, message.info.height = 0.1, 200, 200
            message.info.origin.position.x = message.info.origin.position.y = -10.0
            self._map.publish(message)

    @property
    def twist(self) -> tuple[float, float]:
        """(v, ω) of the base."""
        return self.base.velocity


class Case(NamedTuple):
    """One fault through rclpy.

    Attributes:
        within: after which zero is told [s], with a period and what messages take; None: no fault.
        reason: what the diagnostic holds; one of several with | between.
        begins: lets it begin; returns what ends it.
        again: after which it moves again, at most [s].
        lasts: whether it does; else zero is told at once, and it goes on.
    """

    within: float | None
    reason: str
    begins: Callable[[Rig], Callable[[], None]]
    again: float = 1.0
    lasts: bool = True


def _odometry(tamper: Callable[[Rig], Callable[[], None]]) -> Callable[[Rig], Callable[[], None]]:
    """Return what replaces the odometry for a while."""

    def begins(rig: Rig) -> Callable[[], None]:
        base = rig.base
        base.odometry, base.tamper = False, tamper(rig)

        def ends() -> None:
            base.odometry, base.tamper = True, lambda: None

        return ends

    return begins


def _scan(tamper: Callable[[Rig], Callable[[], None]]) -> Callable[[Rig], Callable[[], None]]:
    """Likewise of the scan."""

    def begins(rig: Rig) -> Callable[[], None]:
        base = rig.base
        base.scan, base.tamper = False, tamper(rig)

        def ends() -> None:
            base.scan, base.tamper = True, lambda: None

        return ends

    return begins


def _nothing(rig: Rig) -> Callable[[], None]:
    return lambda: None


def _repeated(rig: Rig) -> Callable[[], None]:
    base, stamp, pose = rig.base, rig.base.stamp(), rig.base.pose
    return lambda: base.say_odometry(pose, stamp=stamp)


def _later(rig: Rig) -> Callable[[], None]:
    base, past = rig.base, deque[Any]()

    def tamper() -> None:
        past.append((base.pose, base.stamp()))
        pose, stamp = past[len(past) // 8]  # as if the link were eight times too slow
        base.say_odometry(pose, stamp=stamp)

    return tamper


def _bad(rig: Rig) -> Callable[[], None]:
    base, bad = rig.base, (math.nan, math.inf, 1e9)[int(rig.rng.integers(3))]
    if rig.rng.random() < 0.5:
        return lambda: base.say_odometry(twist=(bad, 0.0))
    return lambda: base.say_odometry(pose=(bad, 0.0, 0.0))


def _frozen(rig: Rig) -> Callable[[], None]:
    base, pose, twist = rig.base, rig.base.pose, rig.twist
    return lambda: base.say_odometry(pose, twist)


def _jump(rig: Rig) -> Callable[[], None]:
    rig.base.pose = rig.base.pose + np.array([rig.rng.uniform(0.6, 2.0), 0.0, 0.0])
    return lambda: None


def _planner(**changes: Any) -> Callable[[Rig], Callable[[], None]]:
    """Return what changes the planner for a while."""

    def begins(rig: Rig) -> Callable[[], None]:
        before = {key: getattr(rig.planner, key) for key in changes}
        for key, value in changes.items():
            setattr(rig.planner, key, value)

        def ends() -> None:
            for key, value in before.items():
                setattr(rig.planner, key, value)

        return ends

    return begins


def _old_scan(rig: Rig) -> Callable[[], None]:
    base, stamp = rig.base, rig.base.stamp()
    return lambda: base.say_scan(stamp=stamp)


def _no_map(rig: Rig) -> Callable[[], None]:
    rig.map = False

    def ends() -> None:
        rig.map = True

    return ends


def _clock_back(rig: Rig) -> Callable[[], None]:
    assert rig.base.clock is not None
    rig.base.clock -= rig.rng.uniform(0.5, 50.0)
    return lambda: None


def _clock_stands(rig: Rig) -> Callable[[], None]:
    rig.base.rate = 0.0

    def ends() -> None:
        rig.base.rate = 1.0

    return ends


def _tampered(tamper: Callable[[Rig], Callable[[], None]]) -> Callable[[Rig], Callable[[], None]]:
    """Return what comes besides, for a while."""

    def begins(rig: Rig) -> Callable[[], None]:
        rig.base.tamper = tamper(rig)

        def ends() -> None:
            rig.base.tamper = lambda: None

        return ends

    return begins


def _twice(rig: Rig) -> Callable[[], None]:
    def tamper() -> None:
        rig.base.say_odometry()
        rig.planner.say(WANTED)

    return tamper


def _reordered(rig: Rig) -> Callable[[], None]:
    base, held = rig.base, list[Any]()

    def tamper() -> None:
        held.append((base.pose, base.stamp(), rig.twist))
        if len(held) == 4:
            for k in rig.rng.permutation(4).tolist():
                base.say_odometry(held[k][0], held[k][2], held[k][1])
            held.clear()

    return tamper


def _lost(rig: Rig) -> Callable[[], None]:
    base = rig.base

    def tamper() -> None:
        if rig.rng.random() > 0.3:
            base.say_odometry()

    return tamper


CASES = {
    "planner killed": Case(0.25, "command: ", _planner(wants=None)),
    "command NaN": Case(0.05, "command: got", _planner(wants=lambda: (math.nan, 0.0))),
    "command in a wrong frame": Case(0.05, "command: frame 'map'", _planner(frame="map")),
    "odometry missing": Case(0.2, "odometry: ", _odometry(_nothing)),
    "odometry repeated": Case(0.2, "odometry: ", _odometry(_repeated)),
    "odometry later and later": Case(0.3, "odometry: |robot: ", _odometry(_later), 4.0),
    "odometry NaN or far away": Case(TICK, "odometry: got", _odometry(_bad)),
    "odometry in a wrong frame": Case(
        TICK, "odometry: frame 'map'",
        _odometry(lambda rig: lambda: rig.base.say_odometry(frame="map")),
    ),
    "pose frozen": Case(0.4, "odometry: the pose stands|robot: ", _odometry(_frozen), 4.0),
    "pose jumps": Case(TICK, "odometry: the pose has jumped", _jump, lasts=False),
    "scan missing": Case(0.5, "laser: ", _scan(_nothing)),
    "scan repeated": Case(
        0.5, "laser: ",
        _scan(_old_scan),
    ),
    "scan NaN": Case(0.1, "laser: ", _scan(lambda rig: lambda: rig.base.say_scan(math.nan))),
    "scan in a wrong frame": Case(
        0.1, "laser: frame 'lidar'", _scan(lambda rig: lambda: rig.base.say_scan(frame="lidar"))
    ),
    "map missing": Case(0.9, "map: ", _no_map),
    "clock goes back": Case(TICK, "clock: has gone back", _clock_back, lasts=False),
    "clock stands": Case(0.15 + TICK, "clock: has stood still", _clock_stands),
    "duplicated": Case(None, "", _tampered(_twice)),
    "reordered": Case(None, "", _odometry(_reordered)),
    "30 % lost": Case(None, "", _odometry(_lost)),
}  # fmt: skip
"""name → fault; of lost messages, odometry's."""


def try_case(rig: Rig, name: str) -> str:
    """Let one fault happen; return "" if all is well, else what is not."""
    case, planner = CASES[name], rig.planner
    planner.spin(0.3 + rig.rng.uniform(0.0, 0.1))
    if not planner.spin(3.0, planner.moving):
        return f"stands before: {planner.says}"
    says: list[str] = []
    planner.heard = says.append
    begun = time.monotonic()
    ends = case.begins(rig)
    until = 1.2 if case.within is None else case.within + PERIOD + SLACK + 0.3
    planner.spin(until)
    told = [one for one in planner.told if one[0] > begun]
    ends()
    if case.within is None:
        zeros = sum(not any(one[1:]) for one in told)
        return f"{zeros} of {len(told)} zero: {planner.says}" if zeros or not told else ""
    zero = next((k for k, one in enumerate(told) if not any(one[1:])), None)
    if zero is None:
        return f"never zero in {len(told)} messages"
    late = told[zero][0] - begun
    wrong = []
    if late > case.within + PERIOD + SLACK:
        wrong.append(f"zero after {late:.2f} s")
    if case.lasts and any(any(one[1:]) for one in told[zero:]):
        wrong.append(f"moves again, says {says}")
    if not any(reason in one for reason in case.reason.split("|") for one in says):
        wrong.append(f"says {says}")
    if not planner.spin(case.again, planner.moving):
        wrong.append(f"stands after: {planner.says}")
    planner.spin(3.0, planner.moving)
    return "; ".join(wrong)


def main(trials: int = 3) -> int:
    """Run all, print how many trials of each passed, and return how many did not."""
    begun, missed = time.monotonic(), 0
    os.environ.update(ALONE)
    rclpy.init()
    rig = Rig()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "filter.yaml").write_text(PARAMETERS, encoding="utf-8")
        with process(folder, "node", "ros", "--params", str(folder / "filter.yaml")):
            assert rig.planner.change(Transition.TRANSITION_CONFIGURE), (
                folder / "node.log"
            ).read_text("utf-8")
            assert rig.planner.change(Transition.TRANSITION_ACTIVATE)
            rig.planner.wants = lambda: WANTED
            assert rig.planner.spin(10.0, rig.planner.moving), rig.planner.says
            for case in CASES:
                wrong, held = [], 0
                while len(wrong) < trials and held < 10 * trials:
                    rig.base.longest = 0.0
                    says = try_case(rig, case)
                    if rig.base.longest > HELD_UP:
                        held += 1
                    else:
                        wrong.append(says)
                passed = wrong.count("")
                missed += trials - passed
                again = f"({held} again)" if held else ""
                print(f"{case:26} {passed} of {trials}", again, *filter(None, wrong), flush=True)
    rig.planner.destroy_node()
    rclpy.try_shutdown()
    print(f"{time.monotonic() - begun:.0f} s")
    return missed


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])) > 0)
