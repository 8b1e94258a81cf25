r"""Cells covered by few convex pieces: greedy rectangles, merged where their hull stays near them.

A piece is the convex hull of some rectangles of cells. It has at most eight corners, all on the
grid's crossings, and holds no point that lies more than one cell from an occupied square: it meets
no cell but occupied ones and those that share an edge with one. So a cell that is covered is never
lost, and a gap narrows by at most one cell from each side.

A merge is looked at row by row. All merges together may look at no more than `WORK` rows for each
cell, so that the cost grows with the cells and with nothing else. Rooms need a few rows for each
cell. Where a raster needs more, what is left stays in more pieces, which cover the same cells.
"""

from typing import NamedTuple, Self

import numpy as np

from hcbf_gym.arrays import Array, Integers, Mask, Places
from hcbf_gym.compilation import kernel
from hcbf_gym.errors import InvalidInputError

MOST_PIECES = 500_000
"""Of a cover: a raster that needs more shows no walls."""
WORK, LEAST_WORK = 100, 1_000_000
"""Rows that merges may look at: so many for each cell, and at least so many in all."""
MOST_CORNERS = 8
"""Of a piece, as many as a convex polygon's block of numbers holds."""

GROWTH = 1e-6
"""By how much pieces reach beyond their cells [cell]: more than the rounding of any distance."""

Window = tuple[int, int, int, int]


class Cover(NamedTuple):
    """The convex pieces that cover a class of cells.

    Attributes:
        corners: (P, 8, 2) column and row of each piece's corners, counter-clockwise; the rest 0.
        sizes: (P,) how many there are.
        owner: (rows, columns) which piece answers for a cell, −1 for none.
    """

    corners: Integers
    sizes: Integers
    owner: Places

    @classmethod
    def of(cls, cells: Mask) -> Self:
        """Return the cover of all true cells (rows, columns).

        Raises:
            InvalidInputError: if it needs more than `MOST_PIECES`.
        """
        owner = np.full(cells.shape, -1, dtype=np.int32)
        whole = (0, 0, cells.shape[0], cells.shape[1])
        return cls(*_cover(cells, *whole, owner, 0), owner)._checked()

    def _checked(self) -> Self:
        """Return the cover.

        Raises:
            InvalidInputError: if it has more than `MOST_PIECES`.
        """
        if len(self.sizes) > MOST_PIECES:
            raise InvalidInputError(
                f"map: got {self.owner.shape} cells that need {len(self.sizes)} convex pieces, "
                f"expected at most {MOST_PIECES}: use a coarser resolution, such as every second "
                "row and column, or remove what is no wall"
            )
        return self

    def after(self, cells: Mask, window: Window) -> Self:
        """Return the cover of `cells`, which differ from those covered here in a window alone.

        Pieces that come within a cell of the window are made anew, the others stay.

        Args:
            cells: (rows, columns) as they are now.
            window: first row, first column, and the row and column after the last.

        Raises:
            InvalidInputError: if it needs more than `MOST_PIECES`.
        """
        low_row, low_column, high_row, high_column = window
        inner = np.arange(self.corners.shape[1]) < self.sizes[:, None]
        far = np.iinfo(np.int64).max
        low = np.where(inner[..., None], self.corners, far).min(axis=1)
        high = np.where(inner[..., None], self.corners, -far).max(axis=1)
        near = (low <= (high_column + 1, high_row + 1)).all(axis=1)
        near &= (high >= (low_column - 1, low_row - 1)).all(axis=1)
        number = np.where(near, -1, np.cumsum(~near) - 1).astype(np.int32)
        bounds = np.vstack([low[near], high[near], [window[1::-1]], [window[:1:-1]]])
        (c0, r0), (c1, r1) = bounds.min(axis=0).tolist(), bounds.max(axis=0).tolist()
        owner = np.append(number, np.int32(-1))[self.owner]  # −1 reads the last entry
        corners, count = _cover(cells, r0, c0, r1, c1, owner, int((~near).sum()))
        return type(self)(
            np.concatenate([self.corners[~near], corners]),
            np.concatenate([self.sizes[~near], count]),
            owner,
        )._checked()

    def grown(self) -> Array:
        """Return (P, 8, 2) the corners, `GROWTH` farther out in column and row.

        The four outermost edges of a piece follow the grid, so that each corner is the outermost
        one in one quadrant, and the grown piece is the piece plus a square.
        """
        corners = self.corners.astype(np.float64)
        _grow(corners, self.sizes)
        return corners


def boxes(cells: Mask) -> Array:
    """Return (R, 4, 2) the corners, column and row, of rectangles that are just the true cells."""
    owner = np.full(cells.shape, -1, dtype=np.int32)
    rows, columns = cells.shape
    found = _rectangles(cells, 0, 0, rows, columns, owner, 0)
    return found[:, [[1, 0], [3, 0], [3, 2], [1, 2]]].astype(np.float64)


@kernel()
def _cover(
    cells: Mask, r0: int, c0: int, r1: int, c1: int, owner: Places, first: int
) -> tuple[Integers, Integers]:
    """Cover the true cells of a window that no piece owns, and note who owns them.

    Args:
        cells: (rows, columns).
        r0: first row of the window.
        c0: first column.
        r1: row after the last.
        c1: column after the last.
        owner: (rows, columns) −1 where a cell is nobody's, written to.
        first: number of the first new piece.

    Returns:
        Corners (P, 8, 2) and counts (P,) of the new pieces.
    """
    for r in range(r0, r1):
        for c in range(c0, c1):
            if not cells[r, c]:
                owner[r, c] = -1
    boxes = _rectangles(cells, r0, c0, r1, c1, owner, first)
    strangers = _strangers(cells, r0, c0, r1, c1)
    piece_of = np.full(len(boxes), -1, dtype=np.int32)
    corners, count = _merge(boxes, strangers, r0, c0, owner, first, piece_of)
    for r in range(r0, r1):
        for c in range(c0, c1):
            if owner[r, c] >= first:
                owner[r, c] = first + piece_of[owner[r, c] - first]
    return corners, count


@kernel()
def _rectangles(
    cells: Mask, r0: int, c0: int, r1: int, c1: int, owner: Places, first: int
) -> Integers:
    """Return (R, 4) boxes of cells: low row, low column, and the row and column after the last.

    The wider or the higher of two rectangles is taken at each cell that is nobody's: as far right
    as there are cells and then up, or as far up and then right.
    """
    height, width = r1 - r0, c1 - c0
    right = np.zeros((height + 1, width + 1), dtype=np.int32)  # cells in a row from here on
    up = np.zeros((height + 1, width + 1), dtype=np.int32)
    for r in range(height - 1, -1, -1):
        for c in range(width - 1, -1, -1):
            if cells[r0 + r, c0 + c]:
                right[r, c] = right[r, c + 1] + 1
                up[r, c] = up[r + 1, c] + 1
    boxes = np.empty((64, 4), dtype=np.int64)
    total = 0
    for r in range(height):
        for c in range(width):
            if right[r, c] == 0 or owner[r0 + r, c0 + c] >= 0:
                continue
            wide, high = right[r, c], np.int32(1)
            while right[r + high, c] >= wide:
                high += 1
            tall, broad = up[r, c], np.int32(1)
            while up[r, c + broad] >= tall:
                broad += 1
            if tall * broad > wide * high:
                wide, high = broad, tall
            for i in range(r0 + r, r0 + r + high):
                for j in range(c0 + c, c0 + c + wide):
                    if owner[i, j] < 0:
                        owner[i, j] = first + total
            if total == len(boxes):
                more = np.empty((2 * total, 4), dtype=np.int64)
                more[:total] = boxes
                boxes = more
            boxes[total, 0], boxes[total, 1] = r0 + r, c0 + c
            boxes[total, 2], boxes[total, 3] = r0 + r + high, c0 + c + wide
            total += 1
    return boxes[:total]


@kernel()
def _strangers(cells: Mask, r0: int, c0: int, r1: int, c1: int) -> Places:
    """Return (h, w + 1) how many cells left of here in their row share no edge with a true one."""
    rows, columns = cells.shape
    counted = np.zeros((r1 - r0, c1 - c0 + 1), dtype=np.int32)
    for r in range(r0, r1):
        for c in range(c0, c1):
            near = cells[r, c]
            near = near or (r > 0 and cells[r - 1, c]) or (r + 1 < rows and cells[r + 1, c])
            near = near or (c > 0 and cells[r, c - 1]) or (c + 1 < columns and cells[r, c + 1])
            counted[r - r0, c - c0 + 1] = counted[r - r0, c - c0] + (0 if near else 1)
    return counted


@kernel()
def _merge(
    boxes: Integers,
    strangers: Places,
    r0: int,
    c0: int,
    owner: Places,
    first: int,
    piece_of: Places,
) -> tuple[Integers, Integers]:
    """Merge touching boxes for as long as their hull meets no stranger; write who went where."""
    rows, columns = owner.shape
    left = max(LEAST_WORK, WORK * strangers.size)
    extents = np.empty((len(strangers), 2), dtype=np.int64)
    total = len(boxes)
    tried = np.full(total, -1, dtype=np.int32)
    waiting = np.empty(total, dtype=np.int64)
    corners = np.zeros((total, MOST_CORNERS, 2), dtype=np.int64)
    count = np.zeros(total, dtype=np.int64)
    points = np.empty((MOST_CORNERS + 4, 2), dtype=np.int64)
    hull = np.empty((2 * (MOST_CORNERS + 4), 2), dtype=np.int64)
    pieces = 0
    for seed in range(total):
        if piece_of[seed] >= 0:
            continue
        _box_corners(boxes[seed], corners[pieces], 0)
        count[pieces] = 4
        piece_of[seed] = pieces
        waiting[0] = seed
        begin, end = 0, 1
        while begin < end:
            a, b, c, d = boxes[waiting[begin]]
            begin += 1
            for r in range(max(a - 1, 0), min(c + 1, rows)):
                on_side = a <= r < c
                j = max(b - 1, 0)
                while j < min(d + 1, columns):
                    other = owner[r, j] - first
                    j = d if on_side and b <= j < d else j + 1
                    if other < 0 or piece_of[other] >= 0 or tried[other] == pieces:
                        continue
                    tried[other] = pieces
                    n = count[pieces]
                    points[:n] = corners[pieces, :n]
                    _box_corners(boxes[other], points, n)
                    size = _hull(points[: n + 4], hull)
                    if size > MOST_CORNERS:
                        continue
                    if size != n or (hull[:size] != corners[pieces, :n]).any():
                        left -= hull[:size, 1].max() - hull[:size, 1].min()
                        if left < 0 or _meets(hull[:size], strangers, r0, c0, extents):
                            continue
                        corners[pieces, :size] = hull[:size]
                        corners[pieces, size:] = 0
                        count[pieces] = size
                    piece_of[other] = pieces
                    waiting[end] = other
                    end += 1
        pieces += 1
    return corners[:pieces].copy(), count[:pieces].copy()


@kernel()
def _box_corners(box: Integers, out: Integers, at: int) -> None:
    """Write the corners (column, row) of a box, counter-clockwise, from out[at] on."""
    low_row, low_column, high_row, high_column = box
    out[at, 0], out[at, 1] = low_column, low_row
    out[at + 1, 0], out[at + 1, 1] = high_column, low_row
    out[at + 2, 0], out[at + 2, 1] = high_column, high_row
    out[at + 3, 0], out[at + 3, 1] = low_column, high_row


@kernel()
def _hull(points: Integers, out: Integers) -> int:
    """Write the convex hull of points (n, 2), strictly convex, counter-clockwise; return its size.

    Source: A. M. Andrew's monotone chain, in integers.
    """
    n = len(points)
    for i in range(1, n):  # few points: sorted by insertion
        x, y = points[i]
        j = i - 1
        while j >= 0 and (points[j, 0] > x or (points[j, 0] == x and points[j, 1] > y)):
            points[j + 1] = points[j]
            j -= 1
        points[j + 1, 0], points[j + 1, 1] = x, y
    size = 0
    for half in range(2):
        floor = size + 1 if half == 0 else size
        for step in range(n):
            x, y = points[step if half == 0 else n - 1 - step]
            while size > floor and _turn(out[size - 2], out[size - 1], x, y) <= 0:
                size -= 1
            if half == 1 and step == 0:
                continue  # the last point stands there already
            out[size, 0], out[size, 1] = x, y
            size += 1
    return size - 1


@kernel()
def _turn(a: Integers, b: Integers, x: int, y: int) -> int:
    """Return twice the area of the triangle a, b, (x, y), positive where it turns left."""
    return (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])


@kernel()
def _meets(hull: Integers, strangers: Places, r0: int, c0: int, extents: Integers) -> bool:
    """Return whether a hull meets the inside of a stranger, row by row.

    Corners lie on crossings, so that a row's outermost points are those on its lower or upper line.
    Edges that rise bound rows on the right, those that fall on the left.

    Args:
        hull: (k, 2) corners, counter-clockwise.
        strangers: as `_strangers` returns them.
        r0: row of the first.
        c0: column of the first.
        extents: (h, 2) room for the first and the last column of each row.
    """
    for i in range(len(hull)):
        x, y = hull[i - 1]
        end_x, end_y = hull[i]
        if y == end_y:
            continue
        rises = y < end_y
        if not rises:
            x, y, end_x, end_y = end_x, end_y, x, y
        sign = -1 if rises else 1  # rounded down on the left, up on the right
        high = end_y - y
        steps, more = sign * (end_x - x) // high, sign * (end_x - x) % high
        at, over = sign * x, 0
        for row in range(y - r0, end_y - r0):
            here = at
            at, over = at + steps, over + more
            if over >= high:
                at, over = at + 1, over - high
            extents[row, int(rises)] = sign * min(here, at)
    low, high = hull[:, 1].min() - r0, hull[:, 1].max() - r0
    for row in range(low, high):
        first, last = extents[row, 0] - c0, extents[row, 1] - c0
        if strangers[row, last] != strangers[row, first]:
            return True
    return False


@kernel()
def _grow(corners: Array, count: Integers) -> None:
    """Move each corner (P, 8, 2) outwards; see `Cover.grown`."""
    for p in range(len(count)):
        n = count[p]
        piece = corners[p, :n].copy()
        for i in range(n):
            before, after = piece[i - 1], piece[(i + 1) % n]
            here = piece[i]
            in_x, in_y = here[0] - before[0], here[1] - before[1]
            out_x, out_y = after[0] - here[0], after[1] - here[1]
            a, b = np.hypot(in_x, in_y), np.hypot(out_x, out_y)
            corners[p, i, 0] += GROWTH * np.sign(in_y / a + out_y / b)
            corners[p, i, 1] -= GROWTH * np.sign(in_x / a + out_x / b)
