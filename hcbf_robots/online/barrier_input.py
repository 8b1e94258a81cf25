"""The barriers that the user of a velocity filter sets, and which of them guidance has seen."""

import math
import operator
from collections.abc import Sequence
from typing import Any

from hcbf_gym.barriers import SpeedLimit
from hcbf_gym.barriers.many import Element, is_list
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import (
    InvalidInputError,
    SafetyWarning,
    finite_float,
    flag,
    shown,
    warn_caller,
)
from hcbf_gym.models import clocks
from hcbf_gym.models.clocks import SEEN_FOR
from hcbf_robots.online.step_times import StepTimes

GUIDANCE_PERIOD = 0.5
"""The shortest time between two looks of guidance at new barriers [s]."""


class BarrierInput:
    """The ranked barriers of a velocity filter, with its cap on the speed.

    Attributes:
        barriers: as the user set them last.
        limits: the cap on the speed; empty without one.
        guidance_follows: whether guidance is to take up the barriers that were set last.
    """

    def __init__(self, times: StepTimes) -> None:
        self.barriers: Any = None
        self.limits: tuple[SpeedLimit, ...] = ()
        self._times = times
        self._seen_at: float | None = None  # on the robot's clock [s]; None for no stamp
        self.guidance_follows = True
        self._set_last: object = None
        self._is_unseen = True  # whether guidance has not looked at the barriers
        self.forget()

    def forget(self) -> None:
        """Let guidance look at new barriers in the next step; accept every stamp until then."""
        self._guided_at = -math.inf  # when guidance looked last [s]
        self._is_stamp_valid = True

    def set(self, barriers: Sequence[Element], seen_at: float | None, look: bool) -> None:
        """Set the barriers; the arguments are those of `VelocityFilter.set_barriers`."""
        flag("look", look)
        self._seen_at = None if seen_at is None else finite_float("seen_at", seen_at)
        listed = tuple(barriers) if isinstance(barriers, Sequence) else barriers
        self._is_unseen = self._is_unseen or (look and not _are_same(listed, self._set_last))
        self.barriers, self._set_last, self.guidance_follows = barriers, listed, look

    @property
    def since(self) -> float | None:
        """The filter's time at which the barriers were seen [s]; None for the next step."""
        return None if self._seen_at is None else self._seen_at - self._times.zero

    def check_stamp(self, present: float) -> None:
        """Check the age of the barriers at a present [s]; warn when it becomes invalid."""
        seen_at, was_valid = self._seen_at, self._is_stamp_valid
        if not math.isfinite(present):
            return
        age = 0.0 if seen_at is None else present - seen_at
        self._is_stamp_valid = bool(clocks.is_accepted(age, SEEN_FOR))
        if was_valid and not self._is_stamp_valid and seen_at is not None:
            warn_caller(
                f"velocity filter: seen_at: got {seen_at:.9g} s at {present:.9g} s, expected a "
                f"stamp of the robot's clock ({clocks.refusal(age, SEEN_FOR)}); the command is "
                "zero until there is one",
                SafetyWarning,
            )

    def guidance_is_due(self, present: float) -> bool:
        """Return whether guidance is to look at new barriers in the step at a present [s]."""
        is_new = self._is_unseen and self._is_stamp_valid
        return is_new and present - self._guided_at >= GUIDANCE_PERIOD

    def note_guidance(self, present: float) -> None:
        """Note that guidance looks at the barriers at a present [s]."""
        self._guided_at, self._is_unseen = present, False

    def scene(self) -> object:
        """Return the barriers for the filter's core, with the cap on the speed.

        Those that are no sequence are returned as they are, because the core names what is wrong.
        Barriers of no valid time, and an environment's set, are None, which the core refuses.
        """
        if not self._is_stamp_valid:
            return None
        try:
            return self.with_limits(self.barriers)
        except InvalidInputError:
            return None if isinstance(self.barriers, BarrierSet) else self.barriers

    def with_limits(self, barriers: object) -> tuple[Element, ...]:
        """Return barriers with the cap on the speed; refuse those that are no sequence."""
        if not is_list(barriers):
            raise InvalidInputError(
                f"barriers: got {shown(barriers)}, expected a sequence of Barriers"
            )
        return (*barriers, *self.limits)


def _are_same(one: object, other: object) -> bool:
    """Return whether two sequences hold the same objects."""
    if not isinstance(one, Sequence) or not isinstance(other, Sequence):
        return False
    return len(one) == len(other) and all(map(operator.is_, one, other))
