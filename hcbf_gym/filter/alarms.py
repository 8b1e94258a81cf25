"""What a filter says when it brakes, or when the plant is not the one that was declared."""

import re
from collections.abc import Callable

from hcbf_gym.errors import SafetyWarning, warn_caller
from hcbf_gym.models.plant import FIRST_ALARM, Reason

_NUMBER = re.compile(r"[\d.]+")


class ReasonWarnings:
    """Warns of each reason once, whatever its numbers, and of one that comes back no more.

    Args:
        brakes_on_alarm: whether an alarm makes the filter brake.
    """

    def __init__(self, brakes_on_alarm: bool):
        self._brakes = brakes_on_alarm
        self._said: set[tuple[int, str]] = set()

    def forget(self, reason: int) -> None:
        """Let a reason be warned of again."""
        self._said = {kind for kind in self._said if kind[0] != reason}

    def warn(self, reason: int, count: int, cause: Callable[[int], str]) -> None:
        """Warn of a `Reason` that was not warned of yet.

        Args:
            reason: what happened.
            count: how many plants of a batch it happened to.
            cause: reason → what exactly is wrong; "" where nothing more is known.
        """
        if reason == Reason.NONE or (reason != Reason.AGE and (reason, "") in self._said):
            return
        why = cause(reason)
        kind = int(reason), _NUMBER.sub("", why) if reason == Reason.AGE else ""  # old, or ahead
        if kind in self._said:
            return
        self._said.add(kind)
        until = "until the next reset" if Reason(reason).lasts else "until that ends"
        brakes = reason < FIRST_ALARM or self._brakes
        does = "brakes" if brakes else "goes on, and promises nothing"
        many = "" if count == 1 else f" of {count} plants"
        says = f"{Reason(reason).text}{f' ({why})' if why else ''}"
        message = f"safety filter{many}: {says}; the filter {does} {until}"
        warn_caller(message, SafetyWarning)
