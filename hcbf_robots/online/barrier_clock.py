"""The clock of a filter in a loop of the user's own: its time 0, and when barriers were seen."""

import math

from hcbf_gym.errors import SafetyWarning, warn_caller
from hcbf_gym.models import clocks
from hcbf_gym.models.clocks import SEEN_FOR


class BarrierClock:
    """Counts from the first present since the reset.

    Attributes:
        seen_at: when the barriers were seen, on the robot's clock [s]; None for when a step first
            reads them.
        is_sound: whether that can be a stamp of the robot's clock.
    """

    def __init__(self) -> None:
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
        """Count from the first present of another clock."""
        self._first = other._first

    def look(self, present: float) -> None:
        """Note a present [s]; warn of a stamp of another clock, once in a row."""
        if not math.isfinite(present):
            return
        self._first = present if self._first == math.inf else self._first
        was_sound, seen_at = self.is_sound, self.seen_at
        age = 0.0 if seen_at is None else present - seen_at
        self.is_sound = bool(clocks.is_accepted(age, SEEN_FOR))
        if was_sound and not self.is_sound and seen_at is not None:
            warn_caller(
                f"velocity filter: seen_at: got {seen_at:.9g} s at {present:.9g} s, expected a "
                f"stamp of the robot's clock ({clocks.refusal(age, SEEN_FOR)}); the command is "
                "zero until there is one",
                SafetyWarning,
            )

    @property
    def zero(self) -> float:
        """The present at which time was 0 [s]."""
        return 0.0 if self._first == math.inf else self._first

    def since(self, present: float) -> float:
        """Return the time at a present [s]."""
        return present - self.zero

    @property
    def since_seen(self) -> float | None:
        """The time at which the barriers were seen [s]; None for when a step first reads them."""
        return None if self.seen_at is None else self.since(self.seen_at)
