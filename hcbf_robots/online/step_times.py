"""The times of a velocity filter's steps: missing samples, a clock that goes back, and validity."""

import math

from hcbf_gym.models.clocks import ROUNDING

LATE_AFTER = 1.1
"""Periods without a step after which a sample is missing, and the command was zero."""
LEAP = 1.0
"""A present that is farther ahead of the last one may be wrong: the next may go back [s]."""


class StepTimes:
    """The times of the steps of a filter with a period T [s], on the robot's clock.

    Attributes:
        accepted_at: the present of the last step whose state was accepted [s]; None if samples have
            been missing since then.
        valid_until: the time from which on the last command is invalid [s].
    """

    def __init__(self, period: float):
        self._period = period
        self.forget()

    def forget(self) -> None:
        """Begin without any step."""
        self.accepted_at: float | None = None
        self._first = math.inf  # the first present [s], which is time 0 of the filter
        self._valid_from = self.valid_until = -math.inf
        self._last = self._before_leap = math.nan  # the last present, and that before a leap [s]

    def go_on_from(self, other: "StepTimes") -> None:
        """Take the times of another filter."""
        self.accepted_at, self.valid_until = other.accepted_at, other.valid_until
        self._valid_from, self._first = other._valid_from, other._first
        self._last, self._before_leap = other._last, other._before_leap

    def note_present(self, present: float) -> bool:
        """Note the present of a step [s]; return whether it goes back to before a wrong leap."""
        goes_back = self._before_leap < present <= self._last
        if math.isinf(self._before_leap):
            goes_back = self._last - present > LEAP
        if goes_back:
            self._first, self.accepted_at = min(self._first, present), None
        if math.isfinite(present):
            self._first = present if self._first == math.inf else self._first
            last = -math.inf if math.isnan(self._last) else self._last  # the first counts as a leap
            self._before_leap = last if present - last > LEAP else math.nan
            self._last = present
        return goes_back

    @property
    def zero(self) -> float:
        """The present at which the filter's time was 0 [s]."""
        return 0.0 if self._first == math.inf else self._first

    def is_missing(self, present: float) -> bool:
        """Return whether a sample was due before the present [s]."""
        last = self.accepted_at
        return last is not None and present - last > LATE_AFTER * self._period

    def elapsed(self, present: float) -> float | None:
        """Return the time since the last accepted step [s]; None without one before the present."""
        last = self.accepted_at
        return present - last if last is not None and present > last else None

    def note_command(self, present: float) -> None:
        """Note that a command is valid from the present [s] for one period."""
        self._valid_from = present
        self.valid_until = present + self._period if math.isfinite(present) else -math.inf

    def is_valid_at(self, now: float) -> bool:
        """Return whether the last command is valid at a time [s]."""
        return self._valid_from - ROUNDING <= now <= self.valid_until
