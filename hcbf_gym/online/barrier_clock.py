"""The clock of a filter in a loop of the user's own: its time 0, and when barriers were seen."""

import math

from hcbf_gym.errors import SafetyWarning, warn_caller

ROUNDING = 1e-9
"""By how much a present may seem to be before its past [s]."""
SEEN_FOR = 60.0
"""Barriers that were seen longer ago, or on another clock, are not believed [s]."""


class BarrierClock:
    """Counts from the first present since the reset.

    Args:
        max_age: how far ahead of the present a stamp may be [s].

    Attributes:
        seen_at: when the barriers were seen, on the robot's clock [s]; None for when a step first
            reads them.
        is_sound: whether that can be a stamp of the robot's clock.
    """

    def __init__(self, max_age: float):
        self._max_age = max_age
        self.seen_at: float | None = None
        self.forget()

    def forget(self) -> None:
        """Let the next present be the first."""
        self._first = math.inf  # present since the reset [s]
        self.is_sound = True

    def begin(self, present: float) -> None:
        """Begin anew at a present [s] that may be before the first."""
        self._first = min(self._first, present)

    def go_on_from(self, other: "BarrierClock") -> None:
        """Count from when another clock does."""
        self._first = other._first

    def look(self, present: float) -> None:
        """Note a present [s]; warn of a stamp that is none of the robot's clock, once in a row."""
        if not math.isfinite(present):
            return
        if self._first == math.inf:
            self._first = present
        was_sound, seen_at = self.is_sound, self.seen_at
        ahead = self._max_age + ROUNDING
        self.is_sound = seen_at is None or -ahead <= present - seen_at <= SEEN_FOR
        if was_sound and not self.is_sound:
            warn_caller(
                f"velocity filter: seen_at: got {seen_at:.9g} s at {present:.9g} s, expected a "
                f"stamp of the robot's clock, {self._max_age:g} s ahead at most and "
                f"{SEEN_FOR:g} s behind; the robot is told zero until there is one",
                SafetyWarning,
            )

    def since(self, present: float) -> float:
        """Return the time at a present [s]."""
        return present - (0.0 if self._first == math.inf else self._first)

    @property
    def since_seen(self) -> float | None:
        """The time at which the barriers were seen [s]; None for when a step first reads them."""
        return None if self.seen_at is None else self.since(self.seen_at)
