"""Scans of walls: what is reported, entered and reached.

Robots drive behind `VelocityFilter` in rooms that they see by a scan at 10 Hz, at every angle to
the world's axes. Entries are judged by the exact geometry.
"""

import math
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import tyro

from benchmarks.own_loop import LONGEST, Driven, Moving, Planner, Rig, hostile, loop
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, ConvexPolygon, HalfPlane
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.programs import FilterStatus
from hcbf_robots import VelocityFilter
from hcbf_robots.maps import Scan, points_of
from hcbf_robots.walkers import Walker

PERIOD, RANGE = 0.1, 10.0  # From one scan to the next [s], and how far beams reach [m]
SIDE = 4.0  # From the middle of a room to its walls [m]
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
GO1 = "tests/robots/contracts/go1.json"
ROBOTS = {"cart": "cart", "holonomic cart": "holonomic-cart", "Go1": GO1}
NEAR = 0.35  # Of the goal [m]


class Case(NamedTuple):
    """How a room is seen."""

    # all around; 0 where the filter knows the walls, to see what is the robot's own
    beams: int = 360
    error: float = 0.0  # standard deviation of a range [m]
    dropped: float = 0.0  # share of beams that see nothing
    speed: float = 0.0  # that the scan reserves for [m/s]
    rests: bool = False  # whether the robot drives at a wall and stays there


CASES = {
    "no scan": Case(0),
    "perfect": Case(),
    "speed .5 m/s": Case(speed=0.5),
    "noise 1 cm": Case(error=0.01),
    "noise 2 cm": Case(error=0.02),
    "72 beams": Case(72),
    "30 % dropped": Case(dropped=0.3),
    "at rest, no scan": Case(0, rests=True),
    "at rest": Case(rests=True),
    "at rest, noise 1 cm": Case(error=0.01, rests=True),
}


class Room(NamedTuple):
    """Walls and boxes."""

    walls: list[Barrier]  # as barriers
    edges: Array  # (k, 2, 2) of them [m]


def room_of(seed: int, boxes: int = 6) -> Room:
    """Return a room of 8 m with boxes, none at its middle, turned by the seed."""
    rng = np.random.default_rng([12, seed])
    yaw = rng.uniform(-math.pi, math.pi)
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    inside = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)]
    walls: list[Barrier] = [
        HalfPlane(f"wall {k}", 1, tuple((np.array(n) @ turn).tolist()), -SIDE)
        for k, n in enumerate(inside)
    ]
    outlines = [SIDE * SQUARE @ turn]
    while len(outlines) <= boxes:
        center, half = rng.uniform(-3.2, 3.2, 2), rng.uniform(0.2, 0.6, 2)
        if float(np.hypot(*center)) > 1.3 + float(np.hypot(*half)) - 0.3:
            corners = (center + half * SQUARE) @ turn
            outlines.append(corners)
            name = f"box {len(outlines) - 2}"
            walls.append(ConvexPolygon(name, 1, tuple((x, y) for x, y in corners.tolist())))
    edges = [np.stack([one, np.roll(one, -1, axis=0)], axis=1) for one in outlines]
    return Room(walls, np.concatenate(edges))


def ranges_of(edges: Array, pose: Array, angles: Array, reach: float = RANGE) -> Array:
    """Return (k,) how far beams go until an edge [m]; +inf beyond their reach."""
    beams = np.column_stack([np.cos(angles + pose[2]), np.sin(angles + pose[2])])
    to, along = edges[:, 0] - pose[:2], edges[:, 1] - edges[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        across = np.cross(beams[:, None], along)
        far = np.cross(to, along) / across
        part = np.cross(to, beams[:, None]) / across
        far = np.where((far > 0.0) & (part >= 0.0) & (part <= 1.0), far, np.inf)
    nearest = far.min(axis=1, initial=np.inf)
    return np.where(nearest < reach, nearest, np.inf)


class Laser:
    """A scan at 10 Hz that a filter takes as it comes."""

    def __init__(
        self, safe: VelocityFilter, case: Case, edges: Array, known: Sequence[Any], seed: int
    ):
        self._filter, self._case, self._edges, self._known = safe, case, edges, known
        self._rng, self._due = np.random.default_rng([13, seed]), -math.inf
        self._angles = np.linspace(-math.pi, math.pi, case.beams, endpoint=False)

    def sees(self, now: float, robot: Moving) -> None:
        """Take a scan where one is due."""
        if now < self._due - 1e-9:
            return
        self._due = now + PERIOD
        case, rng, pose = self._case, self._rng, robot.pose
        ranges = ranges_of(self._edges, pose, self._angles)
        ranges = np.maximum(ranges + case.error * rng.standard_normal(case.beams), 0.0)
        ranges[rng.random(case.beams) < case.dropped] = np.inf
        scan = Scan(
            "scan", points_of(ranges, self._angles), tuple(pose.tolist()), PERIOD, case.speed,
            noise=3.0 * case.error,
        )  # fmt: skip
        self._filter.set_barriers([*self._known, scan], look=False)


def goal_of(room: Room, reach: float, seed: int) -> Array:
    """Return (2,) a goal that is some metres off, with room around it [m]."""
    rng, regions = np.random.default_rng([14, seed]), BarrierSet([room.walls])
    while True:
        at = rng.uniform(-3.5, 3.5, 2)
        x = np.array([[*at, 0.0, 0.0]])
        if np.hypot(*at) > 2.5 and regions.values(x, np.zeros(1)).min() > reach + 0.25:
            return at


class Place(NamedTuple):
    """Who drives where."""

    walker: Walker
    case: Case
    room: Room
    seed: int

    def drive(
        self, known: Sequence[Barrier], scans: bool, planner: Planner, seconds: float, goal: Any
    ) -> Driven:
        """Drive behind what the filter knows, and a scan, as far as the goal (None: none)."""
        walker, case, room, seed = self
        guided = {} if goal is None else {"goal": goal, "guidance": "geodesic"}
        safe = VelocityFilter(walker, known, period=LONGEST, **guided)
        rig = Rig(walker.reach, walls=room.walls)
        if scans:
            rig = rig._replace(sees=Laser(safe, case, room.edges, known, seed).sees)
        robot = Moving(walker, np.zeros(3), seed)
        return loop(safe, robot, planner, seconds, seed, rig, lambda pose: is_at(goal, pose))


def is_at(goal: Any, pose: Array) -> bool:
    """Return whether a robot is near its goal, if it has one."""
    return goal is not None and float(np.hypot(*(pose[:2] - goal))) < NEAR


def walls(robot: str, name: str, count: int, seconds: float) -> str:
    """Return what hostile drives behind a scan alone showed, and who arrives beside a map."""
    case, walker, arrived, runs = CASES[name], Walker.load(ROBOTS[robot]), [0, 0], []
    guided, guides = np.zeros(len(FilterStatus), dtype=int), case.beams and not case.rests
    for seed in range(count):
        place = Place(walker, case, room := room_of(seed), seed)
        rng = np.random.default_rng([15, seed])
        planner = hostile(room.walls, walker.command, rng, wanders=not case.rests)
        known = () if case.beams else room.walls
        runs.append(place.drive(known, bool(case.beams), planner, seconds, None))
        if not guides:
            continue
        goal = goal_of(room, walker.reach, seed)
        for scans in (False, True):
            run = place.drive(room.walls, scans, lambda _: 0.0 * walker.command.limits, 25.0, goal)
            arrived[scans] += is_at(goal, run.path[-1])
            guided += run.statuses if scans else 0
    statuses = np.sum([run.statuses for run in runs], axis=0)
    arrivals = "" if not guides else f", guided {share(guided)}, arrive {arrived[0]} → {arrived[1]}"
    alarms = sum(bool(run.alarms) for run in runs)
    return (
        f"{robot}: {name}: {share(statuses)} of steps VIOLATED or UNSAFE, "
        f"{sum(run.least < 0.0 for run in runs)} of {count} entered, least "
        f"{min(run.least for run in runs):+.3f} m, alarms {alarms}, "
        f"fell {sum(run.fell for run in runs)}{arrivals}; statuses {statuses}"
    )


def share(statuses: Array) -> str:
    """Return the share of steps that are VIOLATED or worse."""
    bad = statuses[int(FilterStatus.VIOLATED) :].sum()
    return f"{100.0 * bad / statuses.sum():.2f} %"


def main(
    robots: tuple[str, ...] = tuple(ROBOTS),
    cases: tuple[str, ...] = tuple(CASES),
    count: int = 20,
    seconds: float = 20.0,
) -> None:
    """Print what is seen.

    Args:
        robots: names of `ROBOTS`.
        cases: names of `CASES`.
        count: drives a row.
        seconds: of each.
    """
    warnings.simplefilter("ignore")
    for robot in robots:
        for case in cases:
            print(f"walls: {walls(robot, case, count, seconds)}", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
