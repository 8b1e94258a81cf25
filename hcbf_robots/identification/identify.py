"""A walker driven in its simulation: stops first, then random commands, then creeping ones."""

import math

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_robots.envs.walker_drive import WalkerDrive
from hcbf_robots.envs.walker_physics import WalkerPhysics
from hcbf_robots.identification.analysis import Identified, Record, analyse, stop_of
from hcbf_robots.walkers import Walker
from hcbf_robots.walkers.walker_adapter import Adapter

SHORTEST, LONGEST = 0.4, 2.0  # how long a random command is held [s]
SHARE = 0.8  # of the contract's limits that random commands reach
RESTS = 0.2  # of the random commands that are zero
STOPS = 8  # stops from the greatest speed, in as many directions
RUN, STAND = 2.5, 2.0  # how long such a run and the stop after it last [s]

SLOW, CREEP = 0.3, 30.0
"""Share of the greatest speed up to which a command creeps, and within which time [s]: many a robot
stands where it is commanded to go slowly."""


class Runner:
    """Runs a walker on an empty, flat floor by commands in its own axes; the seed decides them."""

    def __init__(self, walker: Walker, seed: int):
        self.walker = walker
        self._adapter = _Direct(walker)
        self.drive = WalkerDrive(WalkerPhysics(walker), self._adapter, None)
        self._rng = np.random.default_rng(seed)
        self._nothing = BarrierSet([()])
        self.falls = 0
        self._start()

    def _start(self) -> None:
        self.drive.reset(np.zeros(2), 0.0, self._nothing, self._rng)
        self._time = 0.0

    def hold(self, command: Array, seconds: float) -> Record:
        """Hold a command (k,) for some time [s], and return what the robot did."""
        commanded, done, falls = [], [], 0
        for _ in range(round(seconds / CONTROL_DT)):
            commanded.append(command)
            done.append(self.doing())
            self._adapter.commanded = tuple(command.tolist())
            self.drive.follow(np.zeros(2), self._nothing, self._time)
            self._time += CONTROL_DT
            if self.drive.simulation.fallen or self.drive.failed:
                falls += 1
                self._start()
        return Record(np.array(commanded), np.array(done), falls)

    def doing(self) -> Array:
        """Return (k,) what the robot does now, in the axes of the command."""
        simulation, truth = self.drive.simulation, self.drive.truth
        cos, sin = math.cos(simulation.yaw), math.sin(simulation.yaw)
        ahead, aside = cos * truth[2] + sin * truth[3], cos * truth[3] - sin * truth[2]
        if self.walker.command.look_ahead is not None:
            return np.array([ahead, aside / self.walker.command.look_ahead])
        return np.array([ahead, aside, float(simulation.data.qvel[5])])

    def wander(self, seconds: float, rates: Array) -> Record:
        """Give random commands, each held for a random time, which change at rates (k,) at most."""
        limits, parts = self.walker.command.limits, []
        command, passed = np.zeros(len(limits)), 0.0
        while passed < seconds:
            held = self._rng.uniform(SHORTEST, LONGEST)
            wanted = self._draw() * float(self._rng.random() >= RESTS)
            steps = round(held / CONTROL_DT)
            most = CONTROL_DT * rates
            for _ in range(steps):
                command = command + np.clip(wanted - command, -most, most)
                parts.append(self.hold(command, CONTROL_DT))
            passed += steps * CONTROL_DT
        return joined(parts)

    def _draw(self) -> Array:
        """Return a random command (k,) whose speed in the plane is at most the greatest forward."""
        limits = SHARE * self.walker.command.limits
        command = limits * self._rng.uniform(-1.0, 1.0, len(limits))
        moved = self.walker.command.in_plane(command)
        excess = max(1.0, float(np.hypot(*moved)) / (SHARE * self.walker.command.forward))
        return command / excess

    def stop(self, command: Array) -> Record:
        """Run at a command (k,), then stop; the stop begins after `RUN`."""
        self._start()
        return joined([self.hold(command, RUN), self.hold(0.0 * command, STAND)])

    def creep(self, command: Array) -> Record:
        """Give a command (k,) that grows from zero to `SLOW` of it within `CREEP`."""
        self._start()
        steps = round(CREEP / CONTROL_DT)
        shares = SLOW * np.arange(1, steps + 1) / steps
        return joined([self.hold(share * command, CONTROL_DT) for share in shares])


class _Direct(Adapter):
    """Hands on what it is commanded, in the robot's own axes."""

    def __init__(self, walker: Walker):
        super().__init__(walker.command, None, math.inf, walker.period)
        self.commanded: tuple[float, ...] = (0.0,) * len(walker.command.limits)

    def command(self, vx: float, vy: float, yaw: float, rate: float) -> tuple[float, ...]:
        return self.commanded


def joined(parts: list[Record]) -> Record:
    """Return records one after the other."""
    return Record(
        np.concatenate([part.command for part in parts]),
        np.concatenate([part.done for part in parts]),
        sum(part.falls for part in parts),
    )


def identify(walker: Walker, seconds: float, seed: int) -> Identified:
    """Return how a walker follows: stops first, then `seconds` of random commands."""
    runner, begin = Runner(walker, seed), round(RUN / CONTROL_DT)
    runs = [runner.stop(command) for command in _runs(walker)]
    moved = [walker.command.in_plane(one.done) for one in runs]
    stops = [stop_of(one[:begin], one[begin:]) for one in moved]
    braking = float(np.median([one.deceleration for one in stops]))
    record = runner.wander(seconds, _rates(walker, braking))
    creeping = [runner.creep(command) for command in _runs(walker)[::2]]
    fell = record.falls + sum(one.falls for one in runs)
    return analyse(walker.command, record._replace(falls=fell), stops, creeping, seconds)


def _rates(walker: Walker, braking: float) -> Array:
    """Return (k,) how fast a command changes where the point speeds up as hard as it brakes."""
    if walker.command.look_ahead is not None:
        return np.array([braking, braking / walker.command.look_ahead])
    return np.array([braking, braking, 2.0 * walker.command.turn])


def _runs(walker: Walker) -> list[Array]:
    """Return the commands at the greatest speed, in several directions; a cart's ahead and back."""
    limits = walker.command.limits
    if walker.command.look_ahead is not None:
        return [limits * np.array([sign, 0.0]) for sign in (1.0, -1.0)]
    angles = math.tau * np.arange(STOPS) / STOPS
    return [limits * np.array([math.cos(angle), math.sin(angle), 0.0]) for angle in angles]
