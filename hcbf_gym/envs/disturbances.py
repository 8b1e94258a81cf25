"""Pushes at the trunk, the same in every episode or random ones."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, finite_array, finite_float
from hcbf_gym.records import check_mapping, from_dict

MAX_PUSHES = 10_000  # random pushes in an episode, through which every tick looks
MAX_TIME = 1e5  # greatest time or duration in a schedule [s]
MAX_FORCE = 1e5  # greatest force of a push along an axis [N]


class Push(NamedTuple):
    """A constant force at the trunk's centre of mass."""

    time: float  # the time of its start since the reset [s]
    duration: float  # [s]
    force: Array  # (3,) in the world's axes [N]


@dataclass(frozen=True)
class ScheduledPushes:
    """The same pushes in every episode.

    Args:
        pushes: mappings with ``time`` [s], ``duration`` [s] and ``force`` (3,) [N].

    Raises:
        InvalidInputError: on a missing or unknown entry, or a number out of range.
    """

    pushes: Sequence[Mapping[str, object]]

    def __post_init__(self) -> None:
        if not isinstance(self.pushes, list | tuple):
            raise InvalidInputError(f"pushes: got {self.pushes!r}, expected a list")
        self.draw(np.random.default_rng(0))

    def draw(self, rng: np.random.Generator) -> list[Push]:
        """Return the pushes, without use of `rng`."""
        return [_push(entry) for entry in self.pushes]


@dataclass(frozen=True)
class RandomPushes:
    """Horizontal pushes in random directions, one in every interval at a random instant.

    Args:
        interval: average time between two pushes [s].
        impulse: (low, high) range from which each impulse is drawn uniformly [N·s].
        duration: duration of each push [s].
        until: latest time at which a push may start [s].

    Raises:
        InvalidInputError: on a number out of range.
    """

    interval: float
    impulse: tuple[float, float]
    duration: float = 0.1
    until: float = 20.0

    def __post_init__(self) -> None:
        for name in ("interval", "duration", "until"):
            finite_float(name, getattr(self, name), minimum=0.0, maximum=MAX_TIME, exclusive=True)
        low, high = finite_array("impulse", self.impulse, (2,))
        if not 0.0 <= low <= high:
            raise InvalidInputError(f"impulse: got {self.impulse!r}, expected 0 <= low <= high")
        if self.until / self.interval > MAX_PUSHES:
            raise InvalidInputError(
                f"interval: got {self.interval} s until {self.until} s, expected at most "
                f"{MAX_PUSHES} pushes"
            )
        finite_float("impulse / duration [N]", high / self.duration, maximum=MAX_FORCE)

    def draw(self, rng: np.random.Generator) -> list[Push]:
        """Draw the pushes of one episode."""
        pushes = []
        for start in np.arange(0.0, self.until - 0.5 * self.interval, self.interval):
            direction = rng.uniform(-np.pi, np.pi)
            strength = rng.uniform(*self.impulse) / self.duration
            force = strength * np.array([np.cos(direction), np.sin(direction), 0.0])
            pushes.append(Push(start + rng.uniform(0.0, self.interval), self.duration, force))
        return pushes


_KINDS = {"scheduled": ScheduledPushes, "random": RandomPushes}


def disturbance_from_dict(values: Mapping[str, object] | None) -> ScheduledPushes | RandomPushes:
    """Return the pushes of a plain dict ``{"kind": "scheduled" | "random", …}``; None has none.

    Raises:
        InvalidInputError: on an unknown kind or entry, or a number out of range.
    """
    return ScheduledPushes([]) if values is None else from_dict("disturbances", values, _KINDS)


def _push(entry: Mapping[str, object]) -> Push:
    """Return a push from its plain dict, with every number checked."""
    check_mapping("push", entry)
    if set(entry) != set(Push._fields):
        raise InvalidInputError(f"push: got {sorted(entry)}, expected {sorted(Push._fields)}")
    time, duration = entry["time"], entry["duration"]
    return Push(
        finite_float("push time", time, minimum=0.0, maximum=MAX_TIME),
        finite_float("push duration", duration, minimum=0.0, maximum=MAX_TIME, exclusive=True),
        finite_array("push force", entry["force"], (3,), largest=MAX_FORCE),
    )
