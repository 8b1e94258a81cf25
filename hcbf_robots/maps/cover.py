r"""Cells covered by few convex pieces: greedy rectangles, merged where their hull stays near them.

A piece is the convex hull of some rectangles of cells. It has at most eight corners, all on the
grid's crossings, and holds no point that lies more than one cell from an occupied square: it meets
no cell but occupied ones and those that share an edge with one. So a cell that is covered is never
lost, and a gap narrows by at most one cell from each side.

A merge is looked at row by row. All merges together may look at no more than a hundred rows for
each cell, so that the cost grows with the cells and with nothing else. Rooms need a few rows for
each cell. Where a raster needs more, what is left stays in more pieces, which cover the same cells.
"""

from typing import NamedTuple, Self

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers, Mask, Places
from hcbf_gym.errors import InvalidInputError

MOST_PIECES = 500_000  # of a cover: a raster that needs more shows no walls

Window = tuple[int, int, int, int]


class Cover(NamedTuple):
    """The convex pieces that cover a class of cells."""

    # (P, 8, 2) column and row of each piece's corners, counter-clockwise; the rest 0
    corners: Integers
    sizes: Integers  # (P,) how many there are
    owner: Places  # (rows, columns) which piece answers for a cell, −1 for none

    @classmethod
    def of(cls, cells: Mask) -> Self:
        """Return the cover of all true cells (rows, columns), of `MOST_PIECES` at most."""
        owner = np.full(cells.shape, -1, dtype=np.int32)
        whole = (0, 0, cells.shape[0], cells.shape[1])
        return cls(*_core.cover_cells(cells, whole, owner, 0), owner)._checked()

    def _checked(self) -> Self:
        """Return the cover."""
        if len(self.sizes) > MOST_PIECES:
            raise InvalidInputError(
                f"map: got {self.owner.shape} cells that need {len(self.sizes)} convex pieces, "
                f"expected at most {MOST_PIECES}: use a coarser resolution, such as every second "
                "row and column, or remove cells that are not walls"
            )
        return self

    def after(self, cells: Mask, window: Window) -> Self:
        """Return the cover of `cells`, which differ from those covered here in a window alone.

        Pieces that come within a cell of the window are made anew, the others stay. The window is
        its first row and column, and the row and column after its last.
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
        corners, count = _core.cover_cells(cells, (r0, c0, r1, c1), owner, int((~near).sum()))
        return type(self)(
            np.concatenate([self.corners[~near], corners]),
            np.concatenate([self.sizes[~near], count]),
            owner,
        )._checked()

    def grown(self) -> Array:
        """Return (P, 8, 2) the corners, 1e-6 farther out in column and row.

        The four outermost edges of a piece follow the grid, so that each corner is the outermost
        one in one quadrant, and the grown piece is the piece plus a square.
        """
        corners = self.corners.astype(np.float64)
        _core.cover_grow(corners, self.sizes)
        return corners


def boxes(cells: Mask) -> Array:
    """Return (R, 4, 2) the corners, column and row, of rectangles that are just the true cells."""
    return _core.cover_boxes(cells).astype(np.float64)
