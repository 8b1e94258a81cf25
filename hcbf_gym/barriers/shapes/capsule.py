"""A capsule: all points within a radius of a segment."""

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Pair
from hcbf_gym.barriers.shape import Shape, set_pairs, set_positive
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.constants import ON_EARTH


@dataclass(frozen=True)
class Capsule(Shape):
    """The outside of a capsule, ``h = min_{s ∈ [0, 1]} ‖p − (1 − s) a − s b‖ − r``.

    h is the distance to the capsule, and continuously differentiable except on the segment.

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        start: (2,) a, where the segment starts when the object is first returned or set [m].
        end: (2,) b, where it ends, another point [m].
        radius: r [m], positive.
        velocity: (2,) the velocity of the capsule [m/s].

    Raises:
        InvalidInputError: if both ends are one point, the radius is not positive or a number is not
            finite.
    """

    start: Pair = (0.0, 0.0)
    end: Pair = (1.0, 0.0)
    radius: float = 1.0
    velocity: Pair = (0.0, 0.0)
    kind: ClassVar[str] = "capsule"
    places: ClassVar[tuple[str, ...]] = ("start", "end")

    def __post_init__(self) -> None:
        super().__post_init__()
        set_pairs(self, "start", "end", largest=ON_EARTH)
        set_pairs(self, "velocity")
        set_positive(self, "radius")
        if np.linalg.norm(self._vector) <= 1e-9:
            raise InvalidInputError(
                f"{self.name}: end: got {self.end}, expected a point away from the start "
                f"{self.start}; a disc has one"
            )

    @property
    def _vector(self) -> Array:
        """(2,) from the start to the end [m]."""
        return np.subtract(self.end, self.start)

    def write(self, c: Array) -> int:
        """Write the block c (WIDTH,) and return the code."""
        return _core.capsule_write(c, self.velocity, self.start, self.end, self.radius)

    def outline(self) -> Array:
        """Return (34, 2) corners, the half circle around the end first."""
        heading = np.arctan2(self._vector[1], self._vector[0])
        angles = heading + np.linspace(-0.5, 0.5, 17) * np.pi
        half_circle = self.radius * np.column_stack([np.cos(angles), np.sin(angles)])
        return np.concatenate([self.end + half_circle, self.start - half_circle])

    @property
    def size(self) -> float:
        """The radius [m]."""
        return self.radius

    def resized(self, size: float) -> Self:
        """Return a capsule with another radius and the same ratio of length to radius."""
        half = 0.5 * size / self.radius * self._vector
        start = (self.anchor - half).tolist()
        end = (self.anchor + half).tolist()
        return replace(self, start=tuple(start), end=tuple(end), radius=size)
