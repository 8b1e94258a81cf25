"""Refuses logs from which a response would be wrong: other units, axes or clocks, few commands."""

import math

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import InvalidInputError
from hcbf_robots.identification.analysis import LONGEST_DELAY, Record, delayed
from hcbf_robots.identification.log_file import HOW_TO_DRIVE, TWIST_COLUMNS, Log, twist_of_pose
from hcbf_robots.walkers.walker_parts import Command

TWIST_UNITS = ("m/s", "m/s", "rad/s")
COMMANDED_SHARE = 0.5  # share of each limit that the log must command
LEAST_VARIATION = 4.0  # changes of an entry, added up, as multiples of its greatest value
SMOOTHING_WINDOW = 0.5  # over which twists are averaged before they are compared [s]
DISAGREEMENT = 0.25  # share by which pose and twist may differ
LARGEST_YAW_ERROR = 0.09  # of the pose of a differential drive [rad]
SLIDING_SHARE = 0.3  # share of its speed with which an axle may move sideways, by noise

EARLIEST_MOTION, LATEST_MOTION = 0.06, 1.0  # before and after its command [s]
REST_TIME = 1.0  # a rest is commanded at least as long [s]
REST_COMMAND = 0.02  # the greatest command in a rest, as a share of the greatest at all
ONSET_MOTION = 0.2  # the motion that ends a rest, as a share of the greatest
ONSET_SMOOTHING = 0.1  # over which the motion is averaged before its onset is looked for [s]
DEGREE_RATIOS = (30.0, 120.0)  # a ratio of turning rates in this range comes from degrees (57.3)


def check_commanded(log: Log, least: Array) -> None:
    """Refuse logs in which an entry is never commanded, or never as much as `least` (k,)."""
    greatest = np.abs(log.commands).max(axis=0)
    for name, largest, needed in zip(log.command_names, greatest, least, strict=True):
        if largest < needed or largest == 0.0:
            raise InvalidInputError(
                f"log: {name}: got at most {largest:g}, which does not show how the robot follows; "
                f"{HOW_TO_DRIVE}"
            )


def check_variation(log: Log, command: Command) -> None:
    """Refuse logs in which an entry of the command is small, or hardly changes."""
    check_commanded(log, COMMANDED_SHARE * command.limits)
    changes = np.abs(np.diff(log.commands, axis=0, prepend=0.0)).sum(axis=0)
    variations = changes / np.abs(log.commands).max(axis=0)
    for name, variation in zip(log.command_names, variations, strict=True):
        if variation < LEAST_VARIATION:
            raise InvalidInputError(
                f"log: {name}: got a command that hardly changes, which does not show how the "
                f"robot follows it; {HOW_TO_DRIVE}"
            )


def check_agreement(log: Log) -> None:
    """Refuse logs whose pose contradicts the twist."""
    has_both = np.isfinite(log.pose).all(axis=1) & np.isfinite(log.twist).all(axis=1)
    if has_both.sum() < 3:
        return
    time, measured = log.time[has_both], log.twist[has_both]
    derived_times, derived = twist_of_pose(time, log.pose[has_both])
    average = _averaging(time)
    last_entry = log.commands.shape[1] - 1
    for k, (name, unit) in enumerate(zip(TWIST_COLUMNS, TWIST_UNITS, strict=True)):
        by_twist = np.convolve(np.interp(derived_times, time, measured[:, k]), average, "valid")
        by_pose = np.convolve(derived[:, k], average, "valid")
        size, difference = _root_mean_square(by_twist), _root_mean_square(by_pose - by_twist)
        commanded = _root_mean_square(log.commands[:, min(k, last_entry)])
        if difference > DISAGREEMENT * max(size, 0.5 * commanded):
            ratio = float(by_pose @ by_twist) / max(float(by_twist @ by_twist), 1e-12)
            hint = ": is it in degrees?" if name == "w" and _is_degrees(ratio) else ""
            raise InvalidInputError(
                f"log: pose and twist disagree: {name} is {size:.3g} {unit} by the twist in the "
                f"mean, and the pose moves {ratio:.3g} times as fast{hint}; expected the twist of "
                "the same centre, in the robot's own axes, in m, s and rad"
            )


def check_rolling(log: Log, command: Command) -> None:
    """Refuse poses in which a differential drive slides: the yaw is off, or an axis is mirrored.

    The sideways speed is fitted by the forward speed, whose share is the yaw's error, and by the
    turning rate, as the pose may be measured before the axle. The remainder is sliding.
    """
    if command.look_ahead is None or np.isfinite(log.twist).all():
        return
    time, twist = twist_of_pose(log.time, log.pose)
    average = _averaging(time)
    ahead, aside, turning = (np.convolve(entry, average, "valid") for entry in twist.T)
    causes = np.column_stack([ahead, turning])
    shares = np.linalg.lstsq(causes, aside, rcond=None)[0]
    sliding = float(np.std(aside - causes @ shares)) / max(float(np.std(ahead)), 1e-12)
    if abs(shares[0]) > math.tan(LARGEST_YAW_ERROR) or sliding > SLIDING_SHARE:
        raise InvalidInputError(
            f"log: the pose slides: across the yaw it moves {shares[0]:+.2f} times as fast as "
            f"along it, and {sliding:.2f} times besides, which an axle does not: expected the yaw "
            "of the robot's own heading, and x, y and yaw of one frame, none of them mirrored"
        )


def _averaging(time: Array) -> Array:
    """Return the weights of a mean over `SMOOTHING_WINDOW` of samples at these times."""
    window = max(1, round(SMOOTHING_WINDOW / float(np.median(np.diff(time)))))
    return np.ones(window) / window


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def check_clock(record: Record, sample_interval: float) -> None:
    """Refuse logs, measured at an interval [s], in which motion precedes commands or is late."""
    commanded, done = record.command[:, 0], record.done[:, 0]
    earliest, latest = round(EARLIEST_MOTION / CONTROL_DT), round(LATEST_MOTION / CONTROL_DT)
    delay = _most_correlated_delay(commanded, done, latest)
    if delay < -earliest:
        raise InvalidInputError(
            f"log: the robot moves {-delay * CONTROL_DT:.2f} s before it is commanded to, expected "
            "one clock for commands and measurements"
        )
    if delay >= latest:
        raise InvalidInputError(
            f"log: the robot moves {LATEST_MOTION:g} s or more after it is commanded to, expected "
            "one clock for commands and measurements, and a robot that follows within "
            f"{LONGEST_DELAY:g} s"
        )
    entries = zip(record.command.T, record.done.T, strict=True)
    onsets = [onset for entry in entries for onset in _onsets(*entry)]
    onset = float(np.median(onsets)) if onsets else 0.0
    # measurements show an onset up to half of their interval too early
    if onset < -(EARLIEST_MOTION + 0.5 * sample_interval):
        raise InvalidInputError(
            f"log: after rests the robot moves {-onset:.2f} s before it is commanded to, expected "
            "one clock for commands and measurements: its lag would hide how late commands are "
            "stamped"
        )
    if float(delayed(commanded, max(delay, 0) * CONTROL_DT, CONTROL_DT) @ done) == 0.0:
        raise InvalidInputError(f"log: the robot does not move; {HOW_TO_DRIVE}")


def _most_correlated_delay(commanded: Array, done: Array, longest: int) -> int:
    """Return the delay of the motion, within ± longest steps, that correlates best: about τ + δ."""
    padded = np.concatenate([np.zeros(longest), done, np.zeros(longest)])
    count = len(commanded)
    correlations = [abs(commanded @ padded[k : k + count]) for k in range(2 * longest + 1)]
    return int(np.argmax(correlations)) - longest


def _onsets(commanded: Array, done: Array) -> list[float]:
    """Return how long after its command each clear motion from rest begins [s]."""
    rest, half_rest = round(REST_TIME / CONTROL_DT), round(0.5 * REST_TIME / CONTROL_DT)
    window = round(ONSET_SMOOTHING / CONTROL_DT)
    command = np.abs(commanded)
    motion = np.abs(np.convolve(done, np.ones(window) / window, "same"))
    threshold = ONSET_MOTION * motion.max()
    is_rest = command <= REST_COMMAND * command.max()
    onsets = []
    for end in np.flatnonzero(is_rest[:-1] & ~is_rest[1:]) + 1:
        if end < rest or not is_rest[end - rest : end].all():
            continue
        is_noisy = motion[end - half_rest] > 0.5 * threshold
        is_weak = command[end : end + half_rest].max() <= 0.5 * command.max()
        moving = np.flatnonzero(motion[end - half_rest : end + half_rest] >= threshold)
        if len(moving) and not is_noisy and not is_weak:
            onsets.append((int(moving[0]) - half_rest) * CONTROL_DT)
    return onsets


def check_degrees(record: Record) -> None:
    """Refuse logs in which a turning rate is in degrees."""
    commanded, done = record.command[:, -1], record.done[:, -1]
    ratio = float(np.std(done)) / float(np.std(commanded))
    if _is_degrees(ratio):
        raise InvalidInputError(
            f"log: w: the robot turns {ratio:.3g} times as fast as it is commanded, expected rad "
            "and rad/s: is one of them in degrees?"
        )


def _is_degrees(ratio: float) -> bool:
    """Return whether one of two rates with this ratio is in degrees, the other in radians."""
    low, high = DEGREE_RATIOS
    return low < abs(ratio) < high or 1.0 / high < abs(ratio) < 1.0 / low
