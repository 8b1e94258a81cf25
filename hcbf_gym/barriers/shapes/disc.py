"""A disc."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Pair
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.shape import PLACE, Oval, Shape, set_pairs, set_positive
from hcbf_gym.errors import InvalidInputError, finite_array
from hcbf_gym.models.constants import ON_EARTH

_RADIUS = 4  # the column of a block with the radius [m], behind the centre


@dataclass(frozen=True)
class Disc(Shape):
    """The outside of a disc, ``h = ‖p − c‖ − r``.

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        center: (2,) c when the object is first returned or set [m].
        radius: r [m], positive.
        velocity: (2,) the velocity of the disc [m/s].

    Raises:
        InvalidInputError: if the radius is not positive or a number is not finite.

    Source: section IV-A of the paper, h₃ and h₄.
    """

    center: Pair = (0.0, 0.0)
    radius: float = 1.0
    velocity: Pair = (0.0, 0.0)
    kind: ClassVar[str] = "disc"

    def __post_init__(self) -> None:
        super().__post_init__()
        set_pairs(self, "center", largest=ON_EARTH)
        set_pairs(self, "velocity")
        set_positive(self, "radius")

    def write(self, c: Array) -> int:
        """Write the block c (WIDTH,) and return the code."""
        return _core.disc_write(c, self.velocity, self.center, self.radius)

    @classmethod
    def pack(cls, name: str, values: Array) -> Array:
        """Return the blocks of k discs (k, 3): centre and radius [m]."""
        discs = finite_array(name, values, (None, 3), largest=ON_EARTH)
        if (discs[:, 2] <= 0.0).any():
            raise InvalidInputError(f"{name}: got radius {discs[:, 2].min()}, expected > 0")
        blocks = np.zeros((len(discs), layout.WIDTH))
        blocks[:, [*PLACE, _RADIUS]] = discs
        return blocks

    @classmethod
    def blocks_of(cls, shapes: Sequence[Any]) -> Array:
        """Return (k, WIDTH) the blocks of k discs, without a call of the core for each."""
        blocks = np.zeros((len(shapes), layout.WIDTH))
        numbers = [(*disc.velocity, *disc.center, disc.radius) for disc in shapes]
        columns = [layout.VELOCITY_X, layout.VELOCITY_Y, *PLACE, _RADIUS]
        blocks[:, columns] = np.reshape(numbers, (-1, len(columns)))
        return blocks

    def outline(self) -> Oval:
        """Return the circle."""
        return Oval(self.center, (self.radius, self.radius), 0.0)

    @property
    def size(self) -> float:
        """The radius [m]."""
        return self.radius

    def resized(self, size: float) -> Self:
        """Return a disc around the same centre with another radius."""
        return replace(self, radius=size)
