"""The true distance from the cells of a map: the union of their closed squares, nothing covered."""

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.compilation import kernel
from hcbf_gym.maps import Grid


def distances(grid: Grid, cells: Mask, points: Array, reach: float) -> Array:
    """Return (N,) the distance of points (N, 2) from the true cells [m], `reach` where it is more.

    Args:
        grid: where the cells lie.
        cells: (rows, columns).
        points: [m].
        reach: how far to look [m].
    """
    at = grid.to_cells(points)
    return grid.resolution * _distances(cells, at, reach / grid.resolution)


@kernel()
def _distances(cells: Mask, at: Array, reach: float) -> Array:
    """Return (N,) distances of fractional columns and rows (N, 2), all in cells."""
    rows, columns = cells.shape
    out = np.empty(len(at))
    for i in range(len(at)):
        x, y = at[i]
        least = reach * reach
        for r in range(max(int(np.floor(y - reach)), 0), min(int(y + reach) + 1, rows)):
            dy = max(r - y, y - (r + 1), 0.0)
            for c in range(max(int(np.floor(x - reach)), 0), min(int(x + reach) + 1, columns)):
                if cells[r, c]:
                    dx = max(c - x, x - (c + 1), 0.0)
                    least = min(least, dx * dx + dy * dy)
        out[i] = np.sqrt(least)
    return out
