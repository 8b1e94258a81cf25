"""A simulated walker with its controller, run for one control step at a time."""

import math

import numpy as np

from hcbf_gym._core import Reason
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs import task
from hcbf_gym.envs.body import Footprint
from hcbf_gym.envs.drive import Drive, Motion
from hcbf_gym.errors import reals
from hcbf_gym.models.plant import Estimate
from hcbf_robots.envs.walker_physics import WalkerPhysics
from hcbf_robots.walkers.motion_monitor import MotionMonitor
from hcbf_robots.walkers.walker_adapter import Adapter
from hcbf_robots.walkers.walker_policy import Controller
from hcbf_robots.walkers.walker_terms import Observer, Source


class WalkerDrive(Drive[WalkerPhysics]):
    """A walker in its scene, whose controller is commanded the velocity of a reduced-order model.

    The model is ``p̈ = u``. Its velocity is v ← v + T u, and its position is the robot's, because
    only a velocity is commanded. A differential drive holds its command in its own axes, so that
    the velocity of the point before it turns with the heading (`models.axle`).

    Args:
        simulation: the scene.
        adapter: turns the model's velocity into commands.
        footprint: as `Drive` takes it.
        widened: factor on the bounds of the response's error.

    Attributes:
        command: (k,) the controller's command, in the robot's axes [m/s, rad/s].
        ctrl: (n,) inputs of the n actuators.
        failed: whether the controller's last output was not a valid action, so that the inputs
            before it are held.
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
        cycles = 0.0 if walker.phase is None else walker.phase.frequency * walker.period
        self._phase_step = math.tau * cycles  # from one action to the next [rad]
        self._controller: Controller | None = None
        self._velocity: Array = np.zeros(2)  # of the model, in the world [m/s]
        self._speeds: Array = np.zeros(2)  # (v, ω) of a differential drive [m/s, rad/s]
        self._look_ahead = adapter.look_ahead
        self._followed = 0.0, 0.0  # the velocity that the adapter turns into commands [m/s]
        self._commands_speeds = False  # whether `_speeds` are commanded in its place
        super().__init__(simulation, footprint, adapter.look_ahead)
        self._ticks_per_action = round(walker.period / self._timestep)

    def rest(self, position: Array) -> None:
        """Be at rest at a position (2,) [m]."""
        super().rest(position)
        self._velocity[:], self._speeds, self._commands_speeds = 0.0, np.zeros(2), False
        self._ticks_done = 0  # since the reset
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
            ahead, left = self._axes()
            rates = np.array([u @ ahead, u @ left / self._look_ahead])
            self._speeds = self.adapter.within(self._speeds + task.CONTROL_DT * rates)
            self._commands_speeds = True
            return self._run(barriers, time)
        self._velocity += task.CONTROL_DT * u
        return self.follow(self._velocity, barriers, time)

    def _axes(self) -> tuple[Array, Array]:
        """Return the unit vectors (2,) of the heading and of the direction to its left."""
        cos, sin = math.cos(self.simulation.yaw), math.sin(self.simulation.yaw)
        return np.array([cos, sin]), np.array([-sin, cos])

    def follow(self, velocity: Array, barriers: BarrierSet, time: float) -> Motion:
        """Command a velocity (2,) in the world [m/s] for one control step."""
        vx, vy = velocity.tolist()
        self._followed, self._commands_speeds = (vx, vy), False
        return self._run(barriers, time)

    def _tick(self, k: int) -> bool:
        simulation = self.simulation
        if self._ticks_done % self._ticks_per_action == 0:
            if self._commands_speeds:
                self.command[:] = self._speeds
            else:
                heading = simulation.yaw, simulation.yaw_rate
                self.command[:] = self.adapter.command(*self._followed, *heading)
            self._monitor.command(self.command, self._began + k * self._timestep)
            self.act()
        self._ticks_done += 1
        simulation.step(self.ctrl)
        return True

    def estimate(self, time: float) -> Estimate:
        """Return the robot's position and the model's velocity at a time since the reset [s]."""
        body, yaw = self.odometry()
        x = body.copy()
        x[2:] = self._velocity
        if self._look_ahead > 0.0:
            ahead, left = self._axes()
            x[2:] = self._speeds[0] * ahead + self._look_ahead * self._speeds[1] * left
        pose = np.array([body[0], body[1], yaw])
        self._fault = self._monitor.observe(pose, body[2:], time) or self._fault
        return Estimate(x, time, None, x, body - x, np.float64(yaw), fault=self._fault or None)

    def odometry(self) -> tuple[Array, float]:
        """Return the measurements of filter and monitor: `truth` (4,) and the heading [rad]."""
        return self.truth, self.simulation.yaw

    def act(self) -> None:
        """Call the controller; hold the last inputs if it returns no valid action."""
        observation = self._observer.observe()
        assert self._controller is not None
        try:
            action = reals("action", self._controller(observation))
        except Exception:  # a user's own controller may raise anything
            action = np.array([np.nan])
        if action.shape == self._action.shape and math.isfinite(np.add.reduce(action)):
            self._action[:] = action
            self.ctrl = self._offset + self._scale * action
        else:
            self.failed = True
        if self._phase_step:  # and wrap the phases to [−π, π)
            self._phase += self._phase_step
            np.remainder(self._phase + math.pi, math.tau, self._phase)
            self._phase -= math.pi
