"""A walker is driven in its simulation: stops first, then random commands, then creeping ones."""

import math

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_robots.identification.analysis import Identified, analyse, stop_of
from hcbf_robots.identification.record import RUN, STOPS, Runner
from hcbf_robots.walkers.walker import Walker


def identify(walker: Walker, seconds: float, seed: int) -> Identified:
    """Return how a walker follows commands: stops first, then random ones that it could follow.

    Args:
        walker: the robot.
        seconds: of random commands [s].
        seed: decides them.
    """
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
