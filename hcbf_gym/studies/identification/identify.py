"""From what a walker did to the numbers of its `Response`."""

import math
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.robots.response_monitor import SHARE
from hcbf_gym.robots.walker import Walker
from hcbf_gym.robots.walker_response import LASTING, Response
from hcbf_gym.studies.identification.model import Fit, fit, late, respond
from hcbf_gym.studies.identification.record import RUN, STOPS, Record, Runner

QUANTILES = (50.0, 95.0, 99.9)
"""Of the residual [%]."""


FAST = 0.6
"""Share of the greatest speed that was commanded from which on the robot is fast."""
RECENT = 1.0
"""How far back a greater command excuses a speed [s]."""


class Identified(NamedTuple):
    """What was measured, and what it was measured from.

    Attributes:
        response: the numbers.
        record: under random commands.
        fits: of every entry of the command.
    """

    response: Response
    record: Record
    fits: tuple[Fit, ...]


def identify(walker: Walker, seconds: float, seed: int) -> Identified:
    """Return how a walker follows commands: stops first, then random ones that it could follow.

    Args:
        walker: the robot.
        seconds: of random commands [s].
        seed: decides them.
    """
    runner = Runner(walker, seed)
    stops = [runner.stop(command) for command in _runs(walker)]
    braked = [_brake(_speed(walker, one.done)) for one in stops]
    braking = float(np.median([one.deceleration for one in braked]))
    record = runner.wander(seconds, _rates(walker, braking))
    fits = tuple(
        fit(record.command[:, k], record.done[:, k], CONTROL_DT)
        for k in range(record.command.shape[1])
    )
    slowest = max(_moving(walker, fits), key=lambda one: one.time_constant + one.delay)
    follows = slowest.time_constant + slowest.delay
    left = walker.command.in_plane(record.done) - _predicted(walker, fits, record)
    creeping = [runner.creep(command) for command in _runs(walker)[::2]]
    lasting = max(_lasting(walker, fits, one) for one in (record, *creeping))
    commanded = walker.command.in_plane(record.command * np.array([one.gain for one in fits]))
    response = Response(
        gain=tuple(round(one.gain, 3) for one in fits),
        time_constant=round(slowest.time_constant, 3),
        delay=round(slowest.delay, 3),
        residual=_rounded(np.percentile(np.hypot(*left.T), QUANTILES)),
        sway=round(float(np.percentile(_strays(left, follows), QUANTILES[-1])), 4),
        overshoot=round(_overshoot(walker, commanded, record), 4),
        rise=round(float(np.median([_rise(_speed(walker, one.done)) for one in stops])), 3),
        stopping=round(max(one.distance for one in braked), 3),
        braking=round(braking, 2),
        falls=record.falls + sum(one.falls for one in (*stops, *creeping)),
        seconds=seconds,
        lasting=round(lasting, 4),
    )
    return Identified(response, record, fits)


def _predicted(walker: Walker, fits: tuple[Fit, ...], record: Record) -> Array:
    """Return (n, 2) the velocity that the response makes of commands [m/s]."""
    entries = [
        one.gain * respond(late(commanded, one.delay, CONTROL_DT), one.time_constant, CONTROL_DT)
        for one, commanded in zip(fits, record.command.T, strict=True)
    ]
    return walker.command.in_plane(np.column_stack(entries))


def _lasting(walker: Walker, fits: tuple[Fit, ...], record: Record) -> float:
    """Return what lasts of the residual beyond a share of the motion, in 99.9 % of it [m/s]."""
    predicted = _predicted(walker, fits, record)
    left = walker.command.in_plane(record.done) - predicted
    excess = _strays(left, LASTING) - SHARE * _moved(predicted, LASTING)
    return max(0.0, float(np.percentile(excess, QUANTILES[-1]))) / LASTING


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


def _moving(walker: Walker, fits: tuple[Fit, ...]) -> tuple[Fit, ...]:
    """Return the fits of the entries that move the point which follows."""
    return fits if walker.command.look_ahead is not None else fits[:2]


def _speed(walker: Walker, done: Array) -> Array:
    """Return (n,) the speed along the direction of the run [m/s]."""
    moved = walker.command.in_plane(done)
    ran = moved[: round(RUN / CONTROL_DT)].mean(axis=0)
    length = float(np.hypot(*ran))
    return moved @ (ran / length) if length > 0.0 else np.zeros(len(moved))


class _Braked(NamedTuple):
    """A stop: how far [m], and how hard [m/s²]."""

    distance: float
    deceleration: float


def _brake(speed: Array) -> _Braked:
    """Return how a run ended that was to stop after `RUN`."""
    begin = round(RUN / CONTROL_DT)
    ran = float(speed[begin // 2 : begin].mean())
    after = speed[begin:]
    fast, slow = _first(after < 0.9 * ran), _first(after < 0.1 * ran)
    seconds = max(slow - fast, 1) * CONTROL_DT
    return _Braked(float(after.clip(0.0).sum()) * CONTROL_DT, 0.8 * ran / seconds)


def _rise(speed: Array) -> float:
    """Return the time from 10 to 90 % of the speed [s]."""
    begin = round(RUN / CONTROL_DT)
    ran = float(speed[begin // 2 : begin].mean())
    up = speed[:begin]
    return max(_first(up > 0.9 * ran) - _first(up > 0.1 * ran), 1) * CONTROL_DT


def _first(holds: Mask) -> int:
    """Return the first sample at which something holds, or how many there are."""
    return int(holds.argmax()) if holds.any() else len(holds)


def _strays(left: Array, seconds: float) -> Array:
    """Return (n,) how far position strays from the model's within so many seconds [m]."""
    steps = max(1, round(seconds / CONTROL_DT))
    path = np.concatenate([np.zeros((1, 2)), left.cumsum(axis=0)]) * CONTROL_DT
    return np.hypot(*(path[steps:] - path[:-steps]).T)


def _moved(velocity: Array, seconds: float) -> Array:
    """Return (n,) how long the way is within so many seconds [m]."""
    steps = max(1, round(seconds / CONTROL_DT))
    way = np.concatenate([[0.0], np.hypot(*velocity.T).cumsum()]) * CONTROL_DT
    return way[steps:] - way[:-steps]


def _overshoot(walker: Walker, commanded: Array, record: Record) -> float:
    """Return by how much the speed exceeds recent commands, in 99.9 % of the time [m/s].

    What sways at rest does not count: near a cap on the speed the robot is fast.

    Args:
        walker: the robot.
        commanded: (n, 2) velocities that it should reach [m/s].
        record: what it did.
    """
    back = round(RECENT / CONTROL_DT)
    requested = np.concatenate([np.zeros(back), np.hypot(*commanded.T)])
    recent = np.lib.stride_tricks.sliding_window_view(requested, back + 1).max(axis=1)
    excess = (np.hypot(*walker.command.in_plane(record.done).T) - recent).clip(0.0)
    return float(np.percentile(excess[recent >= FAST * recent.max()], QUANTILES[-1]))


def _rounded(values: Array) -> tuple[float, float, float]:
    half, most, all_but_few = (round(float(value), 4) for value in values)
    return half, most, all_but_few
