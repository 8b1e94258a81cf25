"""What one episode of a certificate showed, as its file holds it: one line of text.

>>> one = Seen("pd guided", "random", 0.01234567, 0.3, 0.8, steps=431, met=True)
>>> one.text
'pd guided; random; 0.012345; 0.300000; 0.800000; 431; met'
>>> Seen.read(one.text).least_h
0.012345
"""

import math
from typing import Any, NamedTuple

from hcbf_gym.errors import InvalidInputError

UNIT = 1_000_000
"""Files hold h in parts of so many, rounded down: what is below zero stays below."""
FARTHEST = 1e9
"""What is no number, or beyond this, counts as so far inside."""
MARKS = ("met", "fell")
"""What a line says only where it is so; "alarm 7" tells of an alarm."""


class Seen(NamedTuple):
    """What one episode showed, as far as a certificate reads it.

    Attributes:
        policy: its name.
        scene: the family of its scene.
        least_h: of the strict conditions on the position, or of the body's [unit of h].
        least_speed_h: of a strict speed limit [m/s]; infinite where there is none.
        first_h: least strict h at the reset.
        fell: whether the robot fell.
        alarm: the last `Reason` that was an alarm; 0 for none.
        steps: how many it took.
        met: whether u* ever broke a strict row on the position, so that the filter had to act.
    """

    policy: str
    scene: str
    least_h: float
    least_speed_h: float
    first_h: float
    fell: bool = False
    alarm: int = 0
    steps: int = 0
    met: bool = False

    @property
    def entered(self) -> bool:
        """Whether a condition of rank 1 was broken."""
        return not (self.least_h >= 0.0 and self.least_speed_h >= 0.0)

    def kept(self) -> "Seen":
        """Return it as a file holds it."""
        h, speed, first = (_down(x) for x in (self.least_h, self.least_speed_h, self.first_h))
        return self._replace(least_h=h, least_speed_h=speed, first_h=first)

    @property
    def text(self) -> str:
        """The line in a file."""
        one = self.kept()
        h = (f"{x:.6f}" for x in (one.least_h, one.least_speed_h, one.first_h))
        marks = [mark for mark in MARKS if getattr(one, mark)]
        alarm = [f"alarm {one.alarm}"] if one.alarm else []
        return "; ".join([one.policy, one.scene, *h, str(one.steps), *marks, *alarm])

    @classmethod
    def read(cls, text: Any) -> "Seen":
        """Return what a line tells.

        Raises:
            InvalidInputError: if `text` would not write it so.
        """
        try:
            policy, scene, h, speed, first, steps, *marks = text.split("; ")
            alarms = [int(mark.removeprefix("alarm ")) for mark in marks if mark not in MARKS]
            fell, met = "fell" in marks, "met" in marks
            numbers = float(h), float(speed), float(first)
            one = cls(policy, scene, *numbers, fell, sum(alarms), int(steps), met)
        except (AttributeError, ValueError) as error:
            raise InvalidInputError(
                f"certificate: seen: got {text!r}, expected 'policy; scene; least h; least h of "
                "the speed limit; first h; steps', then what of met, fell, alarm N is so"
            ) from error
        if one.text != text or one.steps < 0 or one.alarm < 0:
            raise InvalidInputError(f"certificate: seen: got {text!r}, expected {one.text!r}")
        return one


def _down(x: float) -> float:
    """Return h as a file holds it; infinite only where there is none."""
    if math.isnan(x):
        return -FARTHEST
    return x if x == math.inf else math.floor(max(x, -FARTHEST) * UNIT) / UNIT
