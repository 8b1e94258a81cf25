r"""How a robot follows the velocities that it is told, and what rows must reserve for it.

In the robot's own axes, axis by axis,

.. math:: τ \dot v = g\, c(t - δ) - v + w,

with the command c, the gain g, the time constant τ, the delay δ, and what is left, w: sway, slip,
noise. `hcbf identify` measures these numbers.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hcbf_gym import records
from hcbf_gym.errors import InvalidInputError, finite_array, finite_float
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Uncertainty

LASTING = 4.0
"""Over which sway has averaged out [s]."""
LEAST_GAIN = 0.5
"""A robot that gives less of the commanded speed does not follow."""


@dataclass(frozen=True)
class Response:
    """What `hcbf identify` measured.

    Args:
        gain: (k,) g of every entry of the command.
        time_constant: τ of the slowest axis of the velocity [s].
        delay: δ of that axis [s].
        residual: quantiles of ‖w‖ in the plane [m/s]: 50, 95 and 99.9 %.
        sway: what position deviates at most from the model's in 99.9 % of the time, over the time
            that the model takes to follow [m].
        overshoot: by how much the speed of the fast robot exceeds all that was told within a
            second, in 99.9 % of the time [m/s].
        rise: from 10 to 90 % of a step of the speed [s].
        stopping: how far the robot goes on after the command has become zero [m].
        braking: deceleration of such a stop, from 90 to 10 % of the speed [m/s²].
        falls: how often it fell meanwhile.
        seconds: how long it was observed [s].
        lasting: mean of w over `LASTING` in 99.9 % of the time, beyond a share of the motion:
            what of it does not average out [m/s]; None if nobody has measured it.

    Raises:
        InvalidInputError: on a number out of range.
    """

    gain: tuple[float, ...]
    time_constant: float
    delay: float
    residual: tuple[float, float, float]
    sway: float
    overshoot: float
    rise: float
    stopping: float
    braking: float
    falls: int
    seconds: float
    lasting: float | None = None

    def __post_init__(self) -> None:
        for name, count in (("gain", None), ("residual", 3)):
            array = finite_array(f"response: {name}", getattr(self, name), (count,), largest=100.0)
            object.__setattr__(self, name, tuple(array.tolist()))
        for name in (
            "time_constant",
            "delay",
            "sway",
            "overshoot",
            "rise",
            "stopping",
            "falls",
            "seconds",
        ):
            finite_float(f"response: {name}", getattr(self, name), minimum=0.0)
        finite_float("response: braking", self.braking, minimum=0.0, exclusive=True)
        if self.lasting is not None:
            finite_float("response: lasting", self.lasting, minimum=0.0)

    @classmethod
    def load(cls, path: Path) -> "Response":
        """Read what was measured from a file.

        Raises:
            InvalidInputError: if it cannot be read.
        """
        try:
            data: Any = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise InvalidInputError(
                f"response: got {str(path)!r} ({error}), expected a readable JSON file"
            ) from error
        records.check_mapping("response", data)
        return records.build(f"response ({path})", cls, data)

    def save(self, path: Path) -> None:
        """Write what was measured to a file, in one move."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with records.whole(path) as partial:
            partial.write_text(json.dumps(records.plain(asdict(self)), indent=2) + "\n", "utf-8")

    @property
    def follows(self) -> float:
        """How long a command takes to show, τ + δ [s]."""
        return self.time_constant + self.delay

    @property
    def complaints(self) -> list[str]:
        """Where the robot does not follow, a sentence for each; empty where it does."""
        said = [
            f"entry {k} of the command: the robot gives {gain:.2f} of what it is told"
            for k, gain in enumerate(self.gain)
            if gain < LEAST_GAIN
        ]
        if self.falls:
            said.append(f"the robot fell {self.falls} times in {self.seconds:g} s")
        return said


UNKNOWN = Response(
    gain=(1.0,),
    time_constant=0.3,
    delay=0.1,
    residual=(0.1, 0.2, 0.3),
    sway=0.05,
    overshoot=0.2,
    rise=0.7,
    stopping=0.5,
    braking=1.5,
    falls=0,
    seconds=0.0,
)
"""What is assumed of a robot that nobody has measured: it is slow, and it sways."""


LEAST_DISTANCE = 0.02
"""What rows reserve for any robot [m]."""
LEAST_SPEED = 0.05
"""What a speed limit reserves for any robot [m/s]."""
BEYOND = 1.1
"""Of the overshoot that a speed limit reserves: a minute does not show the worst of an hour."""
SETTLES = 0.7
"""1/α₁'(0) + 1/α₂' of the filter's own α's [s]: by so much times a velocity error that stays, as in
a long turn, the robot settles nearer than its row says."""
FARTHER = 1.25
"""Of τ + δ + T that the body is taken to go on with a velocity error."""
MOST = 0.25
"""What the tracking error may add to a row [m]."""
OVERSHOOT = 0.3
"""Share of the velocity error that a speed limit reserves."""


def uncertainty(response: Response, period: float) -> Uncertainty:
    """Return what rows must reserve for a robot, from how it follows.

    A body that is faster towards a region than it was told goes on for ``τ + δ + T``. One that
    stays faster by e settles nearer: with ḣ = v − e on the row v̇ = −(α₁' + α₂') v − α₁'α₂' (h − m),
    at h = m − (1/α₁' + 1/α₂') e. What sways beside the model while it follows is
    reserved in any case.

    Args:
        response: of the robot.
        period: T, between two inputs [s].
    """
    follows = response.follows
    _, often, _ = response.residual
    return Uncertainty(
        distance=LEAST_DISTANCE + often * follows,
        per_velocity=max(SETTLES, FARTHER * (follows + period)),
        per_lead=1.0,
        cap=MOST,
        speed=LEAST_SPEED + BEYOND * response.overshoot,
        speed_per_velocity=OVERSHOOT,
    )


def braked(input_set: InputSet, response: Response) -> InputSet:
    """Return U, shrunk until the robot brakes as hard: no input is larger than that.

    Args:
        input_set: of the scene.
        response: of the robot.
    """
    share = response.braking / input_set.radius
    return input_set if share >= 1.0 else input_set.scaled(share)
