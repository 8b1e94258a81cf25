"""A robot in its scene with its controller, run for one control step at a time."""

import math
from abc import ABC, abstractmethod
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs import task
from hcbf_gym.envs.body import Footprint
from hcbf_gym.envs.simulation import BASE_SIZE, Simulation
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.plant import Estimate

S = TypeVar("S", bound=Simulation)


class Motion(NamedTuple):
    """A robot's motion from one action to the next."""

    path: Array  # (k, 4) planar position [m] and velocity [m/s] of the trunk's origin, by tick
    times: Array  # (k,) the times of these ticks since the reset [s]
    obstacle_force: Array  # (b,) the largest contact force with each box [N]
    body_h: Array | None = None  # (m,) h of the whole robot at the end [m]; None for a point
    least_body_h: Array | None = None  # (m,) h of the whole robot at its least [m]


class Drive(ABC, Generic[S]):
    """A robot in its scene with its controller; a subclass defines one tick.

    Args:
        simulation: the scene with the robot in it.
        footprint: measures the whole robot's distance to the regions; None for a point.
        look_ahead: distance from the trunk's origin, forwards, to the point that follows the
            reduced-order model [m].

    Attributes:
        truth: (4,) position [m] and velocity [m/s] of the point that follows the model.
        origin: (4,) the same of the trunk's origin, which must stay outside the regions.
    """

    def __init__(self, simulation: S, footprint: Footprint | None, look_ahead: float):
        self.simulation, self._footprint, self._look_ahead = simulation, footprint, look_ahead
        self._timestep = float(simulation.model.opt.timestep)
        ticks = round(task.CONTROL_DT / self._timestep)
        if ticks < 1 or abs(ticks * self._timestep - task.CONTROL_DT) > 1e-9:
            raise InvalidInputError(
                f"timestep: got {self._timestep} s, expected one that divides {task.CONTROL_DT} s"
            )
        # time from the control step's beginning to the end of each tick [s]
        self._tick_times: Array = np.arange(1, ticks + 1) * np.float64(self._timestep)
        self._base: Array = np.empty((ticks, BASE_SIZE))  # the trunk after each tick
        self._base_rows = list(self._base)
        self._began = 0.0  # the time at which the control step began [s]
        self.rest(np.zeros(2))

    def rest(self, position: Array) -> None:
        """Set `truth` and `origin` to rest at a position (2,) [m]."""
        self.truth: Array = np.array([*position, 0.0, 0.0])
        self.origin: Array = self.truth

    def reset(
        self, position: Array, yaw: float, barriers: BarrierSet, rng: np.random.Generator
    ) -> Motion:
        """Put the point that follows the model at rest at a position (2,) [m], heading yaw [rad].

        The motion has the body's distance from the barriers. `rng` draws the plant and its noise.
        """
        ahead = self._look_ahead * np.array([math.cos(yaw), math.sin(yaw)])
        self.simulation.reset(position - ahead, yaw, rng)
        self.rest(position)
        self._begin(rng)
        self.simulation.base(self._base_rows[0])
        path = self._record_path(self._base[:1])
        body = self._body_h(barriers, 0.0)
        forces = np.zeros(len(self.simulation.obstacle_forces()))
        return Motion(path, np.zeros(1), forces, body, body)

    @abstractmethod
    def hold(self, u: Array, barriers: BarrierSet, time: float) -> Motion:
        """Hold the model's u (2,) [m/s²] for the control step that begins at a time [s]."""

    @abstractmethod
    def estimate(self, time: float) -> Estimate:
        """Return the state on which the loop is closed, at a time since the reset [s]."""

    @abstractmethod
    def _begin(self, rng: np.random.Generator) -> None:
        """Begin an episode at the simulation's pose."""

    @abstractmethod
    def _tick(self, k: int) -> bool:
        """Advance by tick k, from ``_began + k _timestep`` on; return whether x is still finite."""

    def _run(self, barriers: BarrierSet, time: float) -> Motion:
        """Run the ticks of one control step that begins at a time [s]."""
        simulation, body_h, ticks = self.simulation, [], 0
        self._began = time
        force = np.zeros(len(simulation.obstacle_forces()))
        has_obstacles, has_body = len(force) > 0, self._footprint is not None
        for tick, base in enumerate(self._base_rows):
            if not self._tick(tick):
                break  # the state is no longer finite: the step ends with the last finite one
            simulation.base(base)
            if has_body:
                body_h.append(self._body_h(barriers, time + self._tick_times[tick]))
            if has_obstacles:
                force = np.maximum(force, simulation.obstacle_forces())
            ticks += 1
        path = self._record_path(self._base[:ticks])
        times = time + self._tick_times[: len(path)]
        if not has_body:
            return Motion(path, times, force)
        body_h = body_h[: len(path)] or [self._body_h(barriers, time)]
        return Motion(path, times, force, body_h[-1], np.minimum.reduce(body_h))

    def _record_path(self, base: Array) -> Array:
        """Return the path (k, 4) of the trunk's origin; update `origin` and `truth` by its end."""
        path = tracked(base, 0.0)
        if len(path) == 0:  # no tick ended in a finite state
            return self.origin[None]
        self.origin = path[-1]
        self.truth = path[-1]
        if self._look_ahead > 0.0:
            self.truth = tracked(base[len(path) - 1 : len(path)], self._look_ahead)[0]
        return path

    def _body_h(self, barriers: BarrierSet, time: float) -> Array | None:
        """Return h (m,) of the whole body at a time [s]; None for a point."""
        if self._footprint is None:
            return None
        self.simulation.place_geoms()
        return self._footprint.h(self.simulation.data, barriers, time)


def tracked(base: Array, look_ahead: float) -> Array:
    """Return (n, 4) position and velocity of the point ℓ [m] before the trunk, while finite.

    The trunk's `base` (k, 13) is position, quaternion, velocity and turning rate.
    """
    path = np.empty((len(base), 4))
    return path[: _core.tracked_path(base, look_ahead, path)]
