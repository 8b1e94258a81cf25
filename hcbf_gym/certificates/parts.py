"""Counts of a certificate's episodes: by policy and scene, in blocks of ten, and in all."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from hcbf_gym.errors import InvalidInputError, count, finite_float

BLOCK = 10
"""The number of episodes that a `Block` sums up; repeating one block checks a certificate."""
PRESSED = 0.5
"""The least share of episodes in which the filter had to stop the policy. With one half, the chance
of entering in an episode in which rank 1 was at stake is at most twice the bound."""
LASTING = 10
"""The least number of steps that half of the episodes must last."""


@dataclass(frozen=True)
class Stratum:
    """The episodes of one policy in one family of scenes.

    Args:
        policy: the name of an attack or a policy.
        scene: the family's name; "own" where the environment draws its scenes.
        episodes: the number of episodes.
        entered: the number of them in which rank 1 was entered.
        least_h: the least h of the strict conditions on the position [unit of h].

    Raises:
        InvalidInputError: if a number is malformed or contradicts another.
    """

    policy: str
    scene: str
    episodes: int
    entered: int
    least_h: float

    def __post_init__(self) -> None:
        check_counts(self, "episodes", "entered")
        finite_float("certificate: least_h", self.least_h)
        least_entered = 1 if self.least_h < 0.0 else 0  # h below 0 is an entry
        if not least_entered <= self.entered <= self.episodes:
            raise InvalidInputError(
                f"certificate: got {self}, expected between 0 and all of its episodes entered, "
                "and one of them where its least h is below 0"
            )


class Block(NamedTuple):
    """The counts of `BLOCK` episodes in a row; the last block may have fewer.

    Attributes:
        entered: the number of episodes in which rank 1 was entered.
        pressed: the number in which the filter stopped the policy.
        steps: the number of steps of all its episodes together.
        falls: the number of episodes in which the robot fell.
        alarms: the number in which the filter raised an alarm.
        least_h: the least h of the strict conditions on the position [unit of h].
        least_speed_h: the least h of a strict speed limit [m/s]; None where there is none.
    """

    entered: int
    pressed: int
    steps: int
    falls: int
    alarms: int
    least_h: float
    least_speed_h: float | None


class Shown(NamedTuple):
    """Figures that show how hard the episodes tested rank 1, see `vacuous`.

    Attributes:
        pressed: the number of episodes with an input that the filter changed because it would have
            entered rank 1 within a second.
        half_within: half of the episodes came this near to rank 1: their least h [unit of h].
        half_last: half of the episodes lasted at least so long [steps].
    """

    pressed: int
    half_within: float
    half_last: int


def vacuous(shown: Shown, episodes: int) -> str:
    """Return why n episodes do not test rank 1, which makes a certificate void; "" if they do."""
    if shown.half_last < LASTING:
        return (
            f"half of the episodes ended within {shown.half_last} steps, expected {LASTING} at "
            "least: they show nothing of a robot that drives"
        )
    if shown.pressed < PRESSED * episodes:
        return (
            f"in {shown.pressed} of {episodes} episodes the filter had to change an input that "
            f"would have entered rank 1 within a second, expected {PRESSED:.0%} at least; half of "
            f"the episodes stayed {shown.half_within:.3g} or more away: rank 1 was hardly at "
            "stake; let episodes begin nearer, last longer (--steps), or policies press "
            "(--policies)"
        )
    return ""


def check_counts(record: object, *names: str) -> None:
    """Refuse a record of which one of the named fields is no count."""
    for name in names:
        count(f"certificate: {name}", getattr(record, name), minimum=0, maximum=math.inf)
