"""Parts of a certificate: what episodes showed, by policy and scene, by tens, and in all."""

from dataclasses import dataclass
from typing import NamedTuple

from hcbf_gym.errors import InvalidInputError, finite_float

BLOCK = 10
"""Episodes that are summed up together, so that a part can be repeated and compared."""
PRESSED = 0.5
"""The least share of episodes in which the filter had to stop the policy, so that the chance of
entering in an episode where rank 1 was at stake is at most twice the bound."""
LASTING = 10
"""The least number of steps that half of the episodes must last."""


@dataclass(frozen=True)
class Stratum:
    """What one policy did in one family of scenes.

    Args:
        policy: an attack's name, or a policy's.
        scene: the family's name; "own" where the environment draws its scenes.
        episodes: how many were drawn.
        entered: in how many rank 1 was entered.
        least_h: of the strict conditions on the position [unit of h].

    Raises:
        InvalidInputError: if a number is none, or contradicts another.
    """

    policy: str
    scene: str
    episodes: int
    entered: int
    least_h: float

    def __post_init__(self) -> None:
        check_counts(self, "episodes", "entered")
        finite_float("certificate: least_h", self.least_h)
        if not (self.least_h < 0.0) <= self.entered <= self.episodes:
            raise InvalidInputError(
                f"certificate: got {self}, expected between 0 and all of its episodes entered, "
                "and one of them where its least h is below 0"
            )


class Block(NamedTuple):
    """What `BLOCK` episodes showed, or the last few.

    Attributes:
        entered: in how many rank 1 was entered.
        pressed: in how many the filter stopped the policy.
        steps: that they lasted together.
        falls: in how many the robot fell.
        alarms: in how many the filter raised an alarm.
        least_h: of the strict conditions on the position [unit of h].
        least_speed_h: of a strict speed limit [m/s]; None where there is none.
    """

    entered: int
    pressed: int
    steps: int
    falls: int
    alarms: int
    least_h: float
    least_speed_h: float | None


class Shown(NamedTuple):
    """How much the episodes put rank 1 to the test.

    Attributes:
        pressed: in how many the filter changed an input that would have entered within a second.
        half_within: how near half of the episodes came to rank 1, their least h [unit of h].
        half_last: how long half of them lasted at least [steps].
    """

    pressed: int
    half_within: float
    half_last: int


def vacuous(shown: Shown, episodes: int) -> str:
    """Return why n episodes put nothing to the test; "" where they do."""
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
    """Refuse fields that are no counts."""
    for name in names:
        number = getattr(record, name)
        if isinstance(number, bool) or not isinstance(number, int) or number < 0:
            raise InvalidInputError(f"certificate: {name}: got {number!r}, expected a count")
