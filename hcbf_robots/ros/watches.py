"""Whether messages are up to date, by two clocks.

Stamps count on the node's clock, which a simulator or a bag may drive. The arrival of messages
counts on the steady clock, which nothing stops.
"""

import math
import sys
from typing import NamedTuple

from hcbf_gym.models import clocks


class Now(NamedTuple):
    """The present [s]."""

    ros: float  # on the node's clock
    steady: float  # on a clock that is never set


class Fault(NamedTuple):
    """Why a robot is at zero."""

    source: str  # "command", "odometry", "clock", a source's name, …
    message: str

    def __str__(self) -> str:
        return f"{self.source}: {self.message}"


class Watch:
    """Watches over one kind of message.

    Args:
        name: in faults.
        timeout: after which it is stale [s]; 0 for never.
        tolerance: by which a stamp may be ahead of the clock [s].
    """

    def __init__(self, name: str, timeout: float, tolerance: float):
        self._name, self.timeout, self._tolerance = name, timeout, tolerance
        self.forget()

    def forget(self) -> None:
        """Begin without any message."""
        self.stamp = self._received = -math.inf
        self._wrong = ""

    def set_known(self) -> None:
        """Accept without a message: a file, or a zone of the parameters."""
        self.stamp, self._wrong = -sys.float_info.max, ""

    def forget_stamp(self) -> None:
        """Begin anew where the clock has gone back; without a time-out the message remains."""
        if self.timeout > 0.0 and math.isfinite(self._received):
            self.forget()
        elif self.stamp > -math.inf:
            self.set_known()

    def hear(self, stamp: float, now: Now, frame: str = "", expected: str = "") -> bool:
        """Accept a message; return False where its stamp or frame is wrong, or it is not newer.

        The `expected` frame is "" for any.
        """
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
        """Note that the newest message is faulty, until a valid one comes; return False."""
        self._wrong = message
        return False

    def fault(self, now: Now) -> Fault | None:
        """Return what is wrong now, if anything."""
        if self._wrong:
            return Fault(self._name, self._wrong)
        if self.stamp == -math.inf:
            return Fault(self._name, "nothing received")
        age = max(now.ros - self.stamp, now.steady - self._received)
        never = self.timeout == 0.0 or not math.isfinite(age)  # infinite: known without a message
        if never or clocks.is_accepted(age, self.timeout, math.inf):
            return None
        return Fault(self._name, clocks.refusal(age, self.timeout))


class ClockWatch:
    """Watches over the node's clock, which may stand still for `timeout` [s]."""

    def __init__(self, timeout: float):
        self._timeout = timeout
        self._moved: Now | None = None
        self._back = 0.0

    def see(self, now: Now) -> None:
        """Note the time whenever a message comes."""
        if self._moved is None or now.ros != self._moved.ros:
            if self._moved is not None:
                self._back = max(self._back, self._moved.ros - now.ros)
            self._moved = now

    def went_back(self) -> Fault | None:
        """Return a fault where the clock has gone back since the last call."""
        back, self._back = self._back, 0.0
        return Fault("clock", f"has gone back by {back:.3f} s") if back > 0.0 else None

    def fault(self, now: Now) -> Fault | None:
        """Return a fault where the clock stands still."""
        stood = 0.0 if self._moved is None else now.steady - self._moved.steady
        stands = stood > self._timeout
        return Fault("clock", f"has stood still for {stood:.2f} s") if stands else None
