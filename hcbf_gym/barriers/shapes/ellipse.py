"""An ellipse."""

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Pair
from hcbf_gym.barriers.shape import Oval, Shape, set_pairs
from hcbf_gym.errors import finite_float
from hcbf_gym.models.constants import ON_EARTH


@dataclass(frozen=True)
class Ellipse(Shape):
    """The outside of an ellipse: h is the signed distance to it.

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        center: (2,) c when the object is first returned or set [m].
        semi_axes: (2,) a and b [m], positive.
        angle: the angle of the first semi-axis from the world's x axis [rad].
        velocity: (2,) the velocity of the ellipse [m/s].

    Raises:
        InvalidInputError: if a semi-axis is not positive or a number is not finite.
    """

    center: Pair = (0.0, 0.0)
    semi_axes: Pair = (1.0, 1.0)
    angle: float = 0.0
    velocity: Pair = (0.0, 0.0)
    kind: ClassVar[str] = "ellipse"

    def __post_init__(self) -> None:
        super().__post_init__()
        set_pairs(self, "center", largest=ON_EARTH)
        set_pairs(self, "velocity", "semi_axes")
        for axis in self.semi_axes:
            finite_float(f"{self.name}: semi_axes", axis, minimum=0.0, exclusive=True)
        object.__setattr__(self, "angle", finite_float(f"{self.name}: angle", self.angle))

    def write(self, c: Array) -> int:
        """Write the block c (WIDTH,) and return the code."""
        return _core.ellipse_write(c, self.velocity, self.center, self.semi_axes, self.angle)

    def outline(self) -> Oval:
        """Return the ellipse."""
        return Oval(self.center, self.semi_axes, self.angle)

    @property
    def size(self) -> float:
        """The larger semi-axis [m]."""
        return max(self.semi_axes)

    def resized(self, size: float) -> Self:
        """Return an ellipse with another larger semi-axis and the same ratio of both."""
        a, b = self.semi_axes
        factor = size / self.size
        return replace(self, semi_axes=(factor * a, factor * b))
