"""When barriers that move were where they are put: from then the filter's time counts."""

import math

from hcbf_gym.errors import SafetyWarning, warn_caller

ROUNDING = 1e-9
"""By how much a present may seem to be before its past [s]."""
SEEN_FOR = 60.0
"""Barriers that were seen longer ago, or on another clock, are not believed [s]."""


class BarrierClock:
    """Counts from when barriers were seen, or from the first present since the reset.

    Args:
        max_age: how far ahead of the present a stamp may be [s].

    Attributes:
        seen_at: when the barriers were seen, on the robot's clock [s]; None for the first present.
        is_sound: whether that can be a stamp of the robot's clock.
    """

    def __init__(self, max_age: float):
        self._max_age = max_age
        self.seen_at: float | None = None
        self.forget()

    def forget(self) -> None:
        """Let the next present be the first."""
        self._first = math.inf  # present since the reset [s]
        self._zero: float | None = None  # from which time counts [s]
        self.is_sound = True

    def begin(self, present: float) -> None:
        """Begin anew at a present [s] that may be before the first."""
        self._first, self._zero = min(self._first, present), None

    def look(self, present: float) -> float:
        """Note a present [s], and return by how much later time counts from now on [s].

        Warns of a stamp that is none of the robot's clock, once in a row.
        """
        if not math.isfinite(present):
            return 0.0
        if self._first == math.inf:
            self._first = present
        zero = self._first if self.seen_at is None else self.seen_at
        was_sound, ahead = self.is_sound, self._max_age + ROUNDING
        self.is_sound = self.seen_at is None or -ahead <= present - zero <= SEEN_FOR
        if not self.is_sound:
            if was_sound:
                warn_caller(
                    f"velocity filter: seen_at: got {zero:.9g} s at {present:.9g} s, expected a "
                    f"stamp of the robot's clock, {self._max_age:g} s ahead at most and "
                    f"{SEEN_FOR:g} s behind; the robot is told zero until there is one",
                    SafetyWarning,
                )
            return 0.0
        later = 0.0 if self._zero is None else zero - self._zero
        self._zero = zero
        return later

    def since(self, present: float) -> float:
        """Return the time at a present [s]."""
        return present - (self._zero or 0.0)
