"""The parts of a walker's contract, one record for each, checked as they are made."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hcbf_gym import records
from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, choose, finite_array, finite_float

HEADINGS = {
    "velocity": "along the velocity",
    "fixed": "as at the start",
    "free": "by a rate that is set from outside",
}
KINDS = {"position": "home + scale × action", "direct": "scale × action"}  # an actuator's input
CONES = ("pyramidal", "elliptic")

MOST = 20.0  # of a command [m/s, rad/s, m]: beyond, the numbers are cm/s or degrees


@dataclass(frozen=True)
class Command:
    """The velocities that the robot may be commanded, in its own axes.

    Args:
        forward: greatest speed ahead and back [m/s], positive.
        turn: greatest turning rate [rad/s], positive.
        sideways: greatest speed to either side [m/s]; None for a differential drive.
        look_ahead: ℓ, of a differential drive alone: how far before its centre the point lies that
            moves in any direction [m].
        heading: a name of `HEADINGS`; a differential drive's heading follows from its motion.

    Raises:
        InvalidInputError: on a number out of range, or if not exactly one of `sideways` and
            `look_ahead` is given.
        UnknownNameError: if there is no such heading.
    """

    forward: float
    turn: float
    sideways: float | None = None
    look_ahead: float | None = None
    heading: str = "velocity"

    def __post_init__(self) -> None:
        for name in ("forward", "turn", "sideways", "look_ahead"):
            value = getattr(self, name)
            if name == "sideways" and isinstance(value, int | float) and value == 0.0:
                raise InvalidInputError(
                    "command: sideways: got 0, expected a number > 0; a differential drive has no "
                    "sideways and a look_ahead instead [m]: how far before its axle the point lies "
                    "that follows, about half of its length"
                )
            if value is not None or name in ("forward", "turn"):
                label = f"command: {name}"
                number = finite_float(label, value, minimum=0.0, maximum=MOST, exclusive=True)
                object.__setattr__(self, name, number)
        if (self.sideways is None) == (self.look_ahead is None):
            raise InvalidInputError(
                f"command: got sideways {self.sideways} and look_ahead {self.look_ahead}, expected "
                "one of them: sideways [m/s] where the robot moves in every direction, look_ahead "
                "[m] for a differential drive"
            )
        choose("heading", self.heading, HEADINGS)

    def in_plane(self, command: Array) -> Array:
        """Return (…, 2) the velocity of the point that follows, of commands (…, k), in its axes."""
        if self.look_ahead is None:
            return command[..., :2]
        return command * np.array([1.0, self.look_ahead])

    @property
    def fastest(self) -> float:
        """The greatest speed of the robot, along its axes; a cart's is that of its axle [m/s]."""
        return self.forward if self.sideways is None else max(self.forward, self.sideways)

    @property
    def limits(self) -> Array:
        """(k,) of the controller's command: (v_x, v_y, ω), or (v, ω)."""
        if self.sideways is None:
            return np.array([self.forward, self.turn])
        return np.array([self.forward, self.sideways, self.turn])


@dataclass(frozen=True)
class Action:
    """What the controller's output does.

    Args:
        scale: of the output, a number or one for each actuator.
        kind: a name of `KINDS`.
        home: (k,) joint positions of the start, in the order of the joints [rad].
        joints: names of the driven joints in the order of the output; None means every hinge and
            slide in the file's order, each with the actuator that drives it.
        actuators: names of actuators that drive no joint of their own; they replace `joints`.
        gains: ``{"kp": …, "kd": …}`` [N·m/rad, N·m·s/rad], numbers or one for each joint, of
            position servos that replace the file's actuators and keep their torque limits; None
            keeps the file's actuators.

    Raises:
        InvalidInputError: on a number that is none, names that are none, or both kinds of names.
        UnknownNameError: if there is no such kind.
    """

    scale: tuple[float, ...] = (1.0,)
    kind: str = "position"
    home: tuple[float, ...] | None = None
    joints: tuple[str, ...] | None = None
    actuators: tuple[str, ...] | None = None
    gains: Mapping[str, tuple[float, ...]] | None = None

    def __post_init__(self) -> None:
        choose("kind of action", self.kind, KINDS)
        for name in ("joints", "actuators"):
            given = getattr(self, name)
            object.__setattr__(self, name, None if given is None else names(name, given))
        if self.joints is not None and self.actuators is not None:
            raise InvalidInputError("action: got joints and actuators, expected one of them")
        object.__setattr__(self, "scale", numbers("action: scale", self.scale))
        if self.home is not None:
            home = finite_array("action: home", self.home, (None,))
            object.__setattr__(self, "home", tuple(home.tolist()))
        if self.gains is not None:
            object.__setattr__(self, "gains", _gains(self.gains))
        if self.actuators is not None and (self.gains is not None or self.kind == "position"):
            raise InvalidInputError(
                'action: got actuators by name, expected kind "direct" and no gains with them'
            )


@dataclass(frozen=True)
class Phase:
    """A clock that walks with the robot, φ_i = start_i + 2π f t."""

    frequency: float  # f [Hz], positive
    start: tuple[float, ...] = (0.0,)  # (k,) of every foot at the start [rad]

    def __post_init__(self) -> None:
        finite_float("phase: frequency", self.frequency, minimum=0.0, maximum=100.0, exclusive=True)
        start = finite_array("phase: start", self.start, (None,))
        object.__setattr__(self, "start", tuple(start.tolist()))


@dataclass(frozen=True)
class Fall:
    """When the robot counts as fallen."""

    height: float  # of the trunk's origin below which it has [m]
    tilt: float = 1.0  # of the trunk's vertical axis above which it has [rad]

    def __post_init__(self) -> None:
        finite_float("fall: height", self.height, minimum=0.0, maximum=100.0)
        finite_float("fall: tilt", self.tilt, minimum=0.0, maximum=np.pi, exclusive=True)


@dataclass(frozen=True)
class Physics:
    """How the file is simulated; None takes what it has."""

    timestep: float | None = None  # [s]; None takes the file's
    friction: float = 0.6  # of the floor, which decides alone
    cone: str | None = None  # of the contacts, "pyramidal" or "elliptic"; None takes the file's
    impratio: float | None = None  # of the contacts; None takes the file's
    armature: float | None = None  # of every driven joint [kg·m²]; None takes the file's
    damping: float | None = None  # of every driven joint [N·m·s/rad]; None takes the file's
    frictionloss: float | None = None  # of every driven joint [N·m]; None takes the file's

    def __post_init__(self) -> None:
        finite_float("physics: friction", self.friction, minimum=0.0, maximum=10.0, exclusive=True)
        if self.cone is not None:
            choose("cone", self.cone, dict.fromkeys(CONES))
        for name, most in (("timestep", 0.02), ("impratio", 1e4)):
            value = getattr(self, name)
            if value is not None:
                finite_float(f"physics: {name}", value, minimum=1e-4, maximum=most)
        for name in ("armature", "damping", "frictionloss"):
            value = getattr(self, name)
            if value is not None:
                finite_float(f"physics: {name}", value, minimum=0.0, maximum=1e3)


@dataclass(frozen=True)
class Body:
    """What of the file is the robot's body.

    Args:
        trunk: name of the body that floats; None takes the one with the free joint.
        height: of its origin above flat ground at the start [m].
        reach: radius of the circle around its centre that holds the moving robot [m]; None derives
            it from the geoms at home.
    """

    height: float
    trunk: str | None = None
    reach: float | None = None

    def __post_init__(self) -> None:
        finite_float("body: height", self.height, minimum=0.0, maximum=100.0, exclusive=True)
        if self.trunk is not None and not isinstance(self.trunk, str):
            raise InvalidInputError(f"body: trunk: got {self.trunk!r}, expected a name")
        if self.reach is not None:
            finite_float("body: reach", self.reach, minimum=0.0, maximum=100.0, exclusive=True)


def names(what: str, value: object) -> tuple[str, ...]:
    """Return a list of different names as a tuple, or raise InvalidInputError."""
    listed = value if isinstance(value, Sequence) and not isinstance(value, str) else ()
    if not listed or not all(isinstance(name, str) and name for name in listed):
        raise InvalidInputError(f"{what}: got {value!r}, expected a list of names")
    if len(set(listed)) != len(listed):
        raise InvalidInputError(f"{what}: got {list(listed)}, expected every name once")
    return tuple(listed)


def numbers(what: str, value: object) -> tuple[float, ...]:
    """Return numbers, or one for all, as a tuple, or raise InvalidInputError."""
    listed = isinstance(value, list | tuple | np.ndarray)
    array = finite_array(what, value if listed else [value], (None,), largest=1e6)
    if not array.size:
        raise InvalidInputError(f"{what}: got an empty list, expected a number or one for each")
    return tuple(array.tolist())


def spread(what: str, values: tuple[float, ...], count: int) -> Array:
    """Return (count,) numbers of as many, or of one for all, or raise InvalidInputError."""
    if len(values) not in (1, count):
        raise InvalidInputError(f"{what}: got {len(values)} numbers, expected 1 or {count}")
    return np.broadcast_to(np.array(values), count).copy()


def _gains(value: Any) -> Mapping[str, tuple[float, ...]]:
    records.check_mapping("action: gains", value)
    if set(value) != {"kp", "kd"}:
        raise InvalidInputError(f"action: gains: got {sorted(value)}, expected ['kd', 'kp']")
    gains = {name: numbers(f"action: gains: {name}", value[name]) for name in ("kp", "kd")}
    if min(min(part) for part in gains.values()) < 0.0:
        raise InvalidInputError(f"action: gains: got {value!r}, expected none below 0")
    return gains
