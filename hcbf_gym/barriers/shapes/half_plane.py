"""A straight wall."""

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Pair
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.shape import Shape, Wall
from hcbf_gym.errors import InvalidInputError, finite_array, finite_float
from hcbf_gym.models.constants import ON_EARTH

NORMAL_X, NORMAL_Y, OFFSET = 2, 3, 4  # columns of a block


@dataclass(frozen=True)
class HalfPlane(Shape):
    """The allowed side of a straight wall, ``h = n·p − offset``.

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        normal: (2,) unit vector that points into the allowed side.
        offset: n·p on the wall [m].

    Raises:
        InvalidInputError: if the normal is not a unit vector or a number is not finite.
    """

    normal: Pair = (1.0, 0.0)
    offset: float = 0.0
    kind: ClassVar[str] = "half-plane"

    def __post_init__(self) -> None:
        super().__post_init__()
        normal = finite_array(f"{self.name}: normal", self.normal, (2,))
        label = f"{self.name}: offset"
        offset = finite_float(label, self.offset, minimum=-ON_EARTH, maximum=ON_EARTH)
        wall = _with_unit_normal(f"{self.name}: normal", np.array([*normal, offset]))
        *unit_normal, offset = wall.tolist()
        object.__setattr__(self, "normal", tuple(unit_normal))
        object.__setattr__(self, "offset", offset)

    def write(self, c: Array) -> int:
        """Write the block c (WIDTH,) and return the code."""
        return _core.half_plane_write(c, self.normal, self.offset)

    @classmethod
    def pack(cls, name: str, values: Array) -> Array:
        """Return the blocks of k walls (k, 3): unit normal and offset [m]."""
        walls = finite_array(name, values, (None, 3), largest=ON_EARTH)
        blocks = np.zeros((len(walls), layout.WIDTH))
        blocks[:, [NORMAL_X, NORMAL_Y, OFFSET]] = _with_unit_normal(name, walls)
        return blocks

    @classmethod
    def shift(cls, blocks: Array, step: Array) -> None:
        """Move the walls of blocks (k, WIDTH) by a step (2,) or steps (k, 2) [m]."""
        blocks[:, OFFSET] += (blocks[:, [NORMAL_X, NORMAL_Y]] * step).sum(axis=1)

    def outline(self) -> Wall:
        """Return the wall."""
        return Wall(self.normal, self.offset)

    @property
    def anchor(self) -> Array:
        """(2,) the point of the wall nearest the origin [m]."""
        return self.offset * np.array(self.normal)

    @property
    def size(self) -> None:
        """None, because a wall is unbounded."""
        return

    def moved(self, step: Array) -> Self:
        """Return the wall a step (2,) away."""
        return replace(self, offset=self.offset + float(step @ np.array(self.normal)))

    def resized(self, size: float) -> Self:
        """Raise an error, because a wall has no size.

        Raises:
            InvalidInputError: always.
        """
        raise InvalidInputError(f"{self.name}: got a wall, expected a region that has a size")


def _with_unit_normal(name: str, walls: Array) -> Array:
    """Return walls (…, 3), normal and offset [m], divided by the lengths of their normals.

    A normal that was rounded to a few digits is not quite a unit vector. Far from the origin, as in
    survey coordinates, the given offset would then put the wall metres away.
    """
    with np.errstate(over="ignore"):  # an infinite length is refused like any other
        lengths = np.linalg.norm(walls[..., :2], axis=-1, keepdims=True)
    errors = np.abs(lengths - 1.0)
    if (errors > 1e-6).any():
        worst = float(lengths.flat[np.argmax(errors)])
        raise InvalidInputError(f"{name}: got a normal of length {worst}, expected 1")
    return np.where(errors > 1e-12, walls / lengths, walls)
