"""Starts between obstacles and inside zones, zones that appear around the robot: time until out."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from benchmarks.ros.drive import TICK
from benchmarks.ros.ride import Ride, pursuit
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import ConvexPolygon
from hcbf_gym.errors import InvalidInputError
from hcbf_robots.ros import sources
from hcbf_robots.walkers import Walker

Corners = list[tuple[float, float]]
STILL, LONGEST_STILL = (0.02, 0.15), 1.0
"""A robot within them is at rest [m, rad], also if it turns to and fro; and for how long [s]."""
SPARE = 3.0
"""Time beside that of the path and the turn [s]."""
DEEP = 0.5
"""From the start between obstacles to their mouth [m]."""
SPEED = 0.6
"""Of the planner [m/s]."""
KINDS = ("between obstacles", "inside a zone", "a zone appears")


class Scene(NamedTuple):
    """Where a robot is, and what is around it."""

    kind: str  # of `KINDS`
    robot: str  # a contract's name
    rank: int  # of the zones
    start: Array  # x, y [m] and yaw [rad]
    goal: tuple[float, float]  # of the planner and of guidance [m]
    zones: list[Corners]
    comes: float  # when they do [s]
    mouth: float | None  # direction out of the obstacles [rad]; None for the zone's nearest edge


class Exit(NamedTuple):
    """How a robot got out."""

    out: float  # after which it touched no zone any more, from their appearance on [s]
    allowed: float  # the time for that [s]
    still: float  # the longest time at rest before the goal [s]
    led: bool  # whether guidance found a path; else it may stand
    arrived: bool  # at the goal within a minute

    @property
    def is_well(self) -> bool:
        """Whether it was out in time and did not stand."""
        return self.out <= self.allowed and (self.still <= LONGEST_STILL or not self.led)


def scene(kind: str, robot: str, rank: int, seed: int) -> Scene:
    """Draw a scene."""
    rng = np.random.default_rng([38, KINDS.index(kind), rank, seed])
    turn, away = rng.uniform(-math.pi, math.pi, 2)
    goal = (4.5 * math.cos(away), 4.5 * math.sin(away))
    yaw = rng.uniform(-math.pi, math.pi)
    if kind == "between obstacles":
        half = 0.34 + rng.uniform(0.07, 0.2)
        boxes = [
            [(-1.0, half), (DEEP, half), (DEEP, half + 0.4), (-1.0, half + 0.4)],
            [(-1.0, -half - 0.4), (DEEP, -half - 0.4), (DEEP, -half), (-1.0, -half)],
            [(-half - 0.6, -half), (-half, -half), (-half, half), (-half - 0.6, half)],
        ]
        zones = [_turned(box, turn) for box in boxes]
        return Scene(kind, robot, 1, np.array([0.0, 0.0, yaw]), goal, zones, 0.0, turn)
    sides = rng.uniform(0.5, 1.2, 2)
    a, b = sides.tolist()
    box = [(-a, -b), (a, -b), (a, b), (-a, b)]
    x, y = (sides * rng.uniform(-0.9, 0.9, 2)).tolist()
    at = _turned([(x, y)], turn)[0]
    start = np.array([*at, yaw])
    comes = 0.0 if kind == "inside a zone" else float(rng.uniform(0.8, 1.5))
    return Scene(kind, robot, rank, start, goal, [_turned(box, turn)], comes, None)


def _turned(corners: Corners, turn: float) -> Corners:
    cos, sin = math.cos(turn), math.sin(turn)
    return [(cos * x - sin * y, sin * x + cos * y) for x, y in corners]


def left(zones: list[Corners], place: Array) -> tuple[float, Array]:
    """Return the least signed distance from zones [m], and the direction in which it grows."""
    point = np.array([*place[:2], 0.0, 0.0])
    jets = [ConvexPolygon("zone", 1, tuple(corners)).jet(point) for corners in zones]
    least = min(jets, key=lambda jet: jet.h)
    return float(least.h), least.gradient[:2]


def drive(one: Scene) -> Exit:
    """Drive a scene with the node, guidance on, for a minute at most."""
    names = [f"zone{k}" for k in range(len(one.zones))]
    given: dict[str, object] = {"observation_sources": names, "guidance": "geodesic"}
    for name in names:
        given |= {f"{name}.type": "polygon", f"{name}.topic": name, f"{name}.priority": one.rank}
    d = Ride(pursuit([one.goal], SPEED), given, one.robot, start=one.start)
    for name in names:  # there is nothing yet
        d.core.hear_source(name, (), d.now.ros, d.now, "odom")
    d.run(0.1, command=False)
    d.core.take(d.core.planned(one.goal))
    d.run(one.comes)
    moved = d.pose[:2] - one.start[:2]
    zones = [[(x + moved[0], y + moved[1]) for x, y in corners] for corners in one.zones]
    for name, corners in zip(names, zones, strict=True):
        shown = sources.of_polygon(d.core.sources[name].settings, corners)
        d.core.hear_source(name, shown, d.now.ros, d.now, "odom")
    led = _plan(d, one.goal)
    allowed = _allowed(one, zones, d)
    begun, out, since, longest, stood = d.ticks, math.inf, d.ticks, 0, d.pose
    while d.ticks - begun < 60.0 / TICK and math.dist(d.pose[:2], one.goal) > 0.35:
        d.run(TICK)
        if out == math.inf and _is_out(one, zones, d.pose, d.reach):
            out = TICK * (d.ticks - begun)
        x, y, yaw = d.pose - stood
        if math.hypot(x, y) > STILL[0] or abs(math.remainder(yaw, math.tau)) > STILL[1]:
            since, stood = d.ticks, d.pose
        longest = max(longest, d.ticks - since)
    return Exit(out, allowed, TICK * longest, led, math.dist(d.pose[:2], one.goal) <= 0.35)


def _plan(d: Ride, goal: tuple[float, float]) -> bool:
    """Let guidance look at the zones, as the node's other thread does; return whether it leads."""
    try:
        d.core.take(d.core.planned(goal))
    except InvalidInputError:
        d.core.take(d.core.planned(None))
    return d.core.goal is not None


def _allowed(one: Scene, zones: list[Corners], d: Ride) -> float:
    """Return the time for the way out at the planner's speed [s].

    A cart turns besides until its heading, ahead or back, is the way's.
    """
    h, direction = left(zones, d.pose)
    way, turn = d.reach - h, math.atan2(direction[1], direction[0])
    if one.mouth is not None:
        way, turn = DEEP + d.reach, one.mouth
    off = abs(math.remainder(turn - d.pose[2], math.pi))
    most = float(d.core.settings.max_turn or Walker.load(one.robot).command.turn)
    return SPARE + way / SPEED + (off / most if one.robot == "cart" else 0.0)


def _is_out(one: Scene, zones: list[Corners], pose: Array, reach: float) -> bool:
    """Return whether the robot's circle touches no zone, or is before the obstacles' mouth."""
    if one.mouth is None:
        return left(zones, pose)[0] >= reach
    return math.cos(one.mouth) * pose[0] + math.sin(one.mouth) * pose[1] >= DEEP + reach


def lines(quick: bool) -> Iterator[str]:
    """Yield how many got out."""
    for kind in KINDS:
        for robot in ("cart", "holonomic-cart"):
            for rank in (1,) if kind == KINDS[0] else (1, 2, 3):
                yield from _of_kind(kind, robot, rank, 2 if quick else 20)


def _of_kind(kind: str, robot: str, rank: int, count: int) -> Iterator[str]:
    scenes = [scene(kind, robot, rank, seed) for seed in range(count)]
    ways = [drive(one) for one in scenes]
    in_time = sum(one.out <= one.allowed for one in ways)
    still = max((one.still for one in ways if one.led), default=0.0)
    yield (
        f"{kind}, {robot}, rank {rank}: {in_time} of {count} out in time, "
        f"{sum(one.led for one in ways)} led, stood {still:.2f} s at most, "
        f"{sum(one.arrived for one in ways)} arrived"
    )
    for seed, one in enumerate(ways):
        if not one.is_well:
            yield (
                f"   MISS seed {seed}: out after {one.out:.1f} of {one.allowed:.1f} s, stood "
                f"{one.still:.1f} s, arrived {one.arrived}"
            )
