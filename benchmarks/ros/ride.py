"""A node's core and the simulated robot of `hcbf ros-sim`, in MuJoCo, in one process."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image

from benchmarks.ros.drive import TICK, Drive
from hcbf_gym.arrays import Array, Mask
from hcbf_robots.ros.robot import SimulatedRobot
from hcbf_robots.walkers import Walker

Planner = Callable[[Array], tuple[float, float, float]]
"""(x, y, yaw) → its command [m/s, rad/s]; it ignores the filter."""


class Ride(Drive):
    """Drives the simulated robot through a core, as `Drive` does a cart without physics."""

    def __init__(
        self,
        planner: Planner,
        given: Mapping[str, Any] | None = None,
        robot: str = "cart",
        map_file: str | Path = "",
        start: ArrayLike = (0.0, 0.0, 0.0),
        seed: int = 0,
    ):
        self.planner = planner
        self.robot = SimulatedRobot(robot, map_file, start, seed=seed)
        self.reach = Walker.load(robot).reach
        super().__init__({"robot": robot, **(given or {})}, start)

    def _move(self) -> None:
        self.robot.run(TICK)
        self.pose = self.robot.pose
        self.speeds.append(float(np.hypot(*self.robot.twist[:2])))
        if (self.ticks + 1) % 5 == 0:  # it is heard next
            self.wanted = self.planner(self.pose)

    def _step(self) -> None:
        super()._step()
        if self.last.command is not None:
            v = self.velocity
            self.robot.command(v if len(v) == 3 else (v[0], 0.0, v[1]))

    @property
    def twist(self) -> Array:
        """(3,) of the odometry [m/s, rad/s]."""
        return self.robot.twist

    def say_scan(
        self,
        ranges: ArrayLike | None = None,
        stamp: float | None = None,
        frame: str = "base_footprint",
    ) -> None:
        """Let the core hear the robot's scan, or another."""
        super().say_scan(self.robot.scan() if ranges is None else ranges, stamp, frame)

    @property
    def path(self) -> Array:
        """(N, 3) poses, one a tick of the physics."""
        return np.array(self.robot.path)


def pursuit(goals: list[tuple[float, float]], speed: float, most: float = 1.0) -> Planner:
    """Return a planner that turns to the next goal and drives at it, as examples/ros_planner.py.

    It turns by `most` rad/s; a goal counts within 0.3 m.
    """
    left = list(goals)

    def plan(pose: Array) -> tuple[float, float, float]:
        if len(left) > 1 and math.dist(left[0], pose[:2]) < 0.3:
            left.pop(0)
        away = np.array(left[0]) - pose[:2]
        turn = math.remainder(math.atan2(away[1], away[0]) - pose[2], math.tau)
        ahead = speed * max(0.0, math.cos(turn)) * min(1.0, float(np.hypot(*away)))
        return ahead, 0.0, max(-most, min(most, 2.0 * turn))

    return plan


def write_map(
    file: Path, shut: Mask, resolution: float = 0.05, origin: tuple[float, float] = (0.0, 0.0)
) -> None:
    """Write a map server's YAML and image; row 0 of the cells is the lowest."""
    shade = np.where(shut, 0, 254).astype(np.uint8)[::-1]
    Image.fromarray(shade).save(file.with_suffix(".pgm"))
    file.write_text(
        f"image: {file.stem}.pgm\nresolution: {resolution}\norigin: [{origin[0]}, {origin[1]}, 0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n",
        encoding="utf-8",
    )
