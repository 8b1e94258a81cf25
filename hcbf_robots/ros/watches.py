"""Faults of messages and clocks, found by two clocks.

Stamps count on the node's clock, which a simulator or a bag may drive. The arrival of messages
counts on the steady clock, which nothing stops.
"""

import math
import sys
from typing import NamedTuple

from hcbf_gym.models import clocks


class Now(NamedTuple):
    """The present on both clocks [s]."""

    ros: float  # on the node's clock
    steady: float  # on a clock that is never set


class Fault(NamedTuple):
    """Why the robot's velocity is zero."""

    source: str  # "command", "odometry", "clock", a source's name, …
    message: str
    is_stale: bool = False  # whether nothing is wrong but that no newer message came

    def __str__(self) -> str:
        return f"{self.source}: {self.message}"


class HeldFault(NamedTuple):
    """A fault that lasts for a while, such as after a jump of the pose; at first there is none."""

    fault: Fault | None = None
    until: float = -math.inf  # a time of the steady clock [s]

    def at(self, now: Now) -> Fault | None:
        """Return the fault while it lasts, else None."""
        return None if now.steady >= self.until else self.fault


class Watch:
    """Checks the stamps, frames and ages of one kind of message.

    Args:
        name: the source of its faults.
        timeout: the age at which a message is stale [s]; 0 for never.
        tolerance: the time by which a stamp may be ahead of the clock [s].
    """

    def __init__(self, name: str, timeout: float, tolerance: float):
        self._name, self.timeout, self._tolerance = name, timeout, tolerance
        self.forget()

    def forget(self) -> None:
        """Return to the state in which no message has come."""
        self.stamp = self._received = -math.inf  # of the newest message, and when it came [s]
        self._wrong = ""

    def set_known(self) -> None:
        """Require no message: a file or a parameter has the values."""
        self.stamp, self._wrong = -sys.float_info.max, ""

    def forget_stamp(self) -> None:
        """Accept earlier stamps after the clock has gone back; drop a message with a time-out."""
        if self.timeout > 0.0 and math.isfinite(self._received):
            self.forget()
        elif self.stamp > -math.inf:
            self.set_known()

    def hear(self, stamp: float, now: Now, frame: str = "", expected: str = "") -> bool:
        """Accept a message; return False if its stamp [s] or frame is wrong, or it is not newer."""
        age = now.ros - stamp
        if expected and frame != expected:
            return self.refuse(f"frame {frame!r}, expected {expected!r}")
        if not math.isfinite(stamp):
            return self.refuse(f"stamp {stamp}")
        if not clocks.is_accepted(age, math.inf, self._tolerance):
            return self.refuse(clocks.refusal(age, math.inf, self._tolerance))
        if stamp <= self.stamp:
            return False
        self.stamp, self._received, self._wrong = stamp, now.steady, ""
        return True

    def refuse(self, message: str) -> bool:
        """Report a faulty message until a valid one comes; return False."""
        self._wrong = message
        return False

    def fault(self, now: Now) -> Fault | None:
        """Return what is wrong at present; None where nothing is."""
        if self._wrong:
            return Fault(self._name, self._wrong)
        if self.stamp == -math.inf:
            return Fault(self._name, "nothing received")
        age = max(now.ros - self.stamp, now.steady - self._received)
        is_known = not math.isfinite(age)  # by `set_known`, without a message
        if self.timeout == 0.0 or is_known or clocks.is_accepted(age, self.timeout, math.inf):
            return None
        return Fault(self._name, clocks.refusal(age, self.timeout), is_stale=True)


class ClockWatch:
    """Detects that the node's clock goes back, or stands still for more than `timeout` [s]."""

    def __init__(self, timeout: float):
        self._timeout = timeout
        self._last_change: Now | None = None  # when the node's clock showed another time last
        self._went_back_by = 0.0  # at most, since the last call of `went_back` [s]

    def see(self, now: Now) -> None:
        """Note both clocks; to be called whenever a message comes."""
        last = self._last_change
        if last is not None and now.ros == last.ros:
            return
        if last is not None:
            self._went_back_by = max(self._went_back_by, last.ros - now.ros)
        self._last_change = now

    def went_back(self) -> Fault | None:
        """Return a fault where the clock has gone back since the last call, else None."""
        back, self._went_back_by = self._went_back_by, 0.0
        return Fault("clock", f"has gone back by {back:.3f} s") if back > 0.0 else None

    def fault(self, now: Now) -> Fault | None:
        """Return a fault where the clock stands still, else None."""
        stood = 0.0 if self._last_change is None else now.steady - self._last_change.steady
        message = f"has stood still for {stood:.2f} s"
        return Fault("clock", message) if stood > self._timeout else None
