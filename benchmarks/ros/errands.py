"""Long drives of cart and Go1 through Nav2's `depot` on the node's core, in simulated time.

A hostile planner drives at what stands nearest; a friendly one has guidance lead it from goal to
goal. The map is $HCBF_DATA/maps/depot.yaml, or a room of boxes where there is none.
"""

import math
import os
import resource
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.judges.squares import distances
from benchmarks.ros.drive import TICK
from benchmarks.ros.ride import Planner, Ride, pursuit, write_map
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.errors import InvalidInputError
from hcbf_robots.maps import Grid, RankedMap, nav2

SOURCES = {
    "observation_sources": ["walls", "scan"],
    "walls.type": "map",
    "scan.type": "scan",
    "scan.topic": "scan",
}
GO1 = "tests/robots/contracts/go1.json"
DRIVES = ("cart", False, 600.0), ("cart", True, 3600.0), (GO1, False, 600.0), (GO1, True, 600.0)
"""Robot, whether it is led from goal to goal, and for how long [s]."""
CLEAR = 0.8
"""Of starts and goals from what stands [m]."""
GIVEN_UP = 90.0
"""After which another goal is taken [s]."""


class Errand(NamedTuple):
    """What a long drive showed."""

    length: float  # of the path [m]
    apart: float  # least distance of the circle that holds the robot from the true cells [m]
    entered: int  # ticks of the physics in which it overlapped one
    arrivals: int
    goals: int  # that were tried
    messages: dict[str, int]  # of decisions, by their kind
    latency: tuple[float, float, float]  # of a decision: median, 99 %, largest [s]
    grown: float  # the resident memory's peak, from the second tenth on [MB]


class Room:
    """A map server's map, its true cells, and random free places."""

    def __init__(self, file: Path, seed: int):
        self.file = file
        raster = nav2.read(file)
        self.grid: Grid = raster.grid
        self.shut: Mask = raster.occupancy != nav2.FREE  # unknown cells are of rank 1, too
        self._map = RankedMap.load(file)
        self.rng = np.random.default_rng([40, seed])

    def place(self) -> tuple[float, float]:
        """Return somewhere with room around it [m]."""
        rows, columns = self.grid.shape
        while True:
            at = self.rng.uniform(0.0, self.grid.resolution, 2) * (columns, rows)
            point = at + self.grid.origin[:2]
            if self._map.distance([point], 1)[0] > CLEAR:
                return float(point[0]), float(point[1])

    def nearest(self, pose: Array) -> Array:
        """Return the nearest shut cell's middle [m], or the map's corner where none is near."""
        (column, row) = self.grid.to_cells(pose[None, :2])[0].astype(int)
        top, left = max(row - 60, 0), max(column - 60, 0)
        rows, columns = np.nonzero(self.shut[top : row + 60, left : column + 60])
        if rows.size == 0:
            return np.array(self.grid.origin[:2])
        cells = np.column_stack([columns + left, rows + top])
        middles = self.grid.resolution * (cells + 0.5) + self.grid.origin[:2]
        return middles[np.argmin(np.hypot(*(middles - pose[:2]).T))]


def hostile(room: Room) -> Planner:
    """Return a planner that drives at what stands nearest, or anywhere, as fast as it may."""
    state = {"until": 0, "tick": 0, "mode": 0}
    command = np.zeros(3)

    def plan(pose: Array) -> tuple[float, float, float]:
        state["tick"] += 1
        if state["tick"] >= state["until"]:
            state["until"] = state["tick"] + int(room.rng.integers(10, 80))
            state["mode"] = int(room.rng.integers(4))
            command[:] = room.rng.uniform(-1.0, 1.0, 3) * (1.2, 0.0, 2.5)
        if state["mode"] == 0:
            return float(command[0]), 0.0, float(command[2])
        away = room.nearest(pose) - pose[:2]
        bearing = math.atan2(away[1], away[0]) + (0.0, 0.0, math.pi, 0.6)[state["mode"]]
        turn = math.remainder(bearing - pose[2], math.tau)
        back = -1.0 if state["mode"] == 2 else 1.0
        return 1.2 * back, 0.0, max(-2.5, min(2.5, 4.0 * turn))

    return plan


def drive(
    room: Room, seconds: float, *, friendly: bool, seed: int = 0, robot: str = "cart"
) -> Errand:
    """Drive for so long."""
    given = {**SOURCES, "walls.file": str(room.file)}
    goal, since, goals, arrivals = (math.nan, math.nan), 0.0, 0, 0
    start = (*room.place(), room.rng.uniform(-math.pi, math.pi))
    if friendly:
        given["guidance"] = "geodesic"
    planner = (lambda pose: (0.0, 0.0, 0.0)) if friendly else hostile(room)
    d = Ride(planner, given, robot, map_file=room.file, start=start, seed=seed)
    d.run(0.2)
    peaks, kinds = list[float](), Counter[str]()
    least, entered, length = math.inf, 0, 0.0
    for tenth in range(10):
        while TICK * d.ticks < (tenth + 1) * seconds / 10.0:
            arrived, elapsed = math.dist(d.pose[:2], goal) < 0.35, TICK * d.ticks
            if friendly and (goals == 0 or arrived or elapsed - since > GIVEN_UP):
                arrivals += arrived
                goal, since, goals = _next(d, room), elapsed, goals + 1
                d.planner = pursuit([goal], 0.8)
            d.run(1.0)
            places = d.path[:, :2]
            apart = distances(room.grid, room.shut, places, 1.0) - d.reach
            least, entered = min(least, float(apart.min())), entered + int((apart < 0.0).sum())
            length += float(np.hypot(*np.diff(places, axis=0).T).sum())
            kinds.update(one.message.split(": ")[0] for _, one in d.decisions[:-1])
            del d.decisions[:-1], d.commands[:-1], d.speeds[:], d.robot.path[:-1]
        peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
    median, most, worst = np.quantile(d.latencies, (0.5, 0.99, 1.0))
    took = float(median), float(most), float(worst)
    return Errand(length, least, entered, arrivals, goals, dict(kinds), took, peaks[-1] - peaks[1])


def _next(d: Ride, room: Room) -> tuple[float, float]:
    """Let guidance lead to another goal, to which there is a way."""
    while True:
        goal = room.place()
        try:
            d.core.take(d.core.planned(goal))
        except InvalidInputError:
            continue
        return goal


def lines(quick: bool) -> Iterator[str]:
    """Yield what long drives show."""
    data = os.environ.get("HCBF_DATA", "")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(data) / "maps" / "depot.yaml"
        if quick or not data:
            file = Path(folder) / "boxes.yaml"
            write_map(file, _boxes())
        for robot, friendly, whole in DRIVES[:2] if quick or not data else DRIVES:
            seconds = 30.0 if quick else whole
            one = drive(Room(file, int(friendly)), seconds, friendly=friendly, robot=robot)
            median, most, worst = (1e3 * took for took in one.latency)
            well = one.entered == 0 and (not friendly or one.arrivals >= 0.9 * (one.goals - 1))
            yield (
                f"{'' if well else 'MISS '}{Path(robot).stem}, "
                f"{'from goal to goal' if friendly else 'hostile'}, {file.stem}: {seconds:.0f} s, "
                f"{one.length:.0f} m, rank 1 entered in {one.entered} ticks, {one.apart:+.3f} m at "
                f"least, {one.arrivals} arrivals of {one.goals} goals (the last is under way), "
                f"a decision takes {median:.2f} ms in the median, {most:.2f} in 99 %, at most "
                f"{worst:.1f}, {one.grown:+.1f} MB; {one.messages}"
            )


def _boxes() -> Mask:
    """Return the cells of a room with boxes in it."""
    shut = np.zeros((160, 200), dtype=np.bool_)
    shut[[0, -1]], shut[:, [0, -1]] = True, True
    shut[40:80, 50:60] = shut[90:130, 120:135] = shut[20:50, 140:150] = True
    return shut
