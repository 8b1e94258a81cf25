"""The response of a real robot, from the log of a drive by hand, without a simulation."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import InvalidInputError
from hcbf_robots.identification import log_checks, log_file
from hcbf_robots.identification.analysis import Identified, Record, Stop, analyse, stop_of
from hcbf_robots.identification.log_file import HOW_TO_DRIVE, Log
from hcbf_robots.walkers.walker_parts import Command

FAST_SHARE = 0.5  # share of the greatest commanded speed from which on a stop counts
STILL_SHARE = 0.05  # share of that speed below which a command counts as zero
RUN_TIME, STOP_TIME = 1.0, 1.0  # a run and the stop after it are commanded at least as long [s]
LONGEST_RAMP = 0.7  # from the end of the run to a command of zero [s]
CHANGE_TIME = 0.1  # over which the robot's fastest change is measured [s]
RISE_TIME_CONSTANTS = math.log(9.0)  # from 10 to 90 % of a first-order step take so many τ


def identify_log(
    path: Path, command: Command | None = None, look_ahead: float | None = None
) -> tuple[Identified, Command]:
    """Return a robot's response, from the CSV file of a drive, and the limits of its commands.

    Robots often limit how fast a command changes. So the commands as they were logged are fitted,
    and once more with the robot's own fastest changes. The better fit is returned.

    Args:
        path: of the file; `log_file` describes its columns.
        command: the limits; None takes the greatest commands in the file.
        look_ahead: ℓ of a differential drive without a contract [m].

    Raises:
        InvalidInputError: if the file is no such log, or does not show how the robot follows.
    """
    log = log_file.read(path)
    if command is None:
        command = _greatest_commands(log, look_ahead)
    elif len(command.limits) != log.commands.shape[1]:
        raise InvalidInputError(
            f"log: got {log.commands.shape[1]} entries of the command, expected "
            f"{len(command.limits)}"
        )
    log_checks.check_variation(log, command)
    log_checks.check_agreement(log)
    log_checks.check_rolling(log, command)
    record = _record(log, command)
    log_checks.check_clock(record, float(np.median(np.diff(log.time))))
    log_checks.check_degrees(record)
    stops = _stops(record, command)
    slewed = record._replace(command=_slewed_commands(record))
    candidates = [analyse(command, drive, stops) for drive in (record, slewed)]
    best = min(candidates, key=lambda fitted: fitted.response.residual[1])
    # the runs of a log begin at speed, so that no rise was measured
    rise = round(RISE_TIME_CONSTANTS * best.response.time_constant, 3)
    return best._replace(response=replace(best.response, rise=rise)), command


def _greatest_commands(log: Log, look_ahead: float | None) -> Command:
    """Return the greatest commands of a log as the robot's limits."""
    greatest = np.abs(log.commands).max(axis=0)
    log_checks.check_commanded(log, greatest)
    if len(greatest) == 3:
        forward, sideways, turn = greatest.tolist()
        return Command(forward=forward, sideways=sideways, turn=turn, look_ahead=look_ahead)
    if look_ahead is None:
        raise InvalidInputError(
            "look_ahead: got None, expected how far before the axle the point lies that follows "
            "[m], as the robot's Command will have it: --look-ahead 0.1"
        )
    forward, turn = greatest.tolist()
    return Command(forward=forward, turn=turn, look_ahead=look_ahead)


def _record(log: Log, command: Command) -> Record:
    """Return the motion every `CONTROL_DT`, and the mean command until the next of these times.

    Logged commands begin between these times. If each counted from the next time on, it would come
    late by half a step in the mean.
    """
    time = np.arange(log.time[0], log.time[-1], CONTROL_DT)
    edges = np.append(time, time[-1] + CONTROL_DT)
    commanded = _means_between(edges, log.command_times, log.commands)
    twist_times, twist = log.time, log.twist
    if not np.isfinite(twist).all():
        twist_times, twist = log_file.twist_of_pose(log.time, log.pose)
    done = np.column_stack([np.interp(time, twist_times, entry) for entry in twist.T])
    if command.look_ahead is not None:
        done = np.column_stack([done[:, 0], done[:, 2] + done[:, 1] / command.look_ahead])
    return Record(commanded, done)


def _means_between(edges: Array, times: Array, values: Array) -> Array:
    """Return (n, k) the means between n + 1 edges [s] of values (m, k) held from times (m,) on."""
    ends = np.append(times, max(edges[-1], times[-1]))
    areas = np.diff(ends)[:, None] * values
    integral = np.vstack([np.zeros_like(values[:1]), areas.cumsum(axis=0)])
    at_edges = np.column_stack([np.interp(edges, ends, entry) for entry in integral.T])
    return np.diff(at_edges, axis=0) / np.diff(edges)[:, None]


def _slewed_commands(record: Record) -> Array:
    """Return (n, k) the commands, changing no faster than the robot's motion ever did."""
    steps = round(CHANGE_TIME / CONTROL_DT)
    fastest = np.abs(record.done[steps:] - record.done[:-steps]).max(axis=0) / CHANGE_TIME
    largest_step = CONTROL_DT * fastest
    slewed, present = np.empty_like(record.command), record.command[0]
    for k, command in enumerate(record.command):
        present = present + np.clip(command - present, -largest_step, largest_step)
        slewed[k] = present
    return slewed


def _stops(record: Record, command: Command) -> list[Stop]:
    """Return the stops from at least half of the greatest commanded speed."""
    motion = command.in_plane(record.done)
    commanded = np.hypot(*command.in_plane(record.command).T)
    # a differential drive that turns in place moves the point before its axle, but does not run
    speed = np.abs(record.command[:, 0]) if command.look_ahead is not None else commanded
    is_fast = speed >= FAST_SHARE * speed.max()
    is_still = commanded <= STILL_SHARE * speed.max()
    run, stop, ramp = (round(time / CONTROL_DT) for time in (RUN_TIME, STOP_TIME, LONGEST_RAMP))
    stops = []
    for end in range(run, len(commanded) - stop - ramp):
        if is_fast[end] or not is_fast[end - run : end].all():
            continue
        still = end + int(is_still[end : end + ramp].argmax())
        if is_still[still : still + stop].all():
            later = is_still[still + stop : still + 2 * stop]
            until = still + stop + (len(later) if later.all() else int(later.argmin()))
            stops.append(stop_of(motion[end - run : end], motion[end:until]))
    if not stops:
        raise InvalidInputError(
            f"log: got no stop from at least half of the greatest speed, held for {RUN_TIME:g} s, "
            f"to zero, held for {STOP_TIME:g} s; {HOW_TO_DRIVE}"
        )
    return stops
