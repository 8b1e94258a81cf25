"""What a filter says when it brakes, or when the plant is not the one that was declared."""

import warnings

from hcbf_gym.errors import SafetyWarning
from hcbf_gym.models.plant import FIRST_ALARM, Reason

SAYS = {
    Reason.STATE: "the state is not finite, farther away than anything is, or of another "
    "shape than the model's",
    Reason.AGE: "the state is older than the plant's max_age",
    Reason.CLOCK: "the time of the state does not go on",
    Reason.BARRIERS: "the barriers, or the rows that they become, are not finite or not barriers",
    Reason.SOLVER: "no solver answered",
    Reason.INPUT: "the environment does not apply what the filter chose: expected no wrapper, "
    "delay, hold or gain between filter and robot, and a model like the plant",
    Reason.MOTION: "the position does not move as the velocity says: expected both of one robot, "
    "at one time, in one frame and unit",
    Reason.SLIP: "the robot's feet slide more than on the declared floor",
    Reason.LAG: "the robot's torques act later than the declared plant's",
    Reason.LIFT: "the robot's legs carry more or less than the declared load and motors",
    Reason.RESPONSE: "the robot does not do what it is told: expected it to follow as its response "
    "was measured, on the declared floor, and odometry of that robot that is up to date",
}
"""Each reason in words."""


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
        message = f"safety filter{many}: {SAYS[Reason(reason)]}; {what}"
        warnings.warn(message, SafetyWarning, stacklevel=5)
