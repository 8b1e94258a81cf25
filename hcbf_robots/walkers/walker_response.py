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

LASTING = 4.0  # over which the residual has averaged out [s]
LEAST_GAIN = 0.5  # a robot that gives less of the commanded speed does not follow
MOST_GAIN = 1.5  # a gain beyond is taken for an error of measurement


@dataclass(frozen=True)
class Response:
    """How a robot follows, as `hcbf identify` measured it; what is left out is taken for slow.

    Args:
        gain: (k,) g of every entry of the command; empty for 1 each.
        time_constant: τ of the slowest axis of the velocity [s].
        delay: δ of that axis [s].
        residual: quantiles of ‖w‖ in the plane [m/s]: 50, 95 and 99.9 %.
        deviation: of positions from the model's, at most in 99.9 % of the time, over the time
            that the model takes to follow [m].
        overshoot: by how much the speed of the fast robot exceeds all commands within a
            second, in 99.9 % of the time [m/s].
        rise: from 10 to 90 % of a step of the speed [s].
        stopping: how far the robot moves after the command has become zero [m].
        braking: deceleration of such a stop, from 90 to 10 % of the speed [m/s²].
        falls: how often it fell meanwhile.
        seconds: how long it was observed [s].
        lasting: mean of w over `LASTING` in 99.9 % of the time, beyond a share of the motion:
            the part that does not average out [m/s]; None if it is unmeasured.

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
        half, often, almost = self.residual
        if not 0.0 <= half <= often <= almost:
            raise InvalidInputError(
                f"response: residual: got {self.residual}, expected three quantiles, none below 0 "
                "and none below the one before"
            )
        for name in (
            field.name for field in fields(self) if field.name not in ("gain", "residual")
        ):
            value = getattr(self, name)
            if name != "lasting" or value is not None:
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
        """Write a JSON file, atomically."""
        records.make_folder(path.parent)
        with records.whole(path) as partial:
            partial.write_text(json.dumps(records.plain(asdict(self)), indent=2) + "\n", "utf-8")

    def gains(self, count: int) -> tuple[float, ...]:
        """Return g of each of the `count` entries of a command.

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
        """How long a command takes to show, τ + δ [s]."""
        return self.time_constant + self.delay

    @property
    def complaints(self) -> list[str]:
        """Where the robot does not follow, a sentence for each; empty where it does."""
        found = [
            f"entry {k} of the command: the robot gives {gain:.2f} of it"
            + (", against its sign" if gain < 0.0 else "")
            for k, gain in enumerate(self.gain)
            if not LEAST_GAIN <= gain <= MOST_GAIN
        ]
        if self.falls:
            found.append(f"the robot fell {self.falls} times in {self.seconds:g} s")
        return found


UNKNOWN = Response()  # assumed of an unmeasured robot of 1 m/s: it is slow, and oscillates


def assumed(command: Command) -> Response:
    """Return what is assumed of an unmeasured robot, by the limits of its commands.

    Speeds and paths of `UNKNOWN` grow with the greatest speed. A slow robot on wheels has less of
    both; one that also moves sideways may have legs, which oscillate as much when they are slow:
    its overshoot alone is less.
    """
    share = command.fastest
    moves = share if command.look_ahead is not None else max(1.0, share)
    half, often, almost = UNKNOWN.residual
    return replace(
        UNKNOWN,
        residual=(moves * half, moves * often, moves * almost),
        deviation=moves * UNKNOWN.deviation,
        overshoot=share * UNKNOWN.overshoot,
        stopping=moves * UNKNOWN.stopping,
    )
