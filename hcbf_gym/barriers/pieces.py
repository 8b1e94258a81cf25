"""Many convex polygons in one array of numbers, with buckets that find those near a point.

The array is what compiled code reads; several are one behind another in an *atlas*, and `at` is
where one of them begins. Buckets are squares in the frame of the map's grid, so that pieces along
its axes are in few of them. A piece is in all buckets that its box meets, and is reported from the
first of those that a search visits.

Places in the array are numbers of it, exact as doubles up to 2⁵³: one array is one argument of
every compiled call, and the pieces of another map follow without a table of their own.
"""

from functools import cached_property

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.shapes import convex_polygon

COUNT, BLOCKS = 0, 12
"""Where the head of the array has how many pieces there are, and where their blocks begin."""

Frame = tuple[float, float, float]


class Pieces:
    """P convex polygons.

    Args:
        corners: (P, 8, 2) of each piece, counter-clockwise [m]; what is beyond `count` does not
            matter.
        count: (P,) corners of each, 3 to 8.
        frame: x [m], y [m] and yaw [rad] of the grid's origin.
        around: how many of them, the last, are around the others and reach far beyond: buckets are
            made for the others.
        used: what of their margin errors of measurement may use [m], of at most 7 corners each.

    Attributes:
        packed: (L,) the numbers that compiled code reads.
    """

    def __init__(
        self, corners: Array, count: Integers, frame: Frame, around: int = 0, used: float = 0.0
    ):
        blocks = np.zeros((len(count), layout.WIDTH))
        blocks[:, convex_polygon.COUNT] = count
        inner = np.arange(corners.shape[1]) < count[:, None]
        kept = np.where(inner[..., None], corners, 0.0).reshape(len(count), 2 * corners.shape[1])
        blocks[:, convex_polygon.FIRST : convex_polygon.FIRST + kept.shape[1]] = kept
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
        return self.packed[int(self.packed[BLOCKS]) :].reshape(len(self), layout.WIDTH)

    @cached_property
    def polygons(self) -> list[Array]:
        """The corners (k, 2) of each piece [m]."""
        ends = convex_polygon.FIRST + 2 * self._blocks[:, convex_polygon.COUNT].astype(np.int64)
        return [
            block[convex_polygon.FIRST : end].reshape(-1, 2)
            for block, end in zip(self._blocks, ends, strict=True)
        ]
