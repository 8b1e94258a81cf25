"""The base of built-in shapes: how one is packed into numbers, drawn, moved and resized.

Each shape has a file in `shapes` and a struct in core/include/hcbf/shapes.hpp, whose functions
evaluate the shape's block of numbers (see `layout`) at a point in the shape's frame.
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Pair
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier, Core, PlanarBarrier
from hcbf_gym.errors import finite_array, finite_float
from hcbf_gym.models.constants import FARTHEST, ON_EARTH

PLACE = [2, 3]
"""The columns of a block that hold the first place of a shape [m]."""
TINY = 1e-9
"""A distance below which a direction is undefined [m], or a speed [m/s]."""


class Oval(NamedTuple):
    """The outline of a region that is an ellipse.

    Attributes:
        center: (2,) [m].
        semi_axes: (2,) [m].
        angle: the angle of the first semi-axis from the world's x axis [rad].
    """

    center: Pair
    semi_axes: Pair
    angle: float

    def corners(self, count: int = 64) -> Array:
        """Return (count, 2) points on the outline, counter-clockwise."""
        turn = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        along_axes = np.column_stack([np.cos(turn), np.sin(turn)]) * np.array(self.semi_axes)
        return self.center + along_axes @ np.array([[cos, sin], [-sin, cos]])


class Wall(NamedTuple):
    """The outline of an unbounded region, a straight line.

    Attributes:
        normal: (2,) unit vector into the allowed side.
        offset: n·p on the wall [m].
    """

    normal: Pair
    offset: float


Outline = Oval | Wall | Array
"""How a region is drawn; an array (k, 2) holds the corners of a convex one, counter-clockwise."""


@dataclass(frozen=True)
class Shape(PlanarBarrier):
    """A built-in region: the fields of a subclass are its numbers, by the names that JSON has.

    Attributes:
        kind: the name of the shape in JSON, for `Shapes` and in the core.
        code: the number by which compiled code finds its functions.
        places: the names of fields that are points; columns `PLACE` of a block hold the first.
    """

    kind: ClassVar[str]
    code: ClassVar[int]
    places: ClassVar[tuple[str, ...]] = ("center",)

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if vars(cls).get("kind") in _core.SHAPES:  # a user's own class has the code of its base
            cls.code = _core.SHAPES[cls.kind]

    @abstractmethod
    def write(self, c: Array) -> int:
        """Write the block c (WIDTH,) and return the code."""

    @classmethod
    def pack(cls, name: str, values: Array) -> Array:
        """Return (k, WIDTH) the blocks of k shapes at rest.

        Args:
            name: what messages call the shapes.
            values: (k, n) the fields of each shape in order, but for the velocity.

        Raises:
            InvalidInputError: if a value is out of range or the array of another shape.
        """
        sizes = {
            field.name: np.size(field.default)
            for field in fields(cls)
            if field.default is not MISSING and field.name != "velocity"
        }
        numbers = finite_array(name, values, (None, sum(sizes.values())), largest=ON_EARTH)
        blocks = np.zeros((len(numbers), layout.WIDTH))
        ends = np.cumsum(list(sizes.values()))[:-1]
        for row, block in zip(numbers, blocks, strict=True):
            by_field = zip(sizes, np.split(row, ends), strict=True)
            arguments = {key: part if part.size > 1 else float(part[0]) for key, part in by_field}
            cls(name, 1, **arguments).write(block)
        return blocks

    @classmethod
    def blocks_of(cls, shapes: Sequence[Any]) -> Array:
        """Return (k, WIDTH) the blocks of k shapes of this class."""
        blocks = np.zeros((len(shapes), layout.WIDTH))
        for shape, block in zip(shapes, blocks, strict=True):
            shape.write(block)
        return blocks

    @classmethod
    def shift(cls, blocks: Array, step: Array) -> None:
        """Move the shapes of blocks (k, WIDTH) by a step (2,) or by k steps (k, 2) [m]."""
        blocks[:, PLACE] += step

    @abstractmethod
    def outline(self) -> Outline:
        """Return how the region is drawn at time 0."""

    @property
    def anchor(self) -> Array:
        """(2,) the mean of the region's places at time 0 [m]."""
        return np.mean([getattr(self, name) for name in self.places], axis=0)

    @property
    @abstractmethod
    def size(self) -> float | None:
        """A radius, or a length like it [m]; None for an unbounded region."""

    def moved(self, step: Array) -> Self:
        """Return the same region elsewhere, a step (2,) [m] away."""
        return replace(self, **{name: shifted(getattr(self, name), step) for name in self.places})

    @abstractmethod
    def resized(self, size: float) -> Self:
        """Return a similar region around the same anchor, of another `size` [m]."""

    def planar_jet(self, q: Array) -> tuple[float, Array, Array]:
        """Return H, ∇H (2,) and ∇²H (2, 2); where ∇H has no direction, one is chosen."""
        x, y = float(q[0]), float(q[1])
        h, gx, gy, distance, tx, ty = _core.shape_jet(self.code, self._block, x, y)
        tangent = np.array((tx, ty))  # of the level line, scaled; ∇²H is 0 across it
        return h, np.array((gx, gy)), np.outer(tangent, tangent) / distance

    def core(self, q: Array, reach: float) -> Core:
        """Return the core; see `PlanarBarrier.core`."""
        x, y = float(q[0]), float(q[1])
        return Core(*_core.shape_core(self.code, self._block, x, y, reach))

    @cached_property
    def _block(self) -> Array:
        block = np.zeros(layout.WIDTH)
        self.write(block)
        return block


def set_pairs(barrier: Barrier, *names: str, largest: float = FARTHEST) -> None:
    """Replace fields by pairs of finite numbers, of magnitudes up to `largest`.

    Raises:
        InvalidInputError: if a field is no such pair.
    """
    for name in names:
        values = getattr(barrier, name)
        if type(values) is np.ndarray and values.dtype == np.float64 and values.shape == (2,):
            values = tuple(values.tolist())
            object.__setattr__(barrier, name, values)
        if type(values) is tuple and len(values) == 2:
            x, y = values
            is_plain = type(x) is float and type(y) is float
            if is_plain and -largest <= x <= largest and -largest <= y <= largest:
                continue  # `finite_array` would take most of a constructor's time
        pair = finite_array(f"{barrier.name}: {name}", values, (2,), largest=largest)
        object.__setattr__(barrier, name, tuple(pair.tolist()))


def set_positive(barrier: Barrier, name: str) -> None:
    """Replace a field by a positive number up to `FARTHEST`.

    Raises:
        InvalidInputError: if the field is no such number.
    """
    value = getattr(barrier, name)
    if type(value) is float and 0.0 < value <= FARTHEST:
        return
    label = f"{barrier.name}: {name}"
    number = finite_float(label, value, minimum=0.0, maximum=FARTHEST, exclusive=True)
    object.__setattr__(barrier, name, number)


def shifted(point: Pair, step: Array) -> Pair:
    """Return a point (2,) moved by a step (2,)."""
    return point[0] + float(step[0]), point[1] + float(step[1])
