"""The barriers that the user of a velocity filter sets, their stamp, and the cap on the speed."""

import math
from collections.abc import Sequence
from typing import Any

from hcbf_gym.barriers import SpeedLimit
from hcbf_gym.barriers.many import Element, are_same, is_list
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, SafetyWarning, finite_float, flag, shown, warn_caller
from hcbf_gym.models import clocks
from hcbf_gym.models.clocks import SEEN_FOR
from hcbf_robots.online.step_times import StepTimes

GUIDANCE_PERIOD = 0.5
"""Shortest time after which guidance takes up new barriers again [s]."""


class BarrierInput:
    """The ranked barriers of a velocity filter, with its cap on the speed.

    Args:
        times: of the filter's steps.

    Attributes:
        barriers: as the user set them last.
        limits: the cap on the speed; empty without one.
        guidance_follows: whether guidance takes up the barriers that were set last.
    """

    def __init__(self, times: StepTimes) -> None:
        self.barriers: Any = None
        self.limits: tuple[SpeedLimit, ...] = ()
        self._times = times
        self._seen_at: float | None = None  # on the robot's clock [s]; None for no stamp
        self.guidance_follows = True
        self._last_list: tuple[Any, ...] | None = None  # the objects that were set last
        self._is_new = True  # whether guidance has not taken up the barriers
        self.forget()

    def forget(self) -> None:
        """Let guidance take up new barriers in the next step; accept every stamp until then."""
        self._guided_at = -math.inf  # when guidance took up barriers last [s]
        self._is_stamp_valid = True

    def set(self, barriers: Sequence[Element], seen_at: float | None, look: bool) -> None:
        """Set the barriers; the arguments are those of `VelocityFilter.set_barriers`."""
        flag("look", look)
        self._seen_at = None if seen_at is None else finite_float("seen_at", seen_at)
        new_list, last_list = None, self._last_list
        if isinstance(barriers, Sequence):
            new_list = tuple(barriers)  # a copy, because the user may change a list afterwards
        is_same = new_list is not None and last_list is not None and are_same(new_list, last_list)
        self._is_new = self._is_new or (look and not is_same)
        self.barriers, self._last_list, self.guidance_follows = barriers, new_list, look

    @property
    def since(self) -> float | None:
        """When the barriers were seen, in the filter's time [s]; None for the next step."""
        return None if self._seen_at is None else self._seen_at - self._times.zero

    def check_stamp(self, present: float) -> None:
        """Check the age of the barriers at the present [s]; warn when it becomes invalid."""
        if not math.isfinite(present):
            return
        seen_at, was_valid = self._seen_at, self._is_stamp_valid
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
        """Return whether guidance takes up new barriers in the step at the present [s]."""
        is_new = self._is_new and self._is_stamp_valid
        return is_new and present - self._guided_at >= GUIDANCE_PERIOD

    def note_guidance(self, present: float) -> None:
        """Note that guidance takes up the barriers at the present [s]."""
        self._guided_at, self._is_new = present, False

    def scene(self) -> object:
        """Return the barriers for the filter's core, with the cap on the speed.

        None is returned, which the core refuses, if the stamp is invalid or the barriers are an
        environment's `BarrierSet`. Another object than a sequence is returned as it is, because the
        core's message names what is wrong.
        """
        if not self._is_stamp_valid:
            return None
        try:
            return self.with_limits(self.barriers)
        except InvalidInputError:
            return None if isinstance(self.barriers, BarrierSet) else self.barriers

    def with_limits(self, barriers: object) -> tuple[Element, ...]:
        """Return barriers with the cap on the speed; refuse other objects than sequences."""
        if not is_list(barriers):
            raise InvalidInputError(
                f"barriers: got {shown(barriers)}, expected a sequence of Barriers"
            )
        return (*barriers, *self.limits)
