"""The true distance from the cells of a map: the union of their closed squares, nothing covered."""

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_robots.maps import Grid

AT_ONCE = 8192
"""Points whose distances are taken together: their arrays stay in the processor's cache."""


def distances(grid: Grid, cells: Mask, points: Array, reach: float) -> Array:
    """Return (N,) the distance of points (N, 2) from the true cells [m], at most `reach`."""
    at = grid.to_cells(points)
    ends, starts = _beside(cells)
    blocks = np.array_split(at, 1 + len(at) // AT_ONCE)
    apart = [_distances(ends, starts, block, reach / grid.resolution) for block in blocks]
    return grid.resolution * np.concatenate(apart)


def _beside(cells: Mask) -> tuple[Array, Array]:
    """Return (rows, columns + 2) where the last true cell ends, and where the next one starts.

    A cell counts beside its own column. The two further columns are outside the map.
    """
    padded = np.pad(cells, ((0, 0), (1, 1)))
    column = np.arange(-1.0, padded.shape[1] - 1.0)
    ends, starts = np.where(padded, column + 1.0, -np.inf), np.where(padded, column, np.inf)
    return (
        np.maximum.accumulate(ends, axis=1),
        np.minimum.accumulate(starts[:, ::-1], axis=1)[:, ::-1],
    )


def _distances(ends: Array, starts: Array, at: Array, reach: float) -> Array:
    """Return (N,) distances of fractional columns and rows (N, 2), all in cells.

    In each row of the map either the last or the next true cell is the nearest.
    """
    rows, columns = ends.shape
    x, y = at.T.copy()
    c = np.clip(np.floor(x).astype(np.int64) + 1, 0, columns - 1)
    here = np.floor(y).astype(np.int64)
    least = np.full(len(at), reach * reach)
    for offset in range(-int(reach) - 1, int(reach) + 2):
        r = np.clip(here + offset, 0, rows - 1)
        dx = np.maximum(np.minimum(x - ends[r, c], starts[r, c] - x), 0.0)
        dy = np.maximum(np.maximum(r - y, y - (r + 1)), 0.0)
        least = np.minimum(least, dx * dx + dy * dy)
    return np.sqrt(least)
