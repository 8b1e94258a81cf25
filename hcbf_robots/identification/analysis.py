"""From what a robot was commanded and what it did to the numbers of its `Response`."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.arrays import Array
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_robots.identification.model import Fit, fit, late, respond
from hcbf_robots.walkers.response_monitor import SHARE
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import LASTING, Response

QUANTILES = (50.0, 95.0, 99.9)
"""Of the residual [%]."""

FAST = 0.6
"""Share of the greatest speed that was commanded from which on the robot is fast."""
RECENT = 1.0
"""How far back a greater command excuses a speed [s]."""


class Record(NamedTuple):
    """What was commanded and what was done, in the axes in which commands are commanded.

    Attributes:
        command: (n, k) commanded from each sample on [m/s, rad/s].
        done: (n, k) at each sample; of a differential drive the point's velocity in the robot's
            axes comes first, then the turning rate.
        falls: how often the robot fell; it went on from the start then.
    """

    command: Array
    done: Array
    falls: int = 0


class Stop(NamedTuple):
    """A stop from a run.

    Attributes:
        distance: that the robot went on [m].
        deceleration: from 90 to 10 % of the speed [m/s²].
        rise: of the run's beginning, from 10 to 90 % [s].
    """

    distance: float
    deceleration: float
    rise: float


class Identified(NamedTuple):
    """What was measured, and what it was measured from.

    Attributes:
        response: the numbers.
        record: under commands that change.
        fits: of every entry of the command.
    """

    response: Response
    record: Record
    fits: tuple[Fit, ...]


def analyse(
    command: Command,
    record: Record,
    stops: Sequence[Stop],
    creeping: Sequence[Record] = (),
    seconds: float | None = None,
) -> Identified:
    """Return how a robot follows.

    Args:
        command: what it may be commanded.
        record: under commands that change.
        stops: from runs, one at least.
        creeping: records of commands that grow slowly, if there are any.
        seconds: how long it counts as observed [s]; None for the record's length.
    """
    fits = tuple(
        fit(record.command[:, k], record.done[:, k], CONTROL_DT)
        for k in range(record.command.shape[1])
    )
    moving = fits if command.look_ahead is not None else fits[:2]
    slowest = max(moving, key=lambda one: one.time_constant + one.delay)
    follows = slowest.time_constant + slowest.delay
    left = command.in_plane(record.done) - _predicted(command, fits, record)
    lasting = max(_lasting(command, fits, one) for one in (record, *creeping))
    commanded = command.in_plane(record.command * np.array([one.gain for one in fits]))
    response = Response(
        gain=tuple(round(one.gain, 3) for one in fits),
        time_constant=round(slowest.time_constant, 3),
        delay=round(slowest.delay, 3),
        residual=_rounded(np.percentile(np.hypot(*left.T), QUANTILES)),
        sway=round(float(np.percentile(_strays(left, follows), QUANTILES[-1])), 4),
        overshoot=round(_overshoot(command, commanded, record), 4),
        rise=round(float(np.median([one.rise for one in stops])), 3),
        stopping=round(max(one.distance for one in stops), 3),
        braking=round(float(np.median([one.deceleration for one in stops])), 2),
        falls=record.falls + sum(one.falls for one in creeping),
        seconds=round(len(record.command) * CONTROL_DT, 2) if seconds is None else seconds,
        lasting=round(lasting, 4),
    )
    return Identified(response, record, fits)


def stop_of(run: Array, after: Array) -> Stop:
    """Return how a run ended.

    Args:
        run: (n, 2) velocities from the step of the command on [m/s].
        after: (m, 2) velocities from the command to stop on [m/s].
    """
    ahead = run.mean(axis=0)
    length = float(np.hypot(*ahead))
    along = ahead / length if length > 0.0 else ahead
    up, down = run @ along, after @ along
    ran = float(up[len(up) // 2 :].mean())
    seconds = max(_first(down < 0.1 * ran) - _first(down < 0.9 * ran), 1) * CONTROL_DT
    rise = max(_first(up > 0.9 * ran) - _first(up > 0.1 * ran), 1) * CONTROL_DT
    return Stop(float(down.clip(0.0).sum()) * CONTROL_DT, 0.8 * ran / seconds, rise)


def _predicted(command: Command, fits: tuple[Fit, ...], record: Record) -> Array:
    """Return (n, 2) the velocity that the response makes of commands [m/s]."""
    entries = [
        one.gain * respond(late(commanded, one.delay, CONTROL_DT), one.time_constant, CONTROL_DT)
        for one, commanded in zip(fits, record.command.T, strict=True)
    ]
    return command.in_plane(np.column_stack(entries))


def _lasting(command: Command, fits: tuple[Fit, ...], record: Record) -> float:
    """Return what lasts of the residual beyond a share of the motion, in 99.9 % of it [m/s]."""
    predicted = _predicted(command, fits, record)
    left = command.in_plane(record.done) - predicted
    excess = _strays(left, LASTING) - SHARE * _moved(predicted, LASTING)
    return max(0.0, float(np.percentile(excess, QUANTILES[-1]))) / LASTING


def _first(holds: NDArray[np.bool_]) -> int:
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


def _overshoot(command: Command, commanded: Array, record: Record) -> float:
    """Return by how much the speed exceeds recent commands, in 99.9 % of the time [m/s].

    What sways at rest does not count: near a cap on the speed the robot is fast.

    Args:
        command: what the robot may be commanded.
        commanded: (n, 2) velocities that it should reach [m/s].
        record: what it did.
    """
    back = round(RECENT / CONTROL_DT)
    asked = np.concatenate([np.zeros(back), np.hypot(*commanded.T)])
    recent = np.lib.stride_tricks.sliding_window_view(asked, back + 1).max(axis=1)
    excess = (np.hypot(*command.in_plane(record.done).T) - recent).clip(0.0)
    return float(np.percentile(excess[recent >= FAST * recent.max()], QUANTILES[-1]))


def _rounded(values: Array) -> tuple[float, float, float]:
    half, most, all_but_few = (round(float(value), 4) for value in values)
    return half, most, all_but_few
