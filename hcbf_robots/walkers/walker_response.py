r"""How a robot follows the velocities that it is commanded.

In the robot's own axes, axis by axis,

.. math:: τ \dot v = g\, c(t - δ) - v + w,

with the command c, the gain g, the time constant τ, the delay δ, and the residual w: a gait's
oscillation, slip, noise. `hcbf identify` measures these numbers.
"""

import json
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

from hcbf_gym import records
from hcbf_gym.errors import InvalidInputError, finite_array, finite_float
from hcbf_robots.walkers.walker_parts import Command

AVERAGING_TIME = 4.0  # over which a gait's oscillation averages out [s]
LEAST_GAIN = 0.5  # with a smaller gain a robot does not follow its commands
MOST_GAIN = 1.5  # a greater gain is taken for an error of the measurement


@dataclass(frozen=True)
class Response:
    """How a robot follows its commands; the defaults are those of a slow, unmeasured robot.

    Args:
        gain: (k,) g of every entry of the command; empty for 1 each.
        time_constant: τ of the slowest axis of the velocity [s].
        delay: δ of that axis [s].
        residual: quantiles of ‖w‖ in the plane [m/s]: 50, 95 and 99.9 %.
        deviation: how far a position is from the model's after the time τ + δ, at most in 99.9 % of
            the time [m].
        overshoot: by how much the speed of the fast robot exceeds all commands within a
            second, in 99.9 % of the time [m/s].
        rise: time from 10 to 90 % of a step of the speed [s].
        stopping: the path after the command has become zero [m].
        braking: deceleration of such a stop, from 90 to 10 % of the speed [m/s²].
        falls: how often the robot fell while it was observed.
        seconds: how long it was observed [s].
        lasting: mean of w over `AVERAGING_TIME` in 99.9 % of the time, beyond a share of the
            motion: the part that does not average out [m/s]; None if it is unmeasured.

    Raises:
        InvalidInputError: on a number out of range.
    """

    gain: tuple[float, ...] = ()
    time_constant: float = 0.3
    delay: float = 0.1
    residual: tuple[float, float, float] = (0.1, 0.2, 0.3)
    deviation: float = 0.05
    overshoot: float = 0.2
    rise: float = 0.7
    stopping: float = 0.5
    braking: float = 1.5
    falls: int = 0
    seconds: float = 0.0
    lasting: float | None = None

    def __post_init__(self) -> None:
        for name, count in (("gain", None), ("residual", 3)):
            array = finite_array(f"response: {name}", getattr(self, name), (count,), largest=100.0)
            object.__setattr__(self, name, tuple(array.tolist()))
        half, often, nearly_always = self.residual
        if not 0.0 <= half <= often <= nearly_always:
            raise InvalidInputError(
                f"response: residual: got {self.residual}, expected three quantiles, none below 0 "
                "and none below the one before"
            )
        for field in fields(self):
            value, name = getattr(self, field.name), field.name
            is_unmeasured = name == "lasting" and value is None
            if name not in ("gain", "residual") and not is_unmeasured:
                finite_float(f"response: {name}", value, minimum=0.0, exclusive=name == "braking")

    @classmethod
    def load(cls, path: Path) -> "Response":
        """Read a response's JSON file.

        Raises:
            InvalidInputError: if it cannot be read.
        """
        data = records.read_json("response", path)
        records.check_mapping("response", data)
        return records.build(f"response ({path})", cls, data)

    def save(self, path: Path) -> None:
        """Write the response as a JSON file, atomically."""
        records.make_folder(path.parent)
        with records.whole(path) as partial:
            partial.write_text(json.dumps(records.plain(asdict(self)), indent=2) + "\n", "utf-8")

    def gains(self, count: int) -> tuple[float, ...]:
        """Return (count,) the gain of each entry of a command.

        Raises:
            InvalidInputError: if there is another number of gains.
        """
        if len(self.gain) not in (0, count):
            raise InvalidInputError(
                f"response: gain: got {list(self.gain)}, expected {count} numbers, one for each "
                "entry of the command, or none"
            )
        return self.gain or (1.0,) * count

    @property
    def follows(self) -> float:
        """Time until the robot has followed 63 % of a step of its command, τ + δ [s]."""
        return self.time_constant + self.delay

    @property
    def complaints(self) -> list[str]:
        """A sentence for each reason that the robot does not follow; empty where it does."""
        sentences = []
        for k, gain in enumerate(self.gain):
            if not LEAST_GAIN <= gain <= MOST_GAIN:
                reversed_sign = ", against its sign" if gain < 0.0 else ""
                sentences.append(
                    f"entry {k} of the command: the robot gives {gain:.2f} of it{reversed_sign}"
                )
        if self.falls:
            sentences.append(f"the robot fell {self.falls} times in {self.seconds:g} s")
        return sentences


UNKNOWN = Response()  # assumed of an unmeasured robot of 1 m/s, which is slow and oscillates


def assumed(command: Command) -> Response:
    """Return the response that is assumed of an unmeasured robot, by the limits of its commands.

    The speeds and paths of `UNKNOWN` are scaled with the greatest speed. On wheels a robot of less
    than 1 m/s has less of both. One that also moves sideways may have legs, which oscillate as much
    when they are slow: there only the overshoot decreases.
    """
    speed_ratio = command.fastest
    motion_ratio = speed_ratio if command.look_ahead is not None else max(1.0, speed_ratio)
    half, often, nearly_always = UNKNOWN.residual
    return replace(
        UNKNOWN,
        residual=(motion_ratio * half, motion_ratio * often, motion_ratio * nearly_always),
        deviation=motion_ratio * UNKNOWN.deviation,
        overshoot=speed_ratio * UNKNOWN.overshoot,
        stopping=motion_ratio * UNKNOWN.stopping,
    )
