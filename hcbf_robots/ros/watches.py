"""Whether what a node hears is up to date, by two clocks.

Stamps count on the node's clock, which a simulator or a bag may drive; that messages arrive at all
counts on the steady clock, which nothing stops.
"""

import math
import sys
from typing import NamedTuple

from hcbf_gym.models import clocks


class Now(NamedTuple):
    """The present.

    Attributes:
        ros: on the node's clock [s].
        steady: on a clock that nobody sets [s].
    """

    ros: float
    steady: float


class Fault(NamedTuple):
    """Why a robot is at zero.

    Attributes:
        source: what is at fault: "command", "odometry", "clock", a source's name, …
        says: how.
    """

    source: str
    says: str

    def __str__(self) -> str:
        """Return both."""
        return f"{self.source}: {self.says}"


class Watch:
    """Watches over one kind of message.

    Args:
        name: what faults call it.
        timeout: after which it is stale [s]; 0 for never.
        tolerance: by which a stamp may be ahead of the clock [s].
    """

    def __init__(self, name: str, timeout: float, tolerance: float):
        self._name, self.timeout, self._tolerance = name, timeout, tolerance
        self.forget()

    def forget(self) -> None:
        """Know nothing any more."""
        self.stamp = self._received = -math.inf
        self._wrong = ""

    def stand(self) -> None:
        """Know without a message: a file, a zone of the parameters, or what stands in any case."""
        self.stamp, self._wrong = -sys.float_info.max, ""

    @property
    def is_known(self) -> bool:
        """Whether anything has been accepted."""
        return self.stamp > -math.inf

    def hear(self, stamp: float, now: Now, frame: str = "", expected: str = "") -> bool:
        """Accept a message; return False where its stamp or frame is wrong, or it is not newer.

        Args:
            stamp: of the message [s].
            now: the present.
            frame: of the message.
            expected: the frame that it must have; "" for any.
        """
        if expected and frame != expected:
            return self.refuse(f"frame {frame!r}, expected {expected!r}")
        if not math.isfinite(stamp):
            return self.refuse(f"stamp {stamp}")
        age = now.ros - stamp
        if not clocks.is_accepted(age, math.inf, self._tolerance):
            return self.refuse(clocks.says(age, math.inf, self._tolerance))
        if stamp <= self.stamp:
            return False
        self.stamp, self._received, self._wrong = stamp, now.steady, ""
        return True

    def refuse(self, says: str) -> bool:
        """Note that the newest message is faulty, until there is a sound one; return False."""
        self._wrong = says
        return False

    def fault(self, now: Now) -> Fault | None:
        """Return what is wrong now, if anything."""
        says = self._wrong
        if not says and not self.is_known:
            says = "nothing received"
        if not says and self.timeout > 0.0:
            age = max(now.ros - self.stamp, now.steady - self._received)
            if not clocks.is_accepted(age, self.timeout, math.inf):
                says = clocks.says(age, self.timeout)
        return Fault(self._name, says) if says else None


class ClockWatch:
    """Watches over the node's clock.

    Args:
        timeout: how long it may stand still [s].
    """

    def __init__(self, timeout: float):
        self._timeout = timeout
        self._moved: Now | None = None
        self._back = 0.0

    def see(self, now: Now) -> None:
        """Note the time whenever anything is heard."""
        if self._moved is None or now.ros != self._moved.ros:
            if self._moved is not None:
                self._back = max(self._back, self._moved.ros - now.ros)
            self._moved = now

    def went_back(self) -> Fault | None:
        """Return a fault where the clock has gone back since this was asked."""
        back, self._back = self._back, 0.0
        return Fault("clock", f"has gone back by {back:.3f} s") if back > 0.0 else None

    def fault(self, now: Now) -> Fault | None:
        """Return a fault where the clock stands still."""
        stood = 0.0 if self._moved is None else now.steady - self._moved.steady
        stands = stood > self._timeout
        return Fault("clock", f"has stood still for {stood:.2f} s") if stands else None
