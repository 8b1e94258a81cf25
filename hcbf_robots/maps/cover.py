"""Covers cells by few convex pieces: greedy rectangles, merged where their hull stays near them.

A piece is the convex hull of some rectangles of cells. It has at most eight corners, all on the
grid's crossings. It meets only occupied cells and those that share an edge with one. So no occupied
cell is lost, and a gap narrows by at most one cell from each side.

A merge is tested row by row. All merges together may test at most a hundred rows for each cell, so
that the cost grows with the cells alone. Rooms need a few rows for each cell. Where a raster needs
more, the remaining rectangles are not merged. They are more pieces that cover the same cells.
"""

from typing import NamedTuple, Self

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers, Mask, Places
from hcbf_gym.errors import InvalidInputError

MOST_PIECES = 500_000  # a raster that needs more is noise, not walls

Window = tuple[int, int, int, int]
"""The first row and column of a window, and the row and column after its last."""


class Cover(NamedTuple):
    """The convex pieces that cover a class of cells."""

    # (P, 8, 2) column and row of each piece's corners, counter-clockwise; unused ones are 0
    corners: Integers
    sizes: Integers  # (P,) number of each piece's corners
    owner: Places  # (rows, columns) index of the piece that covers a cell, −1 for none

    @classmethod
    def of(cls, cells: Mask) -> Self:
        """Return the cover of all true cells (rows, columns), of `MOST_PIECES` at most."""
        owner = np.full(cells.shape, -1, dtype=np.int32)
        all_cells = (0, 0, *cells.shape)
        corners, sizes = _core.cover_cells(cells, all_cells, owner, 0)  # writes the owners, too
        return cls(corners, sizes, owner)._checked()

    def _checked(self) -> Self:
        """Return this cover, or raise InvalidInputError if it has too many pieces."""
        if len(self.sizes) > MOST_PIECES:
            raise InvalidInputError(
                f"map: got {self.owner.shape} cells that need {len(self.sizes)} convex pieces, "
                f"expected at most {MOST_PIECES}: use a coarser resolution, such as every second "
                "row and column, or remove cells that are not walls"
            )
        return self

    def after(self, cells: Mask, window: Window) -> Self:
        """Return the cover of cells (rows, columns) that differ from the covered ones in a window.

        Pieces within a cell of the window are computed anew, the others stay.
        """
        first_row, first_column, last_row, last_column = window
        is_corner = np.arange(self.corners.shape[1]) < self.sizes[:, None]
        far = np.iinfo(np.int64).max
        low = np.where(is_corner[..., None], self.corners, far).min(axis=1)
        high = np.where(is_corner[..., None], self.corners, -far).max(axis=1)
        near = (low <= (last_column + 1, last_row + 1)).all(axis=1)
        near &= (high >= (first_column - 1, first_row - 1)).all(axis=1)
        window_corners = [(first_column, first_row), (last_column, last_row)]
        bounds = np.vstack([low[near], high[near], window_corners])
        column, row = bounds.min(axis=0).tolist()
        end_column, end_row = bounds.max(axis=0).tolist()
        new_index = np.where(near, -1, np.cumsum(~near) - 1).astype(np.int32)
        owner = np.append(new_index, np.int32(-1))[self.owner]  # index −1 reads the appended −1
        kept_corners, kept_sizes = self.corners[~near], self.sizes[~near]
        changed = (row, column, end_row, end_column)
        new_corners, new_sizes = _core.cover_cells(cells, changed, owner, len(kept_sizes))
        corners = np.concatenate([kept_corners, new_corners])
        sizes = np.concatenate([kept_sizes, new_sizes])
        return type(self)(corners, sizes, owner)._checked()

    def grown(self) -> Array:
        """Return the corners (P, 8, 2), moved outwards by 1e-6 in column and row.

        The four outermost edges of a piece are parallel to the grid. So each corner is the
        outermost one of a quadrant, and the grown piece is the piece plus a square.
        """
        corners = self.corners.astype(np.float64)
        _core.cover_grow(corners, self.sizes)
        return corners


def boxes(cells: Mask) -> Array:
    """Return the corners (R, 4, 2), column and row, of rectangles that are just the true cells."""
    return _core.cover_boxes(cells).astype(np.float64)
