"""A walker that moves: its tick is the adapter, the robot's controller and the physics."""

import math

import numpy as np

from hcbf_gym._core import Reason
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs import task
from hcbf_gym.envs.body import Footprint
from hcbf_gym.envs.drive import Drive, Motion
from hcbf_gym.errors import UNREADABLE
from hcbf_gym.models.plant import Estimate
from hcbf_robots.envs.walker_physics import WalkerPhysics
from hcbf_robots.walkers.motion_monitor import MotionMonitor
from hcbf_robots.walkers.walker_adapter import Adapter
from hcbf_robots.walkers.walker_policy import Controller
from hcbf_robots.walkers.walker_terms import Observer, Source


class WalkerDrive(Drive[WalkerPhysics]):
    """A walker in its scene, commanded the velocity of a reduced-order model.

    The model is ``p̈ = u``: its velocity is v ← v + T u, its position is the robot's, as a
    velocity alone is commanded. A differential drive holds its command in its own axes, so that the
    velocity of the point before it turns with the heading (`models.axle`).

    Args:
        simulation: the scene.
        adapter: turns the model's velocity into commands.
        footprint: as `Drive` takes it.
        widened: factor on the bounds of the response's error.

    Attributes:
        command: (k,) the controller's, in the robot's axes [m/s, rad/s].
        ctrl: (k,) inputs of the actuators.
        failed: whether the controller gave something that is no action; the last one was held.
    """

    def __init__(
        self,
        simulation: WalkerPhysics,
        adapter: Adapter,
        footprint: Footprint | None,
        widened: float = 1.0,
    ):
        walker, parts = simulation.walker, simulation.parts
        self.adapter = adapter
        self._monitor = MotionMonitor(walker.command, walker.response, widened)
        self._scale = walker.scale(parts)
        self._offset = walker.offset(parts, simulation.at.q)
        self.command: Array = np.zeros(len(walker.command.limits))
        self._action: Array = np.zeros(len(parts.actuators))
        self._phase: Array = walker.first_phase.copy()
        source = Source(
            simulation.model, simulation.data, parts, simulation.at,
            self.command, self._action, self._phase,
        )  # fmt: skip
        self._observer = Observer(walker.observation, source)
        turn = 0.0 if walker.phase is None else walker.phase.frequency * walker.period
        self._clock = math.tau * turn
        self._controller: Controller | None = None
        self._velocity: Array = np.zeros(2)  # of the model
        self._speeds: Array = np.zeros(2)  # of a differential drive, (v, ω)
        self._look_ahead = adapter.look_ahead
        self._wanted = 0.0, 0.0  # the adapter's velocity
        self._drives = False  # whether `_speeds` are commanded
        super().__init__(simulation, footprint, adapter.look_ahead)
        self._per_action = round(walker.period / self._timestep)

    def rest(self, position: Array) -> None:
        """Be at rest at a position (2,) [m]."""
        super().rest(position)
        self._velocity[:], self._speeds, self._drives = 0.0, np.zeros(2), False
        self._since = 0
        self._monitor.reset()
        self._fault = Reason.NONE
        self.failed = False

    def _begin(self, rng: np.random.Generator) -> None:
        walker = self.simulation.walker
        self.adapter.reset(self.simulation.yaw)
        self._action[:] = self.command[:] = 0.0
        self._phase[:] = walker.first_phase
        self.ctrl: Array = self._offset.copy()
        sizes = self._observer.size, len(self._action)
        self._controller = walker.controller(sizes, self.simulation.model)

    def hold(self, u: Array, barriers: BarrierSet, time: float) -> Motion:
        """Hold the model's u (2,) [m/s²] for the control step that begins at a time [s]."""
        if self._look_ahead > 0.0:
            e, across = self._axes()
            speeds = self._speeds + task.CONTROL_DT * np.array(
                [u @ e, u @ across / self._look_ahead]
            )
            self._speeds, self._drives = self.adapter.within(speeds), True
            return self._run(barriers, time)
        self._velocity += task.CONTROL_DT * u
        return self.follow(self._velocity, barriers, time)

    def _axes(self) -> tuple[Array, Array]:
        """Return the heading (2,) and the direction to its left."""
        cos, sin = math.cos(self.simulation.yaw), math.sin(self.simulation.yaw)
        return np.array([cos, sin]), np.array([-sin, cos])

    def follow(self, velocity: Array, barriers: BarrierSet, time: float) -> Motion:
        """Command a velocity (2,) in the world [m/s] for one control step."""
        vx, vy = velocity.tolist()
        self._wanted, self._drives = (vx, vy), False
        return self._run(barriers, time)

    def _tick(self, k: int) -> bool:
        simulation = self.simulation
        if self._since % self._per_action == 0:
            if self._drives:
                self.command[:] = self._speeds
            else:
                self.command[:] = self.adapter.command(
                    *self._wanted, simulation.yaw, simulation.yaw_rate
                )
            self._monitor.command(self.command, self._began + k * self._timestep)
            self.act()
        self._since += 1
        simulation.step(self.ctrl)
        return True

    def estimate(self, time: float) -> Estimate:
        """Return the robot's position and the model's velocity at a time since the reset [s]."""
        body, yaw = self.odometry()
        x = body.copy()
        x[2:] = self._velocity
        if self._look_ahead > 0.0:
            e, across = self._axes()
            x[2:] = self._speeds[0] * e + self._look_ahead * self._speeds[1] * across
        pose = np.array([body[0], body[1], yaw])
        self._fault = self._monitor.observe(pose, body[2:], time) or self._fault
        return Estimate(x, time, None, x, body - x, np.float64(yaw), fault=self._fault or None)

    def odometry(self) -> tuple[Array, float]:
        """Return all that filter and monitor know: `truth` (4,) and the heading [rad]."""
        return self.truth, self.simulation.yaw

    def act(self) -> None:
        """Call the controller; hold the last inputs where it returns none."""
        seen = self._observer.observe()
        assert self._controller is not None
        try:
            action = np.asarray(self._controller(seen), dtype=np.float64)
        except UNREADABLE:
            action = np.array([np.nan])
        if action.shape == self._action.shape and math.isfinite(np.add.reduce(action)):
            self._action[:] = action
            self.ctrl = self._offset + self._scale * action
        else:
            self.failed = True
        if self._clock:
            self._phase += self._clock
            np.remainder(self._phase + math.pi, math.tau, self._phase)
            self._phase -= math.pi
