"""How a robot follows, from the log of a drive by hand, without a simulation.

A CSV file with a header. Each line has a time, and the command from then on, or what was measured
then, or both; cells of what it does not have are empty. All times are of one clock.

| column | meaning |
|---|---|
| time | [s] |
| cmd_vx, cmd_vy, cmd_w | the command in its axes [m/s, rad/s]; a differential drive has no vy |
| x, y, yaw | pose of its centre [m, rad] |
| vx, vy, w | twist of its centre in its own axes [m/s, rad/s]; a differential drive needs no vy |

Pose or twist will do; where both are there, the twist counts, and they must agree.
"""

import csv
import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import InvalidInputError
from hcbf_robots.identification import analysis
from hcbf_robots.identification.analysis import LONGEST_DELAY, Identified, Record, Stop
from hcbf_robots.walkers.walker_parts import Command

COMMANDED, POSE, TWIST = ("cmd_vx", "cmd_vy", "cmd_w"), ("x", "y", "yaw"), ("vx", "vy", "w")
UNITS = ("m/s", "m/s", "rad/s")

SHORTEST = 20.0  # of a log [s]
GAP, SLOWEST = 1.0, 0.2  # between two measurements at most, and in the median [s]
VARIES = 4.0  # changes of an entry, added up, as multiples of its greatest value
WHOLE = 0.5  # share of its greatest speed from which a stop counts, and of a contract's limit
BEFORE, AFTER, RAMP = 1.0, 1.0, 0.7  # lengths of a run, its stop, and the ramp between [s]
AGREES, WITHIN = 0.25, 0.5  # share in which pose and twist agree, over so many seconds [s]
EARLIEST, LATEST = 0.06, 1.0  # how far motion is looked for before and after its command [s]
# length of a rest [s], the greatest share of a command in it, the share of the greatest motion
# that ends it, and over how long noise is smoothed then [s]
RESTS, RESTING, BEGINS, SMOOTHED = 1.0, 0.02, 0.2, 0.1
YAW_OFF, SLIDES = 0.09, 0.3  # of a yaw [rad], and of an axle aside, as a share of its speed
RISE = math.log(9.0)  # time constants from 10 to 90 % of a step
CHANGES = 0.1  # over which the fastest change counts [s]
DEGREES = (30.0, 120.0)  # a turning rate that is so many times too great is in degrees

DRIVE = (
    "drive for 40 s, at the greatest speeds: 3 s ahead, 2 s zero, 3 s back, 2 s zero, the "
    "same sideways where it can, 3 s of turning left, 3 s right, then another mix of all entries, "
    "both signs, every second"
)


class Log(NamedTuple):
    """What a file holds."""

    commanded_at: Array  # (m,) [s]
    commanded: Array  # (m, k) commands from then on [m/s, rad/s]
    time: Array  # (n,) of the measurements [s]
    pose: Array  # (n, 3) [m, rad]; NaN where there is none
    twist: Array  # (n, 3) [m/s, rad/s]; NaN where there is none


def identify_log(
    path: Path, command: Command | None = None, look_ahead: float | None = None
) -> tuple[Identified, Command]:
    """Return how a robot follows, from the CSV file of a drive, and what it may be commanded.

    Args:
        path: of the file.
        command: its limits; None takes the greatest commands.
        look_ahead: ℓ of a differential drive without a contract [m].

    Raises:
        InvalidInputError: if the file is no such log, or does not show how the robot follows.
    """
    log = read(path)
    if command is None:
        command = _command(log, look_ahead)
    elif len(command.limits) != log.commanded.shape[1]:
        raise InvalidInputError(
            f"log: got {log.commanded.shape[1]} entries of the command, expected "
            f"{len(command.limits)}"
        )
    _check_varies(log, command)
    _check_agrees(log)
    _check_rolls(log, command)
    record = _record(log, command)
    _check_clock(record, float(np.median(np.diff(log.time))))
    _check_degrees(record)
    stops = _stops(record, command)
    commanded = record, record._replace(command=_within_reach(record))
    found = (analysis.analyse(command, one, stops) for one in commanded)
    best = min(found, key=lambda one: one.response.residual[1])
    rise = round(RISE * best.response.time_constant, 3)
    return best._replace(response=replace(best.response, rise=rise)), command


def read(path: Path) -> Log:
    """Read a log, or raise an InvalidInputError that names the line."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = list(csv.reader(file, strict=True))
    except (OSError, ValueError, csv.Error) as error:
        raise InvalidInputError(f"log: got {path} ({error}), expected a CSV file") from error
    header = [name.strip() for name in lines[0]] if lines else []
    known = ("time", *COMMANDED, *POSE, *TWIST)
    wrong = [name for name in header if name not in known or header.count(name) > 1]
    sideways = ("cmd_vy",) if "cmd_vy" in header else ()
    twist = ("vx", *(("vy",) if sideways or "vy" in header else ()), "w")
    commanded = ("cmd_vx", *sideways, "cmd_w")
    has_pose, has_twist = set(POSE) <= set(header), set(twist) <= set(header)
    if wrong or not {"time", *commanded} <= set(header) or not (has_pose or has_twist):
        raise InvalidInputError(
            f"log: got the columns {header}, expected time, {', '.join(commanded)}, and "
            f"{', '.join(POSE)} or {', '.join(twist)} or both, among {list(known)}"
        )
    rows = [(k, row) for k, row in enumerate(lines[1:], start=2) if any(map(str.strip, row))]
    table = np.array([_numbers(row, len(header), k) for k, row in rows]).reshape(-1, len(header))
    columns = dict(zip(header, table.T, strict=True))
    time = columns["time"]
    back = np.flatnonzero(np.diff(time) < 0.0)
    if np.isnan(time).any() or len(back):
        at = int(np.isnan(time).argmax()) if np.isnan(time).any() else int(back[0]) + 1
        raise InvalidInputError(
            f"log: line {rows[at][0]}: got the time {time[at]:.10g}, expected a time that is not "
            "before that of the line above: all times of one clock, in their order"
        )
    nothing = np.full(len(time), np.nan)
    zero = np.zeros(len(time))
    parts = {name: columns.get(name, zero if name == "vy" else nothing) for name in (*POSE, *TWIST)}
    pose = np.column_stack([parts[name] for name in POSE])
    moves = np.column_stack([parts[name] for name in TWIST])
    commands = np.column_stack([columns[name] for name in commanded])
    is_commanded = np.isfinite(commands).all(axis=1)
    measured: Mask = np.logical_and.reduce(np.isfinite(moves), axis=1)
    if not measured.any():
        measured = np.logical_and.reduce(np.isfinite(pose), axis=1)
    measured[1:] &= ~(measured[1:] & measured[:-1] & (np.diff(time) == 0.0))
    log = Log(
        time[is_commanded], commands[is_commanded], time[measured], pose[measured], moves[measured]
    )
    _check_times(log)
    return log


def _numbers(row: list[str], count: int, line: int) -> list[float]:
    """Return a line's numbers; NaN for empty cells."""
    if len(row) != count:
        raise InvalidInputError(f"log: line {line}: got {len(row)} cells, expected {count}")
    found = []
    for cell in map(str.strip, row):
        try:
            found.append(float(cell) if cell else math.nan)
        except ValueError:
            found.append(math.inf)
        if cell and not math.isfinite(found[-1]):
            raise InvalidInputError(f"log: line {line}: got {cell!r}, expected a finite number")
    return found


def _check_times(log: Log) -> None:
    """Refuse logs that are too short, too sparse, or of two clocks that do not meet."""
    if len(log.time) < 3 or len(log.commanded) < 2:
        raise InvalidInputError(
            f"log: got {len(log.commanded)} commands and {len(log.time)} measurements; {DRIVE}"
        )
    start, end = log.time[0], log.time[-1]
    if log.commanded_at[0] > end or log.commanded_at[-1] < start:
        raise InvalidInputError(
            f"log: got commands from {log.commanded_at[0]:.10g} to {log.commanded_at[-1]:.10g} s "
            f"and measurements from {start:.10g} to {end:.10g} s, expected the same clock for both"
        )
    if end - start < SHORTEST:
        raise InvalidInputError(
            f"log: got {end - start:.3g} s, expected at least {SHORTEST:g} s; {DRIVE}"
        )
    apart = np.diff(log.time)
    if apart.max() > GAP or np.median(apart) > SLOWEST:
        raise InvalidInputError(
            f"log: got {apart.max():.3g} s without a measurement, and {np.median(apart):.3g} s "
            f"between two in the median, expected at most {GAP:g} and {SLOWEST:g} s"
        )


def _command(log: Log, look_ahead: float | None) -> Command:
    """Return the greatest that the robot was commanded."""
    most = np.abs(log.commanded).max(axis=0)
    _check_commanded(log, most)
    if len(most) == 2 and look_ahead is None:
        raise InvalidInputError(
            "look_ahead: got None, expected how far before the axle the point lies that follows "
            "[m], as the robot's Command will have it: --look-ahead 0.1"
        )
    if len(most) == 2:
        return Command(forward=float(most[0]), turn=float(most[1]), look_ahead=look_ahead)
    return Command(
        forward=float(most[0]), sideways=float(most[1]), turn=float(most[2]), look_ahead=look_ahead
    )


def _check_varies(log: Log, command: Command) -> None:
    """Refuse logs in which an entry of the command hardly changes."""
    _check_commanded(log, WHOLE * command.limits)
    greatest = np.abs(log.commanded).max(axis=0)
    varied = np.abs(np.diff(log.commanded, axis=0, prepend=0.0)).sum(axis=0) / greatest
    for name, times in zip(_names(log), varied, strict=True):
        if times < VARIES:
            raise InvalidInputError(
                f"log: {name}: got a command that hardly changes, which does not show how the "
                f"robot follows it; {DRIVE}"
            )


def _check_commanded(log: Log, least: Array) -> None:
    """Refuse logs in which an entry was commanded less than (k,) some value, or nothing."""
    greatest = np.abs(log.commanded).max(axis=0)
    for name, most, needed in zip(_names(log), greatest, least, strict=True):
        if most < needed or most == 0.0:
            raise InvalidInputError(
                f"log: {name}: got at most {most:g}, which does not show how the robot follows; "
                f"{DRIVE}"
            )


def _names(log: Log) -> tuple[str, ...]:
    return COMMANDED if log.commanded.shape[1] == 3 else (COMMANDED[0], COMMANDED[2])


def _from_pose(time: Array, pose: Array) -> tuple[Array, Array]:
    """Return (n − 1,) times between the poses, and (n − 1, 3) the twist there."""
    apart = np.diff(time)
    yaw = np.unwrap(pose[:, 2])
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    dx, dy = np.diff(pose[:, :2], axis=0).T / apart
    cos, sin = np.cos(middle), np.sin(middle)
    twist = np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, np.diff(yaw) / apart])
    return 0.5 * (time[1:] + time[:-1]), twist


def _check_agrees(log: Log) -> None:
    """Refuse logs whose pose contradicts the twist."""
    both = np.isfinite(log.pose).all(axis=1) & np.isfinite(log.twist).all(axis=1)
    if both.sum() < 3:
        return
    time, twist = log.time[both], log.twist[both]
    at, derived = _from_pose(time, log.pose[both])
    window = max(1, round(WITHIN / float(np.median(np.diff(time)))))
    smooth = np.ones(window) / window
    for k, (name, unit) in enumerate(zip(TWIST, UNITS, strict=True)):
        given = np.convolve(np.interp(at, time, twist[:, k]), smooth, "valid")
        moved = np.convolve(derived[:, k], smooth, "valid")
        size = float(np.sqrt(np.mean(given**2)))
        off = float(np.sqrt(np.mean((moved - given) ** 2)))
        least = float(np.sqrt(np.mean(log.commanded[:, min(k, log.commanded.shape[1] - 1)] ** 2)))
        if off > AGREES * max(size, 0.5 * least):
            ratio = float(moved @ given) / max(float(given @ given), 1e-12)
            why = ": is it in degrees?" if k == 2 and _is_degrees(ratio) else ""
            raise InvalidInputError(
                f"log: pose and twist disagree: {name} is {size:.3g} {unit} by the twist in the "
                f"mean, and the pose moves {ratio:.3g} times as fast{why}; expected the twist of "
                "the same centre, in the robot's own axes, in m, s and rad"
            )


def _record(log: Log, command: Command) -> Record:
    """Return what was done every `CONTROL_DT`, and what was commanded until the next in the mean.

    Commands come between these times: one that counted from the next on would come late.
    """
    time = np.arange(log.time[0], log.time[-1], CONTROL_DT)
    commanded = _means(log.commanded_at, log.commanded, np.append(time, time[-1] + CONTROL_DT))
    at, twist = log.time, log.twist
    if not np.isfinite(twist).all():
        at, twist = _from_pose(log.time, log.pose)
    done = np.column_stack([np.interp(time, at, entry) for entry in twist.T])
    if command.look_ahead is not None:
        done = np.column_stack([done[:, 0], done[:, 2] + done[:, 1] / command.look_ahead])
    return Record(commanded, done)


def _means(at: Array, held: Array, edges: Array) -> Array:
    """Return (n, k) the means between n + 1 times of what is held from other times on."""
    ends = np.append(at, max(edges[-1], at[-1]))
    steps = np.diff(ends)[:, None] * held
    area = np.vstack([np.zeros_like(held[:1]), steps.cumsum(axis=0)])
    within = np.column_stack([np.interp(edges, ends, entry) for entry in area.T])
    return np.diff(within, axis=0) / np.diff(edges)[:, None]


def _within_reach(record: Record) -> Array:
    """Return (n, k) commands that change no faster than the robot ever did."""
    steps = round(CHANGES / CONTROL_DT)
    fastest = np.abs(record.done[steps:] - record.done[:-steps]).max(axis=0) / CHANGES
    slewed, now = np.empty_like(record.command), record.command[0]
    for k, command in enumerate(record.command):
        now = now + np.clip(command - now, -CONTROL_DT * fastest, CONTROL_DT * fastest)
        slewed[k] = now
    return slewed


def _check_clock(record: Record, apart: float) -> None:
    """Refuse logs in which what was done comes before what was commanded, or a second after it."""
    commanded, done = record.command[:, 0], record.done[:, 0]
    early, steps = round(EARLIEST / CONTROL_DT), round(LATEST / CONTROL_DT)
    # what is done at rest follows changes: the delay at which both correlate best is δ + τ or so
    shifts = np.arange(-steps, steps + 1)
    padded = np.concatenate([np.zeros(steps), done, np.zeros(steps)])
    count = len(commanded)
    alike = np.array([abs(commanded @ padded[steps + k :][:count]) for k in shifts])
    best = int(shifts[alike.argmax()])
    if best < -early:
        raise InvalidInputError(
            f"log: the robot moves {-best * CONTROL_DT:.2f} s before it is commanded to, expected "
            "one clock for commands and measurements"
        )
    if best >= steps:
        raise InvalidInputError(
            f"log: the robot moves {LATEST:g} s or more after it is commanded to, expected one "
            "clock for commands and measurements, and a robot that follows within "
            f"{LONGEST_DELAY:g} s"
        )
    onset = _onset(record)
    if onset is not None and onset < -(EARLIEST + 0.5 * apart):
        raise InvalidInputError(
            f"log: after rests the robot moves {-onset:.2f} s before it is commanded to, expected "
            "one clock for commands and measurements: its lag would hide how late commands are "
            "stamped"
        )
    if abs(float(analysis.late(commanded, max(best, 0) * CONTROL_DT, CONTROL_DT) @ done)) == 0.0:
        raise InvalidInputError(f"log: the robot does not move; {DRIVE}")


def _onset(record: Record) -> float | None:
    """Return by how much later than commanded the robot begins to move after rests, the median [s].

    None where there is no rest, or noise hides it.
    """
    rest, window = round(RESTS / CONTROL_DT), round(SMOOTHED / CONTROL_DT)
    found = []
    for commanded, done in zip(record.command.T, record.done.T, strict=True):
        size, moved = np.abs(commanded), np.abs(np.convolve(done, np.ones(window) / window, "same"))
        least, rests = BEGINS * moved.max(), size <= RESTING * size.max()
        for k in np.flatnonzero(~rests[1:] & rests[:-1]) + 1:
            if k < rest or not rests[k - rest : k].all() or moved[k - rest // 2] > 0.5 * least:
                continue
            moves = np.flatnonzero(moved[k - rest // 2 : k + rest // 2] >= least)
            if len(moves) and size[k : k + rest // 2].max() > 0.5 * size.max():
                found.append((int(moves[0]) - rest // 2) * CONTROL_DT)
    return float(np.median(found)) if found else None


def _check_rolls(log: Log, command: Command) -> None:
    """Refuse poses of a differential drive that slides: yaw is off, or an axis is mirrored."""
    if command.look_ahead is None or np.isfinite(log.twist).all():
        return
    at, twist = _from_pose(log.time, log.pose)
    window = max(1, round(WITHIN / float(np.median(np.diff(at)))))
    smooth = [np.convolve(entry, np.ones(window) / window, "valid") for entry in twist.T]
    ahead, across, turning = smooth
    causes = np.column_stack([ahead, turning])
    share = np.linalg.lstsq(causes, across, rcond=None)[0]
    slides = float(np.std(across - causes @ share)) / max(float(np.std(ahead)), 1e-12)
    if abs(share[0]) > math.tan(YAW_OFF) or slides > SLIDES:
        raise InvalidInputError(
            f"log: the pose slides: across the yaw it moves {share[0]:+.2f} times as fast as along "
            f"it, and {slides:.2f} times besides, which an axle does not: expected the yaw of the "
            "robot's own heading, and x, y and yaw of one frame, none of them mirrored"
        )


def _check_degrees(record: Record) -> None:
    """Refuse logs in which a turning rate is in degrees."""
    commanded, done = record.command[:, -1], record.done[:, -1]
    ratio = float(np.std(done)) / float(np.std(commanded))
    if _is_degrees(ratio):
        raise InvalidInputError(
            f"log: w: the robot turns {ratio:.3g} times as fast as it is commanded, expected rad "
            "and rad/s: is one of them in degrees?"
        )


def _is_degrees(ratio: float) -> bool:
    least, most = DEGREES
    return least < abs(ratio) < most or 1.0 / most < abs(ratio) < 1.0 / least


def _stops(record: Record, command: Command) -> list[Stop]:
    """Return the stops from speed."""
    commanded = command.in_plane(record.command)
    moved = command.in_plane(record.done)
    speed = (
        np.abs(record.command[:, 0]) if command.look_ahead is not None else np.hypot(*commanded.T)
    )
    fast, still = speed >= WHOLE * speed.max(), np.hypot(*commanded.T) <= 0.05 * speed.max()
    before, after, ramp = (round(one / CONTROL_DT) for one in (BEFORE, AFTER, RAMP))
    found = []
    for k in range(before, len(commanded) - after - ramp):
        if not (fast[k - before : k].all() and not fast[k]):
            continue
        rest = k + int(still[k : k + ramp].argmax())
        if still[rest : rest + after].all():
            until = rest + after
            while until < min(len(commanded), rest + 2 * after) and still[until]:
                until += 1
            found.append(analysis.stop_of(moved[k - before : k], moved[k:until]))
    if not found:
        raise InvalidInputError(
            f"log: got no stop from at least half of the greatest speed, held for {BEFORE:g} s, to "
            f"zero, held for {AFTER:g} s; {DRIVE}"
        )
    return found
