"""The walker that moves: physics, adapter and its own controller, run for one control step."""

import math

import numpy as np
from numba import njit

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs import task
from hcbf_gym.envs.a1_walker import Walk, ticks_of
from hcbf_gym.envs.body import Footprint
from hcbf_gym.envs.walker_physics import WalkerPhysics
from hcbf_gym.errors import UNREADABLE
from hcbf_gym.models.plant import Estimate, Reason
from hcbf_gym.robots.response_monitor import ResponseMonitor
from hcbf_gym.robots.walker_adapter import Adapter
from hcbf_gym.robots.walker_policy import Controller
from hcbf_gym.robots.walker_terms import Observer, Source


class WalkerDrive:
    """A walker in its scene, told the velocity of a reduced-order model.

    The model is ``p̈ = u``: its velocity is v ← v + T u, its position is the robot's own, as what
    is told is a velocity alone.

    Args:
        simulation: the scene.
        adapter: what turns the model's velocity into commands.
        footprint: measures the whole robot's distance to the regions; None for a point.
        widened: by how much the bounds of what it may do beside what it is told are wider.

    Attributes:
        truth: (4,) position [m] and velocity [m/s] of the point that follows the model.
        told: (k,) what the controller is told, in the robot's axes [m/s, rad/s].
        ctrl: (k,) inputs of the actuators.
        failed: whether the controller gave something that is no action; the last one was kept.

    Raises:
        InvalidInputError: if the physics' tick does not divide the control step.
    """

    def __init__(
        self,
        simulation: WalkerPhysics,
        adapter: Adapter,
        footprint: Footprint | None,
        widened: float = 1.0,
    ):
        self.simulation, self.adapter = simulation, adapter
        walker, timestep = simulation.walker, float(simulation.model.opt.timestep)
        self._footprint = footprint
        self._monitor = ResponseMonitor(walker.command, walker.response, widened)
        self._ticks: Array = np.arange(1, ticks_of(timestep) + 1) * np.float64(timestep)
        self._base: Array = np.empty((len(self._ticks), 13))
        self._rows = list(self._base)
        self._per_action = round(walker.period / timestep)
        parts, k = simulation.parts, len(simulation.parts.actuators)
        self._scale = walker.scale(parts)
        self._offset = walker.offset(parts, simulation.at.q)
        self.told: Array = np.zeros(len(walker.command.limits))
        self._action: Array = np.zeros(k)
        self._phase: Array = walker.first_phase.copy()
        source = Source(
            simulation.model, simulation.data, parts, simulation.at,
            self.told, self._action, self._phase,
        )  # fmt: skip
        self._observer = Observer(walker.observation, source)
        turn = 0.0 if walker.phase is None else walker.phase.frequency * walker.period
        self._clock = math.tau * turn
        self._controller: Controller | None = None
        self._velocity: Array = np.zeros(2)
        self.rest(np.zeros(2))

    def rest(self, position: Array) -> None:
        """Count as standing at a position (2,) [m], before the first reset."""
        self.truth: Array = np.array([*position, 0.0, 0.0])
        self._velocity[:] = 0.0
        self._since = 0
        self._monitor.forget()
        self._fault = Reason.NONE
        self.failed = False

    def reset(
        self, position: Array, yaw: float, barriers: BarrierSet, rng: np.random.Generator
    ) -> Walk:
        """Put the point that follows at a position (2,) [m]; nothing has happened.

        Args:
            position: (2,) [m].
            yaw: the robot's heading [rad].
            barriers: from which the body's distance is measured.
            rng: decides what is random.
        """
        simulation, walker = self.simulation, self.simulation.walker
        ahead = self.adapter.look_ahead * np.array([math.cos(yaw), math.sin(yaw)])
        simulation.reset(position - ahead, yaw, rng)
        self.rest(position)
        self.adapter.reset(simulation.yaw)
        self._action[:] = self.told[:] = 0.0
        self._phase[:] = walker.first_phase
        self.ctrl: Array = self._offset.copy()
        sizes = self._observer.size, len(self._action)
        self._controller = walker.controller(sizes, simulation.model)
        base = np.empty((1, 13))
        simulation.base(base[0])
        walked = tracked(base, self.adapter.look_ahead)
        self.truth = walked[-1]
        body = self._body_h(barriers, 0.0)
        forces = np.zeros_like(simulation.obstacle_forces())
        return Walk(walked, np.zeros(1), forces, body, body)

    def hold(self, u: Array, barriers: BarrierSet, time: float) -> Walk:
        """Hold the model's acceleration u (2,) [m/s²] for one control step.

        Args:
            u: (2,) [m/s²].
            barriers: from which the body's distance is measured.
            time: at which it begins, since the reset [s].
        """
        self._velocity += task.CONTROL_DT * u
        return self.follow(self._velocity, barriers, time)

    def follow(self, velocity: Array, barriers: BarrierSet, time: float) -> Walk:
        """Tell the robot a velocity (2,) in the world [m/s] for one control step."""
        simulation, base, bodies = self.simulation, self._base, []
        force = np.zeros(simulation.obstacle_forces().shape)
        touches, footprint = len(force) > 0, self._footprint is not None
        vx, vy = velocity.tolist()
        timestep = float(self._ticks[0])
        for k, row in enumerate(self._rows):
            if self._since % self._per_action == 0:
                self.told[:] = self.adapter.command(vx, vy, simulation.yaw, simulation.yaw_rate)
                self._monitor.tell(self.told, time + k * timestep)
                self.act()
            self._since += 1
            simulation.step(self.ctrl)
            simulation.base(row)
            if footprint:
                bodies.append(self._body_h(barriers, time + self._ticks[k]))
            if touches:
                force = np.maximum(force, simulation.obstacle_forces())
        simulation.look()
        walked = tracked(base, self.adapter.look_ahead)
        if len(walked) == 0:  # the last finite state stands
            walked = self.truth[None]
        self.truth = walked[-1]
        times = time + self._ticks[: len(walked)]
        if self._footprint is None:
            return Walk(walked, times, force)
        bodies = bodies[: len(walked)]
        return Walk(walked, times, force, bodies[-1], np.minimum.reduce(bodies))

    def estimate(self, time: float) -> Estimate:
        """Return what is known of the robot: its position, and the model's velocity.

        Args:
            time: since the reset [s].
        """
        body, yaw = self.odometry()
        x = body.copy()
        x[2:] = self._velocity
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
        """Ask the controller, and keep the last inputs where it gives none."""
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

    def _body_h(self, barriers: BarrierSet, time: float) -> Array | None:
        if self._footprint is None:
            return None
        self.simulation.place_geoms()
        return self._footprint.h(self.simulation.data, barriers, time)


@njit(cache=True, error_model="numpy")
def tracked(base: Array, look_ahead: float) -> Array:
    """Return (n, 4) position and velocity of the point before the trunk, while they are finite.

    Args:
        base: (k, 13) position, quaternion, velocity and turning rate of the trunk.
        look_ahead: ℓ [m].
    """
    path = np.empty((len(base), 4))
    for n in range(len(base)):
        w, x, y, z = base[n, 3:7]
        yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        ahead_x, ahead_y = look_ahead * np.cos(yaw), look_ahead * np.sin(yaw)
        path[n, 0], path[n, 1] = base[n, 0] + ahead_x, base[n, 1] + ahead_y
        path[n, 2] = base[n, 7] - base[n, 12] * ahead_y
        path[n, 3] = base[n, 8] + base[n, 12] * ahead_x
        if not np.isfinite(base[n].sum()):
            return path[:n]
    return path
