"""Reads the log of a drive by hand: a CSV file with a header.

Each line has a time [s], and the command from then on, or what was measured then, or both. The
other cells are empty. All times are of one clock. Commands and twists are in the robot's own axes.
A pose or a twist of its centre is enough. With both the twist counts, and they must agree.
"""

import csv
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError

COMMAND_COLUMNS = ("cmd_vx", "cmd_vy", "cmd_w")  # [m/s, rad/s]; differential drives have no cmd_vy
POSE_COLUMNS = ("x", "y", "yaw")  # [m, rad]
TWIST_COLUMNS = ("vx", "vy", "w")  # [m/s, rad/s]; differential drives need no vy
ALL_COLUMNS = ("time", *COMMAND_COLUMNS, *POSE_COLUMNS, *TWIST_COLUMNS)
SHORTEST_LOG = 20.0  # [s]
LONGEST_GAP, LONGEST_MEDIAN_GAP = 1.0, 0.2  # between two measurements [s]
HOW_TO_DRIVE = (
    "drive for 40 s, at the greatest speeds: 3 s ahead, 2 s zero, 3 s back, 2 s zero, the "
    "same sideways where it can, 3 s of turning left, 3 s right, then another mix of all entries, "
    "both signs, every second"
)


class Log(NamedTuple):
    """The commands and the measurements of a file, each with their own times."""

    command_times: Array  # (m,) [s]
    commands: Array  # (m, k) each counts from its time on [m/s, rad/s]
    time: Array  # (n,) of the measurements [s]
    pose: Array  # (n, 3) [m, rad]; NaN where there is none
    twist: Array  # (n, 3) [m/s, rad/s]; NaN where there is none
    command_names: tuple[str, ...]  # (k,) the columns of the commands


def read(path: Path) -> Log:
    """Read a log, or raise an InvalidInputError that names the malformed column or line."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = list(csv.reader(file, strict=True))
    except (OSError, ValueError, csv.Error) as error:
        raise InvalidInputError(f"log: got {path} ({error}), expected a CSV file") from error
    header = [name.strip() for name in lines[0]] if lines else []
    command_columns = _command_columns(header)
    rows = {k: row for k, row in enumerate(lines[1:], start=2) if any(map(str.strip, row))}
    table = np.array([_numbers(row, len(header), line) for line, row in rows.items()])
    columns = dict(zip(header, table.reshape(-1, len(header)).T, strict=True))
    _check_order(columns["time"], list(rows))
    log = _split(columns, command_columns)
    _check_times(log)
    return log


def _command_columns(header: list[str]) -> tuple[str, ...]:
    """Return the header's columns of commands, or refuse a header that lacks what a log needs."""
    sideways = ("cmd_vy",) if "cmd_vy" in header else ()
    command = ("cmd_vx", *sideways, "cmd_w")
    twist = TWIST_COLUMNS if sideways or "vy" in header else ("vx", "w")
    wrong = [name for name in header if name not in ALL_COLUMNS or header.count(name) > 1]
    is_measured = set(POSE_COLUMNS) <= set(header) or set(twist) <= set(header)
    if wrong or not {"time", *command} <= set(header) or not is_measured:
        raise InvalidInputError(
            f"log: got the columns {header}, expected time, {', '.join(command)}, and "
            f"{', '.join(POSE_COLUMNS)} or {', '.join(twist)} or both, among {list(ALL_COLUMNS)}"
        )
    return command


def _numbers(row: list[str], count: int, line: int) -> list[float]:
    """Return the numbers of a line's cells, with NaN for empty ones."""
    if len(row) != count:
        raise InvalidInputError(f"log: line {line}: got {len(row)} cells, expected {count}")
    numbers = []
    for cell in map(str.strip, row):
        try:
            number = float(cell) if cell else math.nan
        except ValueError:
            number = math.inf
        if cell and not math.isfinite(number):
            raise InvalidInputError(f"log: line {line}: got {cell!r}, expected a finite number")
        numbers.append(number)
    return numbers


def _check_order(time: Array, line_numbers: list[int]) -> None:
    """Refuse a missing time (NaN), and one that is before the time of the line above."""
    missing = np.flatnonzero(np.isnan(time))
    backwards = np.flatnonzero(np.diff(time) < 0.0) + 1
    if len(missing) or len(backwards):
        row = int(missing[0] if len(missing) else backwards[0])
        raise InvalidInputError(
            f"log: line {line_numbers[row]}: got the time {time[row]:.10g}, expected a time that "
            "is not before that of the line above: all times of one clock, in their order"
        )


def _split(columns: dict[str, Array], command_columns: tuple[str, ...]) -> Log:
    """Return the commands and the measurements, each of the lines that have them."""
    time = columns["time"]
    missing = np.full(len(time), np.nan)
    axle = {"vy": np.zeros(len(time))} | columns  # an axle does not move sideways
    commands = np.column_stack([columns[name] for name in command_columns])
    pose = np.column_stack([columns.get(name, missing) for name in POSE_COLUMNS])
    twist = np.column_stack([axle.get(name, missing) for name in TWIST_COLUMNS])
    commanded = np.flatnonzero(np.isfinite(commands).all(axis=1))
    measured = np.flatnonzero(np.isfinite(twist).all(axis=1))
    if not len(measured):
        measured = np.flatnonzero(np.isfinite(pose).all(axis=1))
    is_new = np.diff(time[measured], prepend=-math.inf) > 0.0
    measured = measured[is_new]  # a measurement that is written twice counts once
    pose, twist, time_measured = pose[measured], twist[measured], time[measured]
    return Log(time[commanded], commands[commanded], time_measured, pose, twist, command_columns)


def _check_times(log: Log) -> None:
    """Refuse logs that are too short, too sparse, or of two clocks that do not meet."""
    if len(log.time) < 3 or len(log.commands) < 2:
        counts = f"{len(log.commands)} commands and {len(log.time)} measurements"
        raise InvalidInputError(f"log: got {counts}; {HOW_TO_DRIVE}")
    start, end = log.time[0], log.time[-1]
    first, last = log.command_times[0], log.command_times[-1]
    if first > end or last < start:
        raise InvalidInputError(
            f"log: got commands from {first:.10g} to {last:.10g} s and measurements from "
            f"{start:.10g} to {end:.10g} s, expected the same clock for both"
        )
    if end - start < SHORTEST_LOG:
        raise InvalidInputError(
            f"log: got {end - start:.3g} s, expected at least {SHORTEST_LOG:g} s; {HOW_TO_DRIVE}"
        )
    gaps = np.diff(log.time)
    if gaps.max() > LONGEST_GAP or np.median(gaps) > LONGEST_MEDIAN_GAP:
        raise InvalidInputError(
            f"log: got {gaps.max():.3g} s without a measurement, and {np.median(gaps):.3g} s "
            f"between two in the median, expected at most {LONGEST_GAP:g} and "
            f"{LONGEST_MEDIAN_GAP:g} s"
        )


def twist_of_pose(time: Array, pose: Array) -> tuple[Array, Array]:
    """Return the times (n − 1,) between poses (n, 3), and the twist (n − 1, 3) at these times."""
    intervals = np.diff(time)
    yaw = np.unwrap(pose[:, 2])
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    dx, dy = np.diff(pose[:, :2], axis=0).T / intervals
    cos, sin = np.cos(middle), np.sin(middle)
    twist = np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, np.diff(yaw) / intervals])
    return 0.5 * (time[1:] + time[:-1]), twist
