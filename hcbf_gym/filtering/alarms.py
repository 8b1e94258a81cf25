"""What a filter says when it brakes, or when the plant is not the one that was declared."""

from hcbf_gym.errors import SafetyWarning, warn_caller
from hcbf_gym.models.plant import FIRST_ALARM, Reason


class ReasonWarnings:
    """Warns of each reason once, and of a reason that comes back no more.

    Args:
        brakes_on_alarm: whether an alarm makes the filter brake.
    """

    def __init__(self, brakes_on_alarm: bool):
        self._brakes = brakes_on_alarm
        self._said: set[int] = set()

    def warn(self, reason: int, count: int = 1) -> None:
        """Warn of a `Reason` that was not warned of yet.

        Args:
            reason: what happened.
            count: how many plants of a batch it happened to.
        """
        if reason in self._said or reason == Reason.NONE:
            return
        self._said.add(int(reason))
        if reason < FIRST_ALARM:
            what = "the filter brakes until that ends"
        elif self._brakes:
            what = "the filter brakes until the next reset"
        else:
            what = "the filter goes on, and promises nothing until the next reset"
        many = "" if count == 1 else f" of {count} plants"
        message = f"safety filter{many}: {Reason(reason).says}; {what}"
        warn_caller(message, SafetyWarning)
