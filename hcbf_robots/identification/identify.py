"""Drives a walker in its simulation, and returns its response.

It stops from full speed first, then gets random commands, then commands that grow slowly.
"""

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

SHORTEST_HOLD, LONGEST_HOLD = 0.4, 2.0  # of a random command [s]
RANDOM_SHARE = 0.8  # share of the contract's limits that random commands reach
REST_PROBABILITY = 0.2  # of a random command to be zero
STOP_DIRECTIONS = 8  # in which a robot that moves in every direction stops from full speed
RUN_TIME, STOP_TIME = 2.5, 2.0  # of a run at full speed and of the stop after it [s]
CREEP_SHARE, CREEP_TIME = 0.3, 30.0
"""A creeping command grows from zero to this share of full speed, within this time [s]: many robots
are at rest while they are commanded to go slowly."""


class Runner:
    """Drives a walker on an empty, flat floor, by given commands or by random ones of a seed."""

    def __init__(self, walker: Walker, seed: int):
        self.walker = walker
        self._adapter = _UnchangedCommand(walker)
        self.drive = WalkerDrive(WalkerPhysics(walker), self._adapter, None)
        self._rng = np.random.default_rng(seed)
        self._no_barriers = BarrierSet([()])
        self._start()

    def _start(self) -> None:
        self.drive.reset(np.zeros(2), 0.0, self._no_barriers, self._rng)
        self._time = 0.0

    def hold(self, command: Array, seconds: float) -> Record:
        """Hold a command (k,) for some time [s]; a robot that falls starts again."""
        commanded, done, falls = [], [], 0
        for _ in range(round(seconds / CONTROL_DT)):
            commanded.append(command)
            done.append(self._motion())
            self._adapter.commanded = tuple(command.tolist())
            self.drive.follow(np.zeros(2), self._no_barriers, self._time)
            self._time += CONTROL_DT
            if self.drive.simulation.fallen or self.drive.failed:
                falls += 1
                self._start()
        return Record(np.array(commanded), np.array(done), falls)

    def _motion(self) -> Array:
        """Return (k,) the robot's present motion, as `Record.done` has it."""
        simulation = self.drive.simulation
        _, _, vx, vy = self.drive.truth
        cos, sin = math.cos(simulation.yaw), math.sin(simulation.yaw)
        ahead, aside = cos * vx + sin * vy, cos * vy - sin * vx
        if self.walker.command.look_ahead is not None:
            return np.array([ahead, aside / self.walker.command.look_ahead])
        return np.array([ahead, aside, float(simulation.data.qvel[5])])

    def wander(self, seconds: float, rates: Array) -> Record:
        """Give random commands, each held for a random time, which change at rates (k,) at most."""
        command, largest_step = np.zeros(len(rates)), CONTROL_DT * rates
        records, passed = [], 0.0
        while passed < seconds:
            steps = round(self._rng.uniform(SHORTEST_HOLD, LONGEST_HOLD) / CONTROL_DT)
            target = self._random_command()
            target = target * float(self._rng.random() >= REST_PROBABILITY)
            for _ in range(steps):
                command = command + np.clip(target - command, -largest_step, largest_step)
                records.append(self.hold(command, CONTROL_DT))
            passed += steps * CONTROL_DT
        return joined(records)

    def _random_command(self) -> Array:
        """Return a random command (k,) whose speed in the plane is at most the greatest forward."""
        limits = RANDOM_SHARE * self.walker.command.limits
        command = limits * self._rng.uniform(-1.0, 1.0, len(limits))
        speed = float(np.hypot(*self.walker.command.in_plane(command)))
        return command / max(1.0, speed / (RANDOM_SHARE * self.walker.command.forward))

    def stop(self, command: Array) -> Record:
        """Run from rest at a command (k,) for `RUN_TIME`, then stop."""
        self._start()
        return joined([self.hold(command, RUN_TIME), self.hold(0.0 * command, STOP_TIME)])

    def creep(self, command: Array) -> Record:
        """Give a command that grows from zero to `CREEP_SHARE` of a command (k,)."""
        self._start()
        steps = round(CREEP_TIME / CONTROL_DT)
        shares = CREEP_SHARE * np.arange(1, steps + 1) / steps
        return joined([self.hold(share * command, CONTROL_DT) for share in shares])


class _UnchangedCommand(Adapter):
    """An adapter that commands `commanded`, in the robot's own axes, for any velocity."""

    def __init__(self, walker: Walker):
        super().__init__(walker.command, None, math.inf, walker.period)
        self.commanded: tuple[float, ...] = (0.0,) * len(walker.command.limits)

    def command(self, vx: float, vy: float, yaw: float, rate: float) -> tuple[float, ...]:
        return self.commanded


def joined(records: list[Record]) -> Record:
    """Return records as one, each after the one before."""
    return Record(
        np.concatenate([record.command for record in records]),
        np.concatenate([record.done for record in records]),
        sum(record.falls for record in records),
    )


def identify(walker: Walker, seconds: float, seed: int) -> Identified:
    """Return a walker's response in its simulation, with random commands for `seconds` [s]."""
    runner = Runner(walker, seed)
    directions = _full_speed_commands(walker)
    runs = [runner.stop(command) for command in directions]
    run_steps = round(RUN_TIME / CONTROL_DT)
    velocities = [walker.command.in_plane(run.done) for run in runs]
    stops = [stop_of(velocity[:run_steps], velocity[run_steps:]) for velocity in velocities]
    braking = float(np.median([stop.deceleration for stop in stops]))
    record = runner.wander(seconds, _command_rates(walker, braking))
    creeping = [runner.creep(command) for command in directions[::2]]
    falls = record.falls + sum(run.falls for run in runs)
    return analyse(walker.command, record._replace(falls=falls), stops, creeping, seconds)


def _command_rates(walker: Walker, braking: float) -> Array:
    """Return (k,) rates of commands by which the point accelerates as hard as it brakes [m/s²]."""
    if walker.command.look_ahead is not None:
        return np.array([braking, braking / walker.command.look_ahead])
    return np.array([braking, braking, 2.0 * walker.command.turn])


def _full_speed_commands(walker: Walker) -> list[Array]:
    """Return commands at the greatest speed: in several directions, of a cart ahead and back."""
    limits = walker.command.limits
    if walker.command.look_ahead is not None:
        return [limits * np.array([sign, 0.0]) for sign in (1.0, -1.0)]
    angles = math.tau * np.arange(STOP_DIRECTIONS) / STOP_DIRECTIONS
    return [limits * np.array([math.cos(angle), math.sin(angle), 0.0]) for angle in angles]
