"""Cells of one grid on another: a mask of another size, resolution or origin than the map's."""

import math

import numpy as np

from hcbf_gym.arrays import Integers, Mask
from hcbf_gym.models.grid import Grid

INSET = 1e-3  # share of a cell by which two must overlap, so that rounding makes no neighbours
MOST_POINTS = 2_000_000  # places that are looked up at once


def onto(grid: Grid, cells: Mask, of: Grid) -> tuple[Mask, bool]:
    """Return the cells of a grid that those of another one meet, and whether some lie outside.

    As in Nav2 a cell counts whose centre lies in one of the others; so does each cell that one of
    them reaches into, as what is strict may not be entered anywhere.
    """
    if grid == of:
        return cells, False
    found = _whose_centres_lie_in(grid, cells, of)
    outside = False
    half = (0.5 - INSET) * of.resolution / grid.resolution
    turn = of.origin[2] - grid.origin[2]
    cos, sin = math.cos(turn), math.sin(turn)
    spread = abs(cos) + abs(sin)
    around = np.arange(-math.ceil(0.5 + half * spread), math.ceil(0.5 + half * spread) + 1)
    near = np.stack(np.meshgrid(around, around), axis=-1).reshape(-1, 2)
    places = np.argwhere(cells)[:, ::-1]
    chunk = max(1, MOST_POINTS // len(near))
    for first in range(0, len(places), chunk):
        middles = grid.to_cells(of.to_world(places[first : first + chunk] + 0.5))
        met = np.floor(middles).astype(np.int64)[:, None] + near
        apart = met + 0.5 - middles[:, None]  # two squares meet unless one of four axes parts them
        turned = apart @ np.array([[cos, -sin], [sin, cos]])
        meets = (np.abs(apart) < 0.5 + half * spread).all(axis=-1)
        meets &= (np.abs(turned) < half + 0.5 * spread).all(axis=-1)
        column, row = met[meets].T
        inside = _are_in(grid, column, row)
        found[row[inside], column[inside]] = True
        outside |= not inside.all()
    return found, outside


def _whose_centres_lie_in(grid: Grid, cells: Mask, of: Grid) -> Mask:
    """Return (rows, columns) whose centres lie in cells of another grid."""
    rows, columns = grid.shape
    found = np.zeros(grid.shape, dtype=np.bool_)
    chunk = max(1, MOST_POINTS // columns)
    for first in range(0, rows, chunk):
        centres = np.mgrid[first : min(rows, first + chunk), 0:columns] + 0.5
        points = grid.to_world(centres[::-1].reshape(2, -1).T)
        column, row = np.floor(of.to_cells(points)).astype(np.int64).T
        inside = _are_in(of, column, row)
        seen = np.zeros(len(column), dtype=np.bool_)
        seen[inside] = cells[row[inside], column[inside]]
        found[first : first + chunk] = seen.reshape(-1, columns)
    return found


def _are_in(grid: Grid, column: Integers, row: Integers) -> Mask:
    """Return whether columns and rows (N,) are those of a grid."""
    rows, columns = grid.shape
    return (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
