"""Randomization: the ranges in which the plant may differ from the controller's model."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, finite_array, finite_float
from hcbf_gym.records import build, check_mapping

Range = tuple[float, float]

LARGEST_END = {
    "floor_friction": 10.0,
    "payload": 100.0,  # [kg]
    "motor_strength": 10.0,
    "delay": 1.0,  # [s]
    "sensor_noise": 100.0,
    "start_distance": 100.0,  # [m]
    "start_yaw": float(np.pi),  # [rad]
}
"""Greatest end of each range. More would be a mistake, or a delay that fills the memory."""

FARTHEST_PAYLOAD = 1.0  # from the trunk's origin along an axis [m]


class PlantConditions(NamedTuple):
    """The conditions of one episode, in the units of `Randomization`."""

    floor_friction: float
    payload: float
    motor_strength: float
    delay: float
    sensor_noise: float


@dataclass(frozen=True)
class Randomization:
    """Ranges from which each episode's plant is drawn uniformly; a number is a range of one.

    Args:
        floor_friction: Coulomb friction of the feet's contacts, positive.
        payload: mass of a box on the trunk [kg].
        payload_position: (3,) centre of that box in the trunk's axes [m].
        motor_strength: share of the commanded torque that arrives, positive.
        delay: time between a measurement and the torque it leads to [s], rounded to physics ticks;
            on the nominal plant one tick of the 500 Hz loop.
        sensor_noise: scale of white noise on the controller's measurements; 1 means standard
            deviations of 0.1 m/s, 0.2 rad/s, 0.005 rad on the trunk, 0.01 rad and 0.6 rad/s on the
            joints, and one contact in 200 reported wrongly.
        start_distance: distance from the scenario's start, in any direction [m].
        start_yaw: angle to either side of the reference's direction [rad].

    Raises:
        InvalidInputError: on a range that is empty, not finite or beyond `LARGEST_END`.
    """

    floor_friction: Range = (0.8, 0.8)
    payload: Range = (0.0, 0.0)
    payload_position: tuple[float, float, float] = (0.0, 0.0, 0.08)
    motor_strength: Range = (1.0, 1.0)
    delay: Range = (0.002, 0.002)
    sensor_noise: Range = (0.0, 0.0)
    start_distance: Range = (0.0, 0.0)
    start_yaw: Range = (0.0, 0.0)

    def __post_init__(self) -> None:
        positive = ("floor_friction", "motor_strength")
        for name in (*PlantConditions._fields, "start_distance", "start_yaw"):
            bounds = _range(name, getattr(self, name), exclusive=name in positive)
            object.__setattr__(self, name, bounds)
        position = self.payload_position
        checked = finite_array("payload_position", position, (3,), largest=FARTHEST_PAYLOAD)
        object.__setattr__(self, "payload_position", tuple(checked.tolist()))

    @classmethod
    def from_dict(cls, values: Mapping[str, object] | None) -> "Randomization":
        """Return the ranges that a plain dict names; None means the nominal plant."""
        if values is None:
            return cls()
        check_mapping("randomization", values)
        return build("randomization", cls, values)

    @property
    def off_nominal(self) -> bool:
        """Whether the plant's conditions may differ from the nominal ones, wherever it starts."""
        nominal, names = Randomization(), PlantConditions._fields
        return any(getattr(self, name) != getattr(nominal, name) for name in names)

    def draw(self, rng: np.random.Generator) -> PlantConditions:
        """Draw an episode's conditions; each takes one number from `rng`, whatever its range."""
        ranges = (getattr(self, name) for name in PlantConditions._fields)
        return PlantConditions(*(float(rng.uniform(low, high)) for low, high in ranges))

    def draw_start(self, rng: np.random.Generator) -> tuple[Array, float]:
        """Draw the offset (2,) [m] and the turn [rad] of an episode's start from the scenario's."""
        direction = rng.uniform(-np.pi, np.pi)
        side = rng.choice([-1.0, 1.0])
        distance = rng.uniform(*self.start_distance)
        offset = distance * np.array([np.cos(direction), np.sin(direction)])
        return offset, float(side * rng.uniform(*self.start_yaw))


def _range(name: str, value: object, exclusive: bool) -> Range:
    """Return the checked ends of a range, or of a number twice; exclusive refuses zero."""
    pair = value if isinstance(value, list | tuple | np.ndarray) else (value, value)
    if len(pair) != 2:
        raise InvalidInputError(f"{name}: got {value!r}, expected a number or [low, high]")
    low, high = (
        finite_float(name, end, minimum=0.0, maximum=LARGEST_END[name], exclusive=exclusive)
        for end in pair
    )
    if low > high:
        raise InvalidInputError(f"{name}: got {value!r}, expected low <= high")
    return low, high
