"""Many convex polygons in one array of numbers, with buckets that find those near a point.

The array is what compiled code reads; several stand behind one another in an *atlas*, and `at` is
where one of them begins. Buckets are squares in the frame of the map's grid, so that pieces along
its axes lie in few of them. A piece stands in all buckets that its box meets, and is reported from
the first of those that a search visits.

Places in the array are numbers of it, exact as doubles up to 2⁵³: one array is one argument of
every compiled call, and the pieces of another map follow without a table of their own.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.shapes import convex_polygon
from hcbf_gym.compilation import kernel
from hcbf_gym.models.constants import FARTHEST

COUNT, SIDE, COLUMNS, ROWS, X, Y, COS, SIN, STARTS, ITEMS, RINGS, BOXES, BLOCKS = range(13)
"""Where the head of the array holds how many pieces there are, the buckets' side [m], columns and
rows, the frame's origin and turn, and where the lists begin, counted from the head."""

BOX = 8
"""Numbers of a piece's box: least and greatest u and v in the frame [m], and its buckets."""

Frame = tuple[float, float, float]


class Pieces:
    """P convex polygons.

    Args:
        corners: (P, 8, 2) of each piece, counter-clockwise [m]; what lies beyond `count` counts
            not.
        count: (P,) corners of each, 3 to 8.
        frame: x [m], y [m] and yaw [rad] of the grid's origin.
        around: how many of them, the last, lie around the others and reach far beyond: buckets are
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
        x, y, yaw = frame
        self._frame, self._around, self._used = frame, around, used
        self.packed = _core.pieces_packed(blocks, x, y, yaw, len(count) - around)
        self.packed.flags.writeable = False

    def __len__(self) -> int:
        """Return P."""
        return int(self.packed[COUNT])

    def moved(self, step: Array) -> "Pieces":
        """Return the same pieces a step (2,) [m] away."""
        blocks = self.packed[int(self.packed[BLOCKS]) :].reshape(len(self), layout.WIDTH)
        corners = blocks[:, convex_polygon.FIRST :].reshape(len(self), -1, 2) + step
        x, y, yaw = self._frame
        frame = x + float(step[0]), y + float(step[1]), yaw
        count = blocks[:, convex_polygon.COUNT].astype(np.int64)
        return Pieces(corners, count, frame, self._around, self._used)

    @cached_property
    def polygons(self) -> list[Array]:
        """The corners (k, 2) of each piece [m]."""
        first = int(self.packed[BLOCKS])
        blocks = self.packed[first:].reshape(len(self), layout.WIDTH)
        ends = convex_polygon.FIRST + 2 * blocks[:, convex_polygon.COUNT].astype(np.int64)
        return [
            block[convex_polygon.FIRST : end].reshape(-1, 2)
            for block, end in zip(blocks, ends, strict=True)
        ]


class Nearest(NamedTuple):
    """The piece nearest a point.

    Attributes:
        distance: signed [m]; infinite where there is no piece.
        block: where its block begins in the atlas; −1 where there is none.
    """

    distance: float
    block: int


class Lists(NamedTuple):
    """Where the lists of pieces begin in the atlas.

    Attributes:
        starts: of each bucket's entries among the items.
        items: numbers of pieces, bucket after bucket.
        boxes: of the pieces.
        blocks: likewise.
    """

    starts: int
    items: int
    boxes: int
    blocks: int


@kernel(error_model="numpy", inline="always")
def lists_of(atlas: Array, at: int) -> Lists:
    """Return where the lists begin of the pieces that begin at `at`."""
    return Lists(
        at + int(atlas[at + STARTS]),
        at + int(atlas[at + ITEMS]),
        at + int(atlas[at + BOXES]),
        at + int(atlas[at + BLOCKS]),
    )


@kernel(error_model="numpy", inline="always")
def in_frame(atlas: Array, at: int, x: float, y: float) -> tuple[float, float]:
    """Return a point of the world in the frame of the buckets [m]."""
    dx, dy = x - atlas[at + X], y - atlas[at + Y]
    cos, sin = atlas[at + COS], atlas[at + SIN]
    return cos * dx + sin * dy, cos * dy - sin * dx


@kernel(error_model="numpy", inline="always")
def bucket_of(atlas: Array, at: int, place: float, most: int) -> int:
    """Return the bucket of a coordinate of the frame, the nearest for one beyond the last.

    What is no number is in the first one: as an index it would lead out of the atlas.
    """
    sides = place / atlas[at + SIDE]
    return int(min(sides, most - 1.0)) if sides > 0.0 else 0


@kernel(error_model="numpy", inline="always")
def height(atlas: Array, block: int, x: float, y: float) -> float:
    """Return the signed distance from the piece with the block at `block` [m]."""
    return convex_polygon.jet(atlas[block : block + layout.WIDTH], x, y)[0]


@kernel(error_model="numpy")
def jet(atlas: Array, at: int, x: float, y: float) -> tuple[float, float, float]:
    """Return the signed distance from the nearest piece [m] and its gradient, 0 without a piece."""
    found = nearest(atlas, at, x, y)
    if found.block < 0:
        return FARTHEST, 0.0, 0.0
    block = atlas[found.block : found.block + layout.WIDTH]
    _, gx, gy, _, _, _ = convex_polygon.jet(block, x, y)
    return min(found.distance, FARTHEST), gx, gy


@kernel(error_model="numpy")
def box_distance(atlas: Array, box: int, u: float, v: float) -> float:
    """Return the distance of a point of the frame from a piece's box [m]."""
    du = max(atlas[box] - u, u - atlas[box + 2], 0.0)
    dv = max(atlas[box + 1] - v, v - atlas[box + 3], 0.0)
    return np.sqrt(du * du + dv * dv)


@kernel(error_model="numpy")
def near(atlas: Array, at: int, x: float, y: float, reach: float, found: Integers) -> int:
    """Write the blocks of the pieces no farther than `reach` [m], and return how many there are.

    Where there are more than `found` (k,) has room for, only their number is of use.
    """
    columns, rows = int(atlas[at + COLUMNS]), int(atlas[at + ROWS])
    u, v = in_frame(atlas, at, x, y)
    c0, c1 = bucket_of(atlas, at, u - reach, columns), bucket_of(atlas, at, u + reach, columns)
    r0, r1 = bucket_of(atlas, at, v - reach, rows), bucket_of(atlas, at, v + reach, rows)
    starts, items, boxes, blocks = lists_of(atlas, at)
    total = 0
    for r in range(r0, r1 + 1):
        for c in range(c0, c1 + 1):
            bucket = starts + r * columns + c
            for i in range(items + int(atlas[bucket]), items + int(atlas[bucket + 1])):
                piece = int(atlas[i])
                box = boxes + BOX * piece
                if max(int(atlas[box + 4]), c0) != c or max(int(atlas[box + 5]), r0) != r:
                    continue  # an earlier bucket has it
                if box_distance(atlas, box, u, v) > reach:
                    continue
                block = blocks + layout.WIDTH * piece
                if height(atlas, block, x, y) <= reach:
                    if total < found.size:
                        found[total] = block
                    total += 1
    return total


@kernel(error_model="numpy")
def nearest(atlas: Array, at: int, x: float, y: float) -> Nearest:
    """Return the piece nearest a point: the one with the least signed distance.

    Buckets are searched in rings. A piece that no ring up to the k-th holds is no nearer than k
    sides and the distance from the point to the edge of its own bucket. For a point beyond all
    buckets that holds of the nearest point of them, and no piece
    is nearer to the one than to the other.
    """
    best = Nearest(np.inf, -1)
    if atlas[at + COUNT] == 0.0:
        return best
    columns, rows, side = int(atlas[at + COLUMNS]), int(atlas[at + ROWS]), atlas[at + SIDE]
    u, v = in_frame(atlas, at, x, y)
    c, r = bucket_of(atlas, at, u, columns), bucket_of(atlas, at, v, rows)
    starts, items, boxes, blocks = lists_of(atlas, at)
    inside_u = min(max(u - c * side, 0.0), side)
    inside_v = min(max(v - r * side, 0.0), side)
    edge = min(inside_u, side - inside_u, inside_v, side - inside_v)
    ring = int(atlas[at + int(atlas[at + RINGS]) + r * columns + c])
    while ring <= columns + rows:
        for i in range(max(r - ring, 0), min(r + ring, rows - 1) + 1):
            step = 1 if abs(i - r) == ring or ring == 0 else 2 * ring
            for j in range(c - ring, c + ring + 1, step):
                if not 0 <= j < columns:
                    continue
                bucket = starts + i * columns + j
                for k in range(items + int(atlas[bucket]), items + int(atlas[bucket + 1])):
                    piece = int(atlas[k])
                    if box_distance(atlas, boxes + BOX * piece, u, v) > max(best.distance, 0.0):
                        continue
                    block = blocks + layout.WIDTH * piece
                    distance = height(atlas, block, x, y)
                    if distance < best.distance:
                        best = Nearest(distance, block)
        if best.distance <= ring * side + edge:
            break
        ring += 1
    return best


@kernel(error_model="numpy")
def along(atlas: Array, at: int, path: Array, distance: Array) -> None:
    """Write the signed distances (k,) of points, the first columns of `path` (k, …), from pieces.

    The points lie close to one another: what is near the first is looked up once.
    """
    x, y = path[0, 0], path[0, 1]
    first = nearest(atlas, at, x, y)
    distance[:] = first.distance
    if first.block < 0:
        return
    far = 0.0
    for s in range(1, len(path)):
        far = max(far, np.hypot(path[s, 0] - x, path[s, 1] - y))
    found = np.empty(64, dtype=np.int64)
    reach = max(first.distance, 0.0) + 2.0 * far
    total = near(atlas, at, x, y, reach, found)
    if total > found.size:
        found = np.empty(total, dtype=np.int64)
        near(atlas, at, x, y, reach, found)
    for s in range(1, len(path)):
        distance[s] = np.inf
        for k in range(total):
            distance[s] = min(distance[s], height(atlas, found[k], path[s, 0], path[s, 1]))
