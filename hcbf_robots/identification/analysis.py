r"""The numbers of a `Response`, fitted to a robot's commands and its motion.

Every entry of the motion is taken to follow its entry of the command by

.. math:: τ \dot v = g\, c(t - δ) - v.

For every τ and δ of a grid the response to the commands is simulated with g = 1. The best g is then
a ratio of sums. The fit with the least squares is taken. A gait's oscillation does not bias it,
because the simulation uses no measurement.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hcbf_gym.arrays import Array
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_robots.walkers.motion_monitor import MEASURED_TOLERANCE
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import AVERAGING_TIME, Response

TIME_CONSTANTS = np.geomspace(0.01, 1.0, 60)  # the grid of τ [s]
LONGEST_DELAY = 0.3  # end of the grid of δ [s]
RESIDUAL_QUANTILES = (50.0, 95.0, 99.9)  # of `Response.residual` [%]
ALMOST_ALWAYS = 99.9  # the quantile that counts as the maximum [%]

FAST_SHARE = 0.6  # share of the greatest commanded speed from which on the robot is fast
OVERSHOOT_WINDOW = 1.0  # commands of this last time are compared with the speed [s]


class Record(NamedTuple):
    """The commands of a drive and the robot's motion, every `CONTROL_DT`, in the commands' axes."""

    command: Array  # (n, k) commanded from each sample on [m/s, rad/s]
    # (n, k) the motion at each sample; of a differential drive v_x and ω + v_y/ℓ of its axle, the
    # exact command for the velocity that the point at ℓ had
    done: Array
    falls: int = 0  # how often the robot fell and was put back to the start


class Fit(NamedTuple):
    """The first-order response that fits one entry of the command best."""

    gain: float  # g
    time_constant: float  # τ [s]
    delay: float  # δ [s]
    predicted: Array  # (n,) the motion that the response predicts from the commands


class Stop(NamedTuple):
    """The numbers of one run from rest to full speed and back to rest."""

    distance: float  # path after the command has become zero [m]
    deceleration: float  # from 90 to 10 % of the speed [m/s²]
    rise: float  # from 10 to 90 % of the speed, as the run begins [s]


class Identified(NamedTuple):
    """A robot's response, and the record and fits from which it was computed."""

    response: Response
    record: Record  # under commands that change
    fits: tuple[Fit, ...]  # (k,) one for each entry of the command


def analyse(
    command: Command,
    record: Record,
    stops: Sequence[Stop],
    creeping: Sequence[Record] = (),
    seconds: float | None = None,
) -> Identified:
    """Return the response that explains a robot's drives.

    Args:
        command: limits of the robot's commands.
        record: a drive under commands that change.
        stops: one or more stops from full speed.
        creeping: drives under commands that grow slowly.
        seconds: the observed time that the response states [s]; None for the record's length.
    """
    fits = tuple(
        fit(commanded, done, CONTROL_DT)
        for commanded, done in zip(record.command.T, record.done.T, strict=True)
    )
    translating = fits if command.look_ahead is not None else fits[:2]
    slowest = max(translating, key=lambda one: one.time_constant + one.delay)
    residual = command.in_plane(record.done) - _predicted(command, fits, record)
    quantiles = np.percentile(np.hypot(*residual.T), RESIDUAL_QUANTILES)
    half, often, nearly_always = (round(float(value), 4) for value in quantiles)
    follows = slowest.time_constant + slowest.delay
    deviations = np.hypot(*_window_integrals(residual, follows).T)
    response = Response(
        gain=tuple(round(one.gain, 3) for one in fits),
        time_constant=round(slowest.time_constant, 3),
        delay=round(slowest.delay, 3),
        residual=(half, often, nearly_always),
        deviation=round(float(np.percentile(deviations, ALMOST_ALWAYS)), 4),
        overshoot=round(_overshoot(command, fits, record), 4),
        rise=round(float(np.median([stop.rise for stop in stops])), 3),
        stopping=round(max(stop.distance for stop in stops), 3),
        braking=round(float(np.median([stop.deceleration for stop in stops])), 2),
        falls=record.falls + sum(creep.falls for creep in creeping),
        seconds=round(len(record.command) * CONTROL_DT, 2) if seconds is None else seconds,
        lasting=round(max(_lasting(command, fits, drive) for drive in (record, *creeping)), 4),
    )
    return Identified(response, record, fits)


def stop_of(run: Array, after: Array) -> Stop:
    """Return a stop's numbers from the velocities (n, 2) of the run and (m, 2) after it [m/s]."""
    mean = run.mean(axis=0)
    length = float(np.hypot(*mean))
    direction = mean / length if length > 0.0 else mean
    up, down = run @ direction, after @ direction
    full_speed = float(up[len(up) // 2 :].mean())
    rise = max(_first_sample(up > 0.9 * full_speed) - _first_sample(up > 0.1 * full_speed), 1)
    fall = max(_first_sample(down < 0.1 * full_speed) - _first_sample(down < 0.9 * full_speed), 1)
    return Stop(
        distance=float(down.clip(0.0).sum()) * CONTROL_DT,
        deceleration=0.8 * full_speed / (fall * CONTROL_DT),
        rise=rise * CONTROL_DT,
    )


def _first_sample(holds: NDArray[np.bool_]) -> int:
    """Return the index of the first true sample, or the number of samples if none is true."""
    return int(holds.argmax()) if holds.any() else len(holds)


def _predicted(command: Command, fits: tuple[Fit, ...], record: Record) -> Array:
    """Return (n, 2) the velocity in the plane that the fits predict from the commands [m/s]."""
    entries = [
        one.gain * respond(delayed(given, one.delay, CONTROL_DT), one.time_constant, CONTROL_DT)
        for one, given in zip(fits, record.command.T, strict=True)
    ]
    return command.in_plane(np.column_stack(entries))


def _window_integrals(rates: Array, seconds: float) -> Array:
    """Return the integrals of rates (n, …) over every window of this length."""
    window = max(1, round(seconds / CONTROL_DT))
    integral = np.concatenate([np.zeros_like(rates[:1]), rates.cumsum(axis=0)]) * CONTROL_DT
    return integral[window:] - integral[:-window]


def _lasting(command: Command, fits: tuple[Fit, ...], record: Record) -> float:
    """Return the part of the residual that does not average out, see `Response.lasting` [m/s]."""
    predicted = _predicted(command, fits, record)
    residual = command.in_plane(record.done) - predicted
    deviations = np.hypot(*_window_integrals(residual, AVERAGING_TIME).T)
    paths = _window_integrals(np.hypot(*predicted.T), AVERAGING_TIME)
    excess = float(np.percentile(deviations - MEASURED_TOLERANCE * paths, ALMOST_ALWAYS))
    return max(0.0, excess) / AVERAGING_TIME


def _overshoot(command: Command, fits: tuple[Fit, ...], record: Record) -> float:
    """Return by how much the fast robot exceeds its recent commands, times their gains [m/s]."""
    scaled = command.in_plane(record.command * np.array([one.gain for one in fits]))
    earlier = round(OVERSHOOT_WINDOW / CONTROL_DT)
    speeds = np.concatenate([np.zeros(earlier), np.hypot(*scaled.T)])
    recent = np.lib.stride_tricks.sliding_window_view(speeds, earlier + 1).max(axis=1)
    excess = (np.hypot(*command.in_plane(record.done).T) - recent).clip(0.0)
    return float(np.percentile(excess[recent >= FAST_SHARE * recent.max()], ALMOST_ALWAYS))


def fit(command: Array, measured: Array, period: float) -> Fit:
    """Return the response with the least squares, for commands (n,) held for a period [s] each."""
    best, least_error = None, np.inf
    for steps in range(round(LONGEST_DELAY / period) + 1):
        late_command = delayed(command, steps * period, period)
        for tau in TIME_CONSTANTS:
            unit = respond(late_command, float(tau), period)
            power = float(unit @ unit)
            gain = float(unit @ measured) / power if power > 0.0 else 0.0
            residual = measured - gain * unit
            error = float(residual @ residual)
            if error < least_error:
                best, least_error = Fit(gain, float(tau), steps * period, gain * unit), error
    assert best is not None
    return best


def delayed(command: Array, delay: float, period: float) -> Array:
    """Return (n,) the commands after a delay [s], with zeros before the first."""
    return np.concatenate([np.zeros(round(delay / period)), command])[: len(command)]


def respond(command: Array, time_constant: float, period: float) -> Array:
    """Return (n,) the first-order response with gain 1 to held commands (n,), from rest."""
    keep = float(np.exp(-period / time_constant))
    # a command that is held from sample k on has its first effect at sample k + 1
    return np.asarray(lfilter([0.0, 1.0 - keep], [1.0, -keep], command), dtype=np.float64)
