"""A walker that moves: its tick is the adapter, its own controller and the physics."""

import math

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs import task
from hcbf_gym.envs.body import Footprint
from hcbf_gym.envs.drive import Drive, Motion
from hcbf_gym.errors import UNREADABLE
from hcbf_gym.models.plant import Estimate, Reason
from hcbf_robots.envs.walker_physics import WalkerPhysics
from hcbf_robots.walkers.response_monitor import ResponseMonitor
from hcbf_robots.walkers.walker_adapter import Adapter
from hcbf_robots.walkers.walker_policy import Controller
from hcbf_robots.walkers.walker_terms import Observer, Source


class WalkerDrive(Drive[WalkerPhysics]):
    """A walker in its scene, commanded the velocity of a reduced-order model.

    The model is ``p̈ = u``: its velocity is v ← v + T u, its position is the robot's own, as a
    velocity alone is commanded. A differential drive holds its command in its own axes, so that the
    velocity of the point before it turns with the heading (`models.axle`).

    Args:
        simulation: the scene.
        adapter: what turns the model's velocity into commands.
        footprint: as `Drive` takes it.
        widened: by how much the bounds of what it may do beside its commands are wider.

    Attributes:
        command: (k,) the controller's, in the robot's axes [m/s, rad/s].
        ctrl: (k,) inputs of the actuators.
        failed: whether the controller gave something that is no action; the last one was kept.
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
        self._monitor = ResponseMonitor(walker.command, walker.response, widened)
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
        self._wanted = 0.0, 0.0  # what the adapter is given
        self._drives = False  # whether `_speeds` are commanded
        super().__init__(simulation, footprint, adapter.look_ahead)
        self._per_action = round(walker.period / self._timestep)

    def rest(self, position: Array) -> None:
        """Count as standing at a position (2,) [m], before the first reset."""
        super().rest(position)
        self._velocity[:], self._speeds, self._drives = 0.0, np.zeros(2), False
        self._since = 0
        self._monitor.forget()
        self._fault = Reason.NONE
        self.failed = False

    def _begin(self, rng: np.random.Generator) -> None:
        """Begin an episode: the controller is made anew."""
        walker = self.simulation.walker
        self.adapter.reset(self.simulation.yaw)
        self._action[:] = self.command[:] = 0.0
        self._phase[:] = walker.first_phase
        self.ctrl: Array = self._offset.copy()
        sizes = self._observer.size, len(self._action)
        self._controller = walker.controller(sizes, self.simulation.model)

    def hold(self, u: Array, barriers: BarrierSet, time: float) -> Motion:
        """Hold the model's acceleration u (2,) [m/s²] for one control step."""
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
        """Return the heading (2,) and what lies to its left."""
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
            self._monitor.tell(self.command, self._began + k * self._timestep)
            self.act()
        self._since += 1
        simulation.step(self.ctrl)
        return True

    def estimate(self, time: float) -> Estimate:
        """Return what is known of the robot: its position, and the model's velocity.

        Args:
            time: since the reset [s].
        """
        body, yaw = self.odometry()
        x = body.copy()
        x[2:] = self._velocity
        if self._look_ahead > 0.0:
            e, across = self._axes()
            x[2:] = self._speeds[0] * e + self._look_ahead * self._speeds[1] * across
        pose = np.array([body[0], body[1], yaw])
        if self._monitor.observe(pose, body[2:], time):
            self._fault = Reason.RESPONSE
        return Estimate(x, time, None, x, body - x, np.float64(yaw), fault=self._fault or None)

    def odometry(self) -> tuple[Array, float]:
        """Return (4,) position [m] and velocity [m/s] of the point that follows, and the heading.

        The filter and the monitor know nothing else of the robot.
        """
        return self.truth, self.simulation.yaw

    def act(self) -> None:
        """Let the controller act, and keep the last inputs where it gives none."""
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
