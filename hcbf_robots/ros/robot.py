"""A simulated robot with odometry and a scan, in MuJoCo and without ROS."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.set import BarrierSet
from hcbf_robots.envs.walker_drive import WalkerDrive
from hcbf_robots.envs.walker_physics import WalkerPhysics
from hcbf_robots.maps import Grid, nav2, reading
from hcbf_robots.walkers.walker import Walker
from hcbf_robots.walkers.walker_adapter import Adapter

BEAMS, NEAREST_BEAM, FARTHEST_BEAM = 360, 0.05, 10.0
"""Beams of the scan, all around the robot; shortest and longest range that it measures [m]."""
RANGE_NOISE = 0.01
"""Standard deviation of a range [m]."""
COMMAND_TIMEOUT = 0.5
"""Time after a command at which the base stops, unless there is another [s]."""


class SimulatedRobot:
    """A robot that follows velocities, with odometry and a scan.

    The scan sees the map's walls. They do not stop the robot, so that its path shows an entry.

    Args:
        robot: a contract's path or name.
        map_file: a map server's YAML; "" for an empty floor.
        start: (3,) x, y [m] and yaw [rad].
        seed: seeds the scan's noise.

    Raises:
        InvalidInputError: if a file cannot be read.

    Attributes:
        path: (3,) x, y [m] and yaw [rad] after every tick of the physics.
    """

    def __init__(
        self,
        robot: str = "cart",
        map_file: str | Path = "",
        start: ArrayLike = (0.0, 0.0, 0.0),
        seed: int = 0,
    ):
        walker = Walker.load(robot)
        self.physics = WalkerPhysics(walker)
        adapter = Adapter(walker.command, None, math.inf, walker.period)  # commands are in axes
        self._drive = WalkerDrive(self.physics, adapter, None)
        self.dt = float(self.physics.model.opt.timestep)
        self._ticks_per_action = round(walker.period / self.dt)
        self._limits = walker.command.limits
        self._rng = np.random.default_rng(seed)
        self._command, self._commanded_until = np.zeros(len(self._limits)), -math.inf
        self._grid, self._cells = _occupied(map_file)
        x, y, yaw = np.asarray(start, dtype=np.float64).tolist()
        self._drive.reset(np.array([x, y]), yaw, BarrierSet([()]), self._rng)
        self.path: list[Array] = []
        self._ticks, self._ticks_due = 0, 0.0

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return float(self.physics.data.time)

    @property
    def fallen(self) -> bool:
        """Whether the robot has fallen."""
        return bool(self.physics.fallen)

    @property
    def failed(self) -> bool:
        """Whether its controller has failed to return a valid action, so that the last is held."""
        return self._drive.failed

    def command(self, velocity: ArrayLike) -> None:
        """Command (v_x, v_y, ω) in the robot's axes [m/s, rad/s] for `COMMAND_TIMEOUT`."""
        command = np.asarray(velocity, dtype=np.float64)
        command = command[[0, 2]] if len(self._limits) == 2 else command
        self._command = np.clip(command, -self._limits, self._limits)
        self._commanded_until = self.time + COMMAND_TIMEOUT

    def run(self, seconds: float) -> None:
        """Advance the physics by so many seconds; a part of a tick is added to the next call."""
        self._ticks_due += seconds / self.dt
        while self._ticks < round(self._ticks_due):
            if self._ticks % self._ticks_per_action == 0:
                is_fresh = self.time < self._commanded_until
                self._drive.command[:] = self._command if is_fresh else 0.0
                self._drive.act()
            self._ticks += 1
            self.physics.step(self._drive.ctrl)
            self.path.append(self.pose)

    def timed_path(self) -> Array:
        """Return (N, 4) time [s], x, y [m] and yaw [rad] of every tick."""
        path = np.array(self.path).reshape(-1, 3)
        return np.hstack([self.dt * np.arange(1.0, len(path) + 1.0)[:, None], path])

    @property
    def pose(self) -> Array:
        """(3,) x, y [m] and yaw [rad]."""
        return np.array([*self.physics.data.qpos[:2], self.physics.yaw])

    @property
    def twist(self) -> Array:
        """(3,) v_x, v_y [m/s] and ω [rad/s] in the robot's axes."""
        velocity, yaw = self.physics.data.qvel, self.physics.yaw
        cos, sin = math.cos(yaw), math.sin(yaw)
        forward = cos * velocity[0] + sin * velocity[1]
        sideways = cos * velocity[1] - sin * velocity[0]
        return np.array([forward, sideways, velocity[5]])

    def scan(self) -> Array:
        """Return (BEAMS,) noisy ranges [m], counter-clockwise from −π on; +inf saw nothing."""
        x, y, yaw = self.pose
        angles = yaw - math.pi + math.tau / BEAMS * np.arange(BEAMS)
        if self._grid is None:
            return np.full(BEAMS, np.inf)
        (column, row), turn = self._grid.to_cells([[x, y]])[0], self._grid.origin[2]
        cell_side = self._grid.resolution
        most_cells = FARTHEST_BEAM / cell_side
        ranges = cell_side * _core.cast_rays(self._cells, column, row, angles - turn, most_cells)
        ranges = ranges + RANGE_NOISE * self._rng.standard_normal(BEAMS)
        return np.where(ranges < FARTHEST_BEAM, np.maximum(ranges, NEAREST_BEAM), np.inf)


def _occupied(map_file: str | Path) -> tuple[Grid | None, Mask]:
    """Return the grid of a map and which of its cells are occupied."""
    if not map_file:
        return None, np.zeros((0, 0), dtype=np.bool_)
    raster = nav2.read(map_file)
    return raster.grid, reading.of_map(raster, 1, None, 0.0)[0].cells
