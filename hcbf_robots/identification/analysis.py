r"""The numbers of a `Response`, from a robot's commands and its motion.

.. math:: τ \dot v = g\, c(t - δ) - v

For every τ and δ of a grid the response to the commands is simulated with g = 1; the best g is then
a ratio of sums. The pair with the least squares is taken: a gait's oscillation does not bias it, as
nothing measured is fed back.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hcbf_gym.arrays import Array
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_robots.walkers.motion_monitor import SHARE
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import LASTING, Response

TIME_CONSTANTS = np.geomspace(0.01, 1.0, 60)  # those that are tried [s]
LONGEST_DELAY = 0.3  # that is tried [s]
QUANTILES = (50.0, 95.0, 99.9)  # of the residual [%]

FAST = 0.6  # share of the greatest speed that was commanded from which on the robot is fast
RECENT = 1.0  # how far back a greater command excuses a speed [s]


class Record(NamedTuple):
    """What was commanded and done, in the axes of commands."""

    command: Array  # (n, k) commanded from each sample on [m/s, rad/s]
    # (n, k) at each sample; of a differential drive the point's velocity in the robot's axes comes
    # first, then the turning rate
    done: Array
    falls: int = 0  # how often the robot fell, and started again


class Fit(NamedTuple):
    """One axis."""

    gain: float  # g
    time_constant: float  # τ [s]
    delay: float  # δ [s]
    predicted: Array  # (n,) what the model makes of the commands


class Stop(NamedTuple):
    """A stop from a run."""

    distance: float  # that the robot went on [m]
    deceleration: float  # from 90 to 10 % of the speed [m/s²]
    rise: float  # of the run's beginning, from 10 to 90 % [s]


class Identified(NamedTuple):
    """What was measured, and what it was measured from."""

    response: Response  # the numbers
    record: Record  # under commands that change
    fits: tuple[Fit, ...]  # of every entry of the command


def analyse(
    command: Command,
    record: Record,
    stops: Sequence[Stop],
    creeping: Sequence[Record] = (),
    seconds: float | None = None,
) -> Identified:
    """Return how a robot follows.

    Args:
        command: its limits.
        record: under commands that change.
        stops: from runs, one at least.
        creeping: records of commands that grow slowly.
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
    quantiles = np.percentile(np.hypot(*left.T), QUANTILES)
    half, often, nearly_always = (round(float(value), 4) for value in quantiles)
    response = Response(
        gain=tuple(round(one.gain, 3) for one in fits),
        time_constant=round(slowest.time_constant, 3),
        delay=round(slowest.delay, 3),
        residual=(half, often, nearly_always),
        deviation=round(float(np.percentile(_strays(left, follows), QUANTILES[-1])), 4),
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
    """Return how a run ended, by velocities (n, 2) in it and (m, 2) from its end on [m/s]."""
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
    """Return (n,) how long the path is within so many seconds [m]."""
    steps = max(1, round(seconds / CONTROL_DT))
    path = np.concatenate([[0.0], np.hypot(*velocity.T).cumsum()]) * CONTROL_DT
    return path[steps:] - path[:-steps]


def _overshoot(command: Command, commanded: Array, record: Record) -> float:
    """Return by how much the speed exceeds recent commands, in 99.9 % of the time [m/s]."""
    back = round(RECENT / CONTROL_DT)
    asked = np.concatenate([np.zeros(back), np.hypot(*commanded.T)])
    recent = np.lib.stride_tricks.sliding_window_view(asked, back + 1).max(axis=1)
    excess = (np.hypot(*command.in_plane(record.done).T) - recent).clip(0.0)
    return float(np.percentile(excess[recent >= FAST * recent.max()], QUANTILES[-1]))


def fit(command: Array, measured: Array, period: float) -> Fit:
    """Return the response that explains what was measured (n,) best, by commands (n,) held each."""
    best, least = None, np.inf
    for steps in range(round(LONGEST_DELAY / period) + 1):
        commanded = late(command, steps * period, period)
        for tau in TIME_CONSTANTS:
            unit = respond(commanded, float(tau), period)
            power = float(unit @ unit)
            gain = float(unit @ measured) / power if power > 0.0 else 0.0
            left = measured - gain * unit
            error = float(left @ left)
            if error < least:
                best, least = Fit(gain, float(tau), steps * period, gain * unit), error
    assert best is not None
    return best


def late(command: Array, delay: float, period: float) -> Array:
    """Return (n,) the commands as they come after a delay [s], zero before."""
    return np.concatenate([np.zeros(round(delay / period)), command])[: len(command)]


def respond(command: Array, time_constant: float, period: float) -> Array:
    """Return (n,) the first-order response to a held command, from rest."""
    keep = float(np.exp(-period / time_constant))
    # what is commanded from sample k on shows at sample k + 1
    return np.asarray(lfilter([0.0, 1.0 - keep], [1.0, -keep], command), dtype=np.float64)
