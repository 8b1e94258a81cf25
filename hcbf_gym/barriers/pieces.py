"""Many convex polygons in one array of numbers, with buckets that find those near a point.

Compiled code reads the array, which begins with a head (see core/include/hcbf/pieces.hpp). Several
such arrays are one behind another in an *atlas*. Buckets are squares in the frame of the map's
grid, so that a piece along its axes is in few of them. A piece is in all buckets that its box
meets, and a search reports it from the first of these that it visits.

Indices in the array are stored as doubles, which are exact up to 2⁵³. So one array is the only
argument of every compiled call, and the pieces of another map need no table.
"""

from functools import cached_property

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.shapes import convex_polygon

COUNT, BLOCKS = 0, 12
"""The entries of the head with the number of pieces, and with the index of the first block."""

Frame = tuple[float, float, float]
"""x [m], y [m] and yaw [rad] of a grid's origin."""


class Pieces:
    """P convex polygons.

    Args:
        corners: (P, 8, 2) of each piece, counter-clockwise [m]; entries beyond `count` are ignored.
        count: (P,) the number of corners of each piece, 3 to 8.
        frame: the grid's origin.
        around: how many pieces, the last ones, surround the others and reach far beyond; the
            buckets have the size of the others.
        used: the part of the margin of these pieces that errors of measurement may consume [m]; a
            piece has room for it with at most 7 corners.

    Attributes:
        packed: (L,) the numbers that compiled code reads.
    """

    def __init__(
        self, corners: Array, count: Integers, frame: Frame, around: int = 0, used: float = 0.0
    ):
        blocks = np.zeros((len(count), layout.WIDTH))
        blocks[:, convex_polygon.COUNT] = count
        is_corner = np.arange(corners.shape[1]) < count[:, None]
        columns = slice(convex_polygon.FIRST, convex_polygon.FIRST + 2 * corners.shape[1])
        blocks[:, columns] = np.where(is_corner[..., None], corners, 0.0).reshape(
            len(count), 2 * corners.shape[1]
        )
        if used > 0.0:
            blocks[:, convex_polygon.USED] = used
        self._frame, self._around, self._used = frame, around, used
        self.packed = _core.pieces_packed(blocks, *frame, len(count) - around)
        self.packed.flags.writeable = False

    def __len__(self) -> int:
        """Return P."""
        return int(self.packed[COUNT])

    def moved(self, step: Array) -> "Pieces":
        """Return the same pieces a step (2,) [m] away."""
        corners = self._blocks[:, convex_polygon.FIRST :].reshape(len(self), -1, 2) + step
        x, y, yaw = self._frame
        frame = x + float(step[0]), y + float(step[1]), yaw
        count = self._blocks[:, convex_polygon.COUNT].astype(np.int64)
        return Pieces(corners, count, frame, self._around, self._used)

    @property
    def _blocks(self) -> Array:
        """(P, WIDTH) the blocks of the polygons."""
        return self.packed[int(self.packed[BLOCKS]) :].reshape(len(self), layout.WIDTH)

    @cached_property
    def polygons(self) -> list[Array]:
        """The corners (k, 2) of each piece [m]."""
        counts = self._blocks[:, convex_polygon.COUNT].astype(np.int64)
        first = convex_polygon.FIRST
        return [
            block[first : first + 2 * count].reshape(-1, 2)
            for block, count in zip(self._blocks, counts, strict=True)
        ]
