"""Transfers cells between grids: from a mask to a map of another size, resolution or origin."""

import math

import numpy as np

from hcbf_gym.arrays import Integers, Mask
from hcbf_gym.models.grid import Grid

INSET = 1e-3  # share of a cell by which two cells must overlap, so that rounding adds no neighbours
MOST_POINTS = 2_000_000  # that are transformed at once, to bound the memory


def onto(grid: Grid, cells: Mask, source: Grid) -> tuple[Mask, bool]:
    """Return the cells of a grid that cells of another grid meet, and whether some are outside it.

    As in Nav2 a cell is met whose centre is in one of `cells`, which are of the grid `source`. So
    is every cell that one of them overlaps, because no part of a strict cell may be entered.
    """
    if grid == source:
        return cells, False
    met = _centres_in(grid, cells, source)
    is_outside = False
    angle = source.origin[2] - grid.origin[2]
    cos, sin = math.cos(angle), math.sin(angle)
    turned_width = abs(cos) + abs(sin)  # of a unit square along the axes of the other grid
    half = (0.5 - INSET) * source.resolution / grid.resolution  # of an occupied cell's side
    reach = math.ceil(0.5 + half * turned_width)
    offsets = np.arange(-reach, reach + 1)
    neighbours = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    occupied = np.argwhere(cells)[:, ::-1]
    chunk = max(1, MOST_POINTS // len(neighbours))
    for start in range(0, len(occupied), chunk):
        centres = grid.to_cells(source.to_world(occupied[start : start + chunk] + 0.5))
        candidates = np.floor(centres).astype(np.int64)[:, None] + neighbours
        # two squares overlap unless one of the four axes of their sides separates them
        distance = candidates + 0.5 - centres[:, None]
        turned_distance = distance @ np.array([[cos, -sin], [sin, cos]])
        overlaps = (np.abs(distance) < 0.5 + half * turned_width).all(axis=-1)
        overlaps &= (np.abs(turned_distance) < half + 0.5 * turned_width).all(axis=-1)
        column, row = candidates[overlaps].T
        inside = _are_in(grid, column, row)
        met[row[inside], column[inside]] = True
        is_outside |= not inside.all()
    return met, is_outside


def _centres_in(grid: Grid, cells: Mask, source: Grid) -> Mask:
    """Return the cells (rows, columns) of a grid whose centres are in occupied cells of another."""
    rows, columns = grid.shape
    met = np.zeros(grid.shape, dtype=np.bool_)
    chunk = max(1, MOST_POINTS // columns)
    for start in range(0, rows, chunk):
        centres = np.mgrid[start : min(rows, start + chunk), 0:columns] + 0.5
        points = grid.to_world(centres[::-1].reshape(2, -1).T)
        column, row = np.floor(source.to_cells(points)).astype(np.int64).T
        inside = _are_in(source, column, row)
        is_met = np.zeros(len(column), dtype=np.bool_)
        is_met[inside] = cells[row[inside], column[inside]]
        met[start : start + chunk] = is_met.reshape(-1, columns)
    return met


def _are_in(grid: Grid, column: Integers, row: Integers) -> Mask:
    """Return (n,) whether cells at these columns and rows (n,) are in the grid."""
    rows, columns = grid.shape
    return (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
