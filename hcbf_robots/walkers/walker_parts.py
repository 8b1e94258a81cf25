"""The sections of a walker's contract, one record for each, checked as they are constructed."""

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
GREATEST_LIMIT = 20.0  # of a command [m/s, rad/s, m]; greater numbers are cm/s or degrees


@dataclass(frozen=True)
class Command:
    """The velocities that the robot may be commanded, in its own axes.

    Args:
        forward: greatest speed ahead and back [m/s], positive.
        turn: greatest turning rate [rad/s], positive.
        sideways: greatest speed to either side [m/s]; None for a differential drive.
        look_ahead: ℓ, how far before the centre of a differential drive the point lies that moves
            in any direction [m]; None for a robot that moves sideways.
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
        if isinstance(self.sideways, int | float) and self.sideways == 0.0:
            raise InvalidInputError(
                "command: sideways: got 0, expected a number > 0; a differential drive has no "
                "sideways and a look_ahead instead [m]: how far before its axle the point lies "
                "that follows, about half of its length"
            )
        for name in ("forward", "turn", "sideways", "look_ahead"):
            value = getattr(self, name)
            if value is not None or name in ("forward", "turn"):
                label, most = f"command: {name}", GREATEST_LIMIT
                number = finite_float(label, value, minimum=0.0, maximum=most, exclusive=True)
                object.__setattr__(self, name, number)
        if (self.sideways is None) == (self.look_ahead is None):
            raise InvalidInputError(
                f"command: got sideways {self.sideways} and look_ahead {self.look_ahead}, expected "
                "one of them: sideways [m/s] where the robot moves in every direction, look_ahead "
                "[m] for a differential drive"
            )
        choose("heading", self.heading, HEADINGS)

    def in_plane(self, command: Array) -> Array:
        """Return the velocities (…, 2) in the robot's axes that commands (…, k) give its point."""
        if self.look_ahead is None:
            return command[..., :2]
        return command * np.array([1.0, self.look_ahead])

    @property
    def fastest(self) -> float:
        """The greatest speed along one of the robot's axes, of an axle without its point [m/s]."""
        return self.forward if self.sideways is None else max(self.forward, self.sideways)

    @property
    def limits(self) -> Array:
        """(k,) the greatest command: (v_x, v_y, ω), or (v, ω) [m/s, rad/s]."""
        if self.sideways is None:
            return np.array([self.forward, self.turn])
        return np.array([self.forward, self.sideways, self.turn])


@dataclass(frozen=True)
class Action:
    """How the controller's output drives the actuators.

    Args:
        scale: factor of the output, one for all actuators or one for each.
        kind: a name of `KINDS`.
        home: (k,) joint positions at the start, in the order of the joints [rad].
        joints: names of the driven joints in the order of the output; None means every hinge and
            slide in the file's order, each with the actuator that drives it.
        actuators: names of actuators that drive no joint of their own; they replace `joints`.
        gains: ``{"kp": …, "kd": …}`` [N·m/rad, N·m·s/rad], numbers or one for each joint, of
            position servos that replace the file's actuators and keep their torque limits; None
            keeps the file's actuators.

    Raises:
        InvalidInputError: on malformed numbers or names, or if both joints and actuators are named.
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
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, names(name, value))
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
    """The clock of a gait, with the phases φ_i = start_i + 2π f t."""

    frequency: float  # f [Hz], positive
    start: tuple[float, ...] = (0.0,)  # (p,) the phase of every foot at the start [rad]

    def __post_init__(self) -> None:
        finite_float("phase: frequency", self.frequency, minimum=0.0, maximum=100.0, exclusive=True)
        start = finite_array("phase: start", self.start, (None,))
        object.__setattr__(self, "start", tuple(start.tolist()))


@dataclass(frozen=True)
class Fall:
    """The limits of the trunk's pose, beyond which the robot counts as fallen."""

    height: float  # least height of the trunk's origin [m]
    tilt: float = 1.0  # greatest angle between the trunk's vertical axis and the world's [rad]

    def __post_init__(self) -> None:
        finite_float("fall: height", self.height, minimum=0.0, maximum=100.0)
        finite_float("fall: tilt", self.tilt, minimum=0.0, maximum=np.pi, exclusive=True)


@dataclass(frozen=True)
class Physics:
    """The physical parameters of the simulation; None takes the file's."""

    timestep: float | None = None  # [s]
    friction: float = 0.6  # of every contact with the floor, whatever the other geom's
    cone: str | None = None  # friction cone of the contacts, one of `CONES`
    impratio: float | None = None  # of the contacts [-], as MuJoCo defines it
    armature: float | None = None  # of every driven joint [kg·m²]
    damping: float | None = None  # of every driven joint [N·m·s/rad]
    frictionloss: float | None = None  # of every driven joint [N·m]

    def __post_init__(self) -> None:
        finite_float("physics: friction", self.friction, minimum=0.0, maximum=10.0, exclusive=True)
        if self.cone is not None:
            choose("cone", self.cone, dict.fromkeys(CONES))
        ranges = {"timestep": (1e-4, 0.02), "impratio": (1e-4, 1e4)}
        ranges |= dict.fromkeys(("armature", "damping", "frictionloss"), (0.0, 1e3))
        for name, (least, most) in ranges.items():
            value = getattr(self, name)
            if value is not None:
                finite_float(f"physics: {name}", value, minimum=least, maximum=most)


@dataclass(frozen=True)
class Body:
    """The robot's trunk, its height at the start, and the robot's size.

    Args:
        trunk: name of the body with the free joint; None finds it.
        height: height of the trunk's origin above flat ground at the start [m].
        reach: radius of the circle around the trunk's centre that contains the moving robot [m];
            None derives it from the geoms with the joints at home.
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
    """Return a non-empty list of different names as a tuple, or raise InvalidInputError."""
    listed = value if isinstance(value, Sequence) and not isinstance(value, str) else ()
    if not listed or not all(isinstance(name, str) and name for name in listed):
        raise InvalidInputError(f"{what}: got {value!r}, expected a list of names")
    if len(set(listed)) != len(listed):
        raise InvalidInputError(f"{what}: got {list(listed)}, expected every name once")
    return tuple(listed)


def numbers(what: str, value: object) -> tuple[float, ...]:
    """Return one number or a list of numbers as a tuple, or raise InvalidInputError."""
    listed = value if isinstance(value, list | tuple | np.ndarray) else [value]
    array = finite_array(what, listed, (None,), largest=1e6)
    if not array.size:
        raise InvalidInputError(f"{what}: got an empty list, expected a number or one for each")
    return tuple(array.tolist())


def spread(what: str, values: tuple[float, ...], count: int) -> Array:
    """Return (count,) numbers, from as many or from one for all, or raise InvalidInputError."""
    if len(values) not in (1, count):
        raise InvalidInputError(f"{what}: got {len(values)} numbers, expected 1 or {count}")
    return np.broadcast_to(np.array(values), count).copy()


def _gains(value: Any) -> Mapping[str, tuple[float, ...]]:
    """Return the checked gains kp and kd of servos, none of them negative."""
    records.check_mapping("action: gains", value)
    if set(value) != {"kp", "kd"}:
        raise InvalidInputError(f"action: gains: got {sorted(value)}, expected ['kd', 'kp']")
    gains = {name: numbers(f"action: gains: {name}", value[name]) for name in ("kp", "kd")}
    if min(*gains["kp"], *gains["kd"]) < 0.0:
        raise InvalidInputError(f"action: gains: got {value!r}, expected none below 0")
    return gains
