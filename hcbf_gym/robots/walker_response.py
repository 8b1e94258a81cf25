r"""How a robot follows the velocities that it is commanded.

In the robot's own axes, axis by axis,

.. math:: τ \dot v = g\, c(t - δ) - v + w,

with the command c, the gain g, the time constant τ, the delay δ, and what is left, w: sway, slip,
noise. `hcbf identify` measures these numbers.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from hcbf_gym import records
from hcbf_gym.errors import finite_array, finite_float

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
        overshoot: by how much the speed of the fast robot exceeds all commands within a
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
        data = records.read_json("response", path)
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
