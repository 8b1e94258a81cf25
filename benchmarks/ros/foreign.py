"""Tests of Nav2 rebuilt from their rules, not from their code, on the node's core.

The moving-obstacle trial is the collision monitor's, the oracle of masks that of the costmap
filters' system tests.
"""

import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.ros.drive import TICK, Drive
from benchmarks.ros.ride import Ride, pursuit, write_map
from hcbf_gym.arrays import Array, Mask
from hcbf_robots.maps import nav2
from hcbf_robots.maps.nav2 import Raster
from hcbf_robots.ros.sources import grid_of

COMES, GOES, ENDS = 3.0, 8.0, 10.0
"""A lethal cell is under the robot between the first two [s]."""
STOPPED, RESUMED, SAMPLES = 0.02, 0.10, 3
"""Speeds [m/s], and how many samples of 20 Hz they must last."""
COSTMAP = {
    "observation_sources": ["costmap"],
    "costmap.type": "keepout",
    "costmap.topic": "costmap",
    "costmap.when_inside": "stop",
}


class Moving(NamedTuple):
    """What one moving-obstacle trial showed; infinite where it never came."""

    stop: float  # from the cell's appearance until the robot stands [s]
    hold: float  # share of the time from then on until it goes in which the robot stands
    resume: float  # from its disappearance until the robot drives [s]
    false: float  # share of the samples without the cell in which it stands

    @property
    def is_well(self) -> bool:
        """Whether the rule is satisfied."""
        return self.stop <= 0.6 and self.hold >= 0.9 and self.resume <= 0.6 and self.false <= 0.05


def moving_obstacle(seed: int) -> Moving:
    """Drive at .20 m/s; costmaps come at 10 Hz, and the cell at a random phase of them."""
    rng = np.random.default_rng([36, seed])
    start = (*rng.uniform(-1.0, 1.0, 2), rng.uniform(-math.pi, math.pi))
    d = Ride(lambda pose: (0.2, 0.0, 0.0), COSTMAP, start=start)
    phase, times, speeds = int(rng.integers(10)), list[float](), list[float]()
    lethal = [math.nan, math.nan]

    def each(d: Drive) -> None:
        elapsed = TICK * d.ticks
        if (d.ticks + phase) % 10 == 0:
            cells = np.zeros((120, 120), dtype=np.int16)
            if COMES <= elapsed < GOES:
                lethal[0] = min(lethal[0], elapsed) if lethal[0] == lethal[0] else elapsed
                cells[60, 60] = 100
            elif elapsed >= GOES and lethal[1] != lethal[1]:
                lethal[1] = elapsed
            corner = d.pose[:2] - 3.025  # rolling; its middle cell is under the robot
            raster = Raster(grid_of(0.05, (*corner, 0.0), 120, 120), cells)
            shown = d.core.of_grid("costmap", raster)
            d.core.hear_source("costmap", shown, d.now.ros, d.now, "odom")
        if d.ticks % 5 == 0:
            times.append(elapsed)
            speeds.append(float(np.hypot(*np.asarray(d.twist)[:2])))

    d.run(ENDS, each=each)
    t, v = np.array(times), np.array(speeds)
    came, went = lethal
    stopped = _lasting(t, v <= STOPPED, came)
    resumed = _lasting(t, v >= RESUMED, went)
    held = (t >= stopped) & (t < went)
    free = ((t > 1.0) & (t < came)) | (t >= went + 0.6)
    return Moving(
        stopped - came,
        float((v[held] <= STOPPED).mean()) if held.any() else 0.0,
        resumed - went,
        float((v[free] <= STOPPED).mean()),
    )


def _lasting(times: Array, holds: Mask, since: float) -> float:
    """Return when something begins that lasts for `SAMPLES`, or infinity."""
    for k in range(len(times) - SAMPLES + 1):
        if times[k] >= since and holds[k : k + SAMPLES].all():
            return float(times[k])
    return math.inf


class Masks(NamedTuple):
    """What a drive through masks showed."""

    arrived: bool
    lethal: int  # poses whose cell of the keepout mask is lethal
    order: list[int]  # limits of the speed mask on the path [%], each as often as it begins
    kept: list[int]  # the same of the limits that were satisfied
    excess: float  # of the speed over the limit, from 0.5 s after its begin on [m/s]
    poses: int


ROOM = 120, 240
"""Rows and columns of the room with masks, of 5 cm."""
STRIPS = {70: (40, 70), 50: (70, 100), 60: (150, 180)}
"""% of the greatest speed → columns of the speed mask."""


def masks(speed: float = 0.9) -> Masks:
    """Drive through a room with a keepout mask in the way and strips of speed limits."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        walls, lawn = np.zeros(ROOM, dtype=np.bool_), np.zeros(ROOM, dtype=np.bool_)
        walls[[0, -1]], walls[:, [0, -1]] = True, True
        lawn[40:120, 110:140] = True
        write_map(folder / "walls.yaml", walls)
        write_map(folder / "lawn.yaml", lawn)
        given = {
            "guidance": "geodesic",
            "observation_sources": ["walls", "lawn", "slow"],
            "walls.type": "map", "walls.file": str(folder / "walls.yaml"),
            "lawn.type": "keepout", "lawn.file": str(folder / "lawn.yaml"), "lawn.priority": 2,
            "slow.type": "speed", "slow.topic": "slow", "slow.priority": 2,
        }  # fmt: skip
        d = Ride(pursuit([(11.0, 4.5)], speed), given, start=(1.0, 3.0, 0.0))
        keepout = nav2.read(folder / "lawn.yaml")
    shares = np.zeros(ROOM, dtype=np.int16)
    for share, (left, right) in STRIPS.items():
        shares[:, left:right] = 100 - share
    mask = d.core.of_grid("slow", Raster(keepout.grid, shares))
    d.run(0.1)
    d.core.hear_source("slow", mask, d.now.ros, d.now, "odom")
    d.core.take(d.core.planned((11.0, 4.5)))
    rows: list[tuple[Any, ...]] = []
    greatest = d.core.fastest

    def each(d: Drive) -> None:
        column, row = keepout.grid.to_cells(d.pose[None, :2])[0].astype(int)
        limit = 100 - int(shares[row, column])
        rows.append((keepout.occupancy[row, column], limit, abs(np.asarray(d.twist)[0]) / greatest))

    while d.ticks * TICK < 90.0 and math.dist(d.pose[:2], (11.0, 4.5)) > 0.35:
        d.run(0.2, each=each)
    lethal, limits, speeds = np.array(rows).T
    order, kept, excess = [100], [100], 0.0
    since = 0
    for k, limit in enumerate(limits.astype(int).tolist()):
        if limit != order[-1]:
            order.append(limit)
            since = k
        if k - since > 0.5 / TICK:
            over = speeds[k] - 0.01 * limit
            excess = max(excess, over * greatest)
            if over <= 0.03 and kept[-1] != limit:
                kept.append(limit)
    near = math.dist(d.pose[:2], (11.0, 4.5)) <= 0.35
    return Masks(near, int((lethal >= 100).sum()), order, kept, excess, len(rows))


def lines(quick: bool) -> Iterator[str]:
    """Yield what the suites show."""
    trials = [moving_obstacle(seed) for seed in range(2 if quick else 20)]
    worst = np.array(trials)
    well = sum(one.is_well for one in trials)
    stop, hold, resume, false = worst.T
    yield (
        f"{'' if well == len(trials) else 'MISS '}moving obstacle: {well} of "
        f"{len(trials)} keep the rule; stop "
        f"{stop.max():.2f} s, hold {100 * hold.min():.0f} %, resume {resume.max():.2f} s, false "
        f"stops {100 * false.max():.0f} % at worst"
    )
    one = masks()
    well = one.arrived and one.lethal == 0 and one.kept == one.order
    yield (
        f"{'' if well else 'MISS '}masks: arrived {one.arrived}, {one.lethal} of {one.poses} poses "
        f"on a lethal cell, limits {one.order} %, kept {one.kept} %, at most {one.excess:+.3f} m/s "
        "above one .5 s after it began"
    )
