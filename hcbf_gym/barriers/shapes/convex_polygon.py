"""A convex polygon."""

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Pair
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.shape import Shape, set_pairs, shifted
from hcbf_gym.errors import InvalidInputError, finite_array
from hcbf_gym.models.constants import ON_EARTH

COUNT, FIRST = 2, 3
"""The columns of a block with the number of corners, and with x of the first; x and y alternate."""
MAX_VERTICES = (layout.WIDTH - FIRST) // 2
"""The largest number of corners of a polygon."""
USED = layout.WIDTH - 1
"""The column, if there is room, with the part of a margin that errors may consume [m]."""


@dataclass(frozen=True)
class ConvexPolygon(Shape):
    """The outside of a convex polygon: h is the signed distance to it.

    Outside, h is continuously differentiable (its curvature jumps where the nearest point passes
    from an edge to a corner); inside, it is the depth below the nearest edge.

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        vertices: (k, 2) corners [m], counter-clockwise, 3 ≤ k ≤ 8, strictly convex.
        velocity: (2,) the velocity of the polygon [m/s].

    Raises:
        InvalidInputError: if the corners are too few, too many, clockwise or not strictly convex.
    """

    vertices: tuple[Pair, ...] = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
    velocity: Pair = (0.0, 0.0)
    kind: ClassVar[str] = "convex-polygon"

    def __post_init__(self) -> None:
        super().__post_init__()
        set_pairs(self, "velocity")
        name = f"{self.name}: vertices"
        corners = finite_array(name, self.vertices, (None, 2), largest=ON_EARTH)
        _check_convex(name, corners[None])
        object.__setattr__(self, "vertices", tuple(map(tuple, corners.tolist())))

    def write(self, c: Array) -> int:
        """Write the block c (WIDTH,) and return the code."""
        return _core.convex_polygon_write(c, self.velocity, np.array(self.vertices))

    @classmethod
    def pack(cls, name: str, values: Array) -> Array:
        """Return the blocks of k polygons (k, v, 2): v corners [m], counter-clockwise."""
        corners = finite_array(name, values, (None, None, 2), largest=ON_EARTH)
        _check_convex(name, corners)
        blocks = np.zeros((len(corners), layout.WIDTH))
        count = corners.shape[1]
        blocks[:, COUNT] = count
        blocks[:, FIRST : FIRST + 2 * count] = corners.reshape(len(corners), 2 * count)
        return blocks

    @classmethod
    def shift(cls, blocks: Array, step: Array) -> None:
        """Move the polygons of blocks (k, WIDTH) by a step (2,) or steps (k, 2) [m]."""
        is_corner = np.arange(MAX_VERTICES) < blocks[:, COUNT, None]
        steps = np.broadcast_to(step, (len(blocks), 2))[:, None] * is_corner[..., None]
        blocks[:, FIRST : FIRST + 2 * MAX_VERTICES] += steps.reshape(len(blocks), 2 * MAX_VERTICES)

    def outline(self) -> Array:
        """Return (k, 2) the corners."""
        return np.array(self.vertices)

    @property
    def anchor(self) -> Array:
        """(2,) the mean of the corners [m]."""
        return np.mean(self.vertices, axis=0)

    @property
    def size(self) -> float:
        """The distance from the mean of the corners to the farthest [m]."""
        return float(np.linalg.norm(self.vertices - self.anchor, axis=1).max())

    def moved(self, step: Array) -> Self:
        """Return the polygon a step (2,) away."""
        return replace(self, vertices=tuple(shifted(corner, step) for corner in self.vertices))

    def resized(self, size: float) -> Self:
        """Return a similar polygon around the same anchor."""
        corners = self.anchor + size / self.size * (np.array(self.vertices) - self.anchor)
        return replace(self, vertices=tuple(map(tuple, corners.tolist())))


def _check_convex(name: str, corners: Array) -> None:
    """Refuse corners (k, v, 2) that are not those of k strictly convex polygons."""
    if not 3 <= corners.shape[1] <= MAX_VERTICES:
        raise InvalidInputError(
            f"{name}: got {corners.shape[1]} corners, expected 3 to {MAX_VERTICES}"
        )
    edges = np.roll(corners, -1, axis=1) - corners
    following = np.roll(edges, -1, axis=1)
    cross = edges[..., 0] * following[..., 1] - edges[..., 1] * following[..., 0]
    turned = np.arctan2(cross, np.sum(edges * following, axis=2)).sum(axis=1)
    winds_twice = turned > 2.5 * np.pi  # as a star does; a convex polygon turns by 2π
    is_wrong = (cross <= 0.0).any(axis=1) | winds_twice
    if is_wrong.any():
        raise InvalidInputError(
            f"{name}: got {corners[is_wrong][0].tolist()}, "
            "expected the corners of a strictly convex polygon, counter-clockwise"
        )
