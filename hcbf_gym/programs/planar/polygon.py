"""Convex polygons as lists of corners: cut by a line, and searched for a minimum.

A polygon is an array (capacity, 2) of which the first `count` corners count, counter-clockwise;
two corners are a segment, one is a point. It never becomes empty: a cut that would leave nothing
leaves the face that violates the cut least, so that no rounding can make a stage infeasible.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel
from hcbf_gym.programs.planar.records import COPY, Line, Point, Workspace
from hcbf_gym.programs.tolerances import RANK_ONE, SAME_CORNER, THIN, ZERO_GRADIENT


class LeastSquares(NamedTuple):
    """``‖R u − z‖²`` with R = [[r11, r12], [0, r22]]."""

    r11: float
    r12: float
    r22: float
    z1: float
    z2: float


@kernel(error_model="numpy")
def span(corners: Array, count: int, nx: float, ny: float) -> tuple[float, float]:
    """Return the least and the greatest n·u on a polygon."""
    low = np.inf
    high = -np.inf
    for i in range(count):
        value = nx * corners[i, 0] + ny * corners[i, 1]
        low, high = min(low, value), max(high, value)
    return low, high


@kernel(error_model="numpy")
def cut(corners: Array, count: int, line: Line, radius: float) -> int:
    """Cut a polygon in place to ``n·u ≥ d``; to its face of greatest n·u where that is empty.

    Args:
        corners: (2 capacity, 2) the polygon, and room for as many corners behind them.
        count: its number of corners, at least 1.
        line: where to cut, and the side to keep.
        radius: the largest norm of an input.

    Returns:
        The new number of corners.
    """
    nx, ny, d = line
    thin = THIN * radius
    same = SAME_CORNER * radius
    scratch = corners[corners.shape[0] // 2 :]
    lowest, highest = span(corners, count, nx, ny)
    if lowest >= d:
        return count
    if highest <= d + thin:  # compared before d is subtracted, which may be huge
        return _face(corners, count, nx, ny, highest - thin, same)
    new = 0
    previous_x, previous_y = corners[count - 1, 0], corners[count - 1, 1]
    previous = nx * previous_x + ny * previous_y - d
    for i in range(count):
        x, y = corners[i, 0], corners[i, 1]
        height = nx * x + ny * y - d
        if (height >= 0.0) != (previous >= 0.0):
            t = previous / (previous - height)
            crossing_x = previous_x + t * (x - previous_x)
            crossing_y = previous_y + t * (y - previous_y)
            new = _append(scratch, new, crossing_x, crossing_y, same)
        if height >= 0.0:
            new = _append(scratch, new, x, y, same)
        previous_x, previous_y, previous = x, y, height
    while new > 1 and _near(scratch, 0, scratch[new - 1, 0], scratch[new - 1, 1], same):
        new -= 1
    copy(scratch, new, corners)
    return new


@kernel(error_model="numpy")
def copy(corners: Array, count: int, to: Array) -> None:
    """Copy a polygon's corners; in Numba a loop is faster than slices."""
    for i in range(count):
        to[i, 0], to[i, 1] = corners[i, 0], corners[i, 1]


@kernel(error_model="numpy")
def slice_at(corners: Array, count: int, line: Line, radius: float) -> int:
    """Cut a polygon in place to ``n·u = d``, a value that it attains; return the new count."""
    count = cut(corners, count, line, radius)
    return cut(corners, count, Line(-line.nx, -line.ny, -line.d), radius)


@kernel(error_model="numpy")
def _near(corners: Array, i: int, x: float, y: float, distance: float) -> bool:
    return abs(corners[i, 0] - x) <= distance and abs(corners[i, 1] - y) <= distance


@kernel(error_model="numpy")
def _append(corners: Array, count: int, x: float, y: float, distance: float) -> int:
    if count > 0 and _near(corners, count - 1, x, y, distance):
        return count
    corners[count, 0], corners[count, 1] = x, y
    return count + 1


@kernel(error_model="numpy")
def _face(corners: Array, count: int, nx: float, ny: float, level: float, same: float) -> int:
    """Keep, of the corners with n·u ≥ level, the two that lie farthest apart."""
    low = np.inf
    high = -np.inf
    low_x = low_y = high_x = high_y = 0.0
    for i in range(count):
        x, y = corners[i, 0], corners[i, 1]
        if nx * x + ny * y >= level:
            along = nx * y - ny * x
            if along < low:
                low, low_x, low_y = along, x, y
            if along > high:
                high, high_x, high_y = along, x, y
    corners[0, 0], corners[0, 1] = low_x, low_y
    if high - low <= same:
        return 1
    corners[1, 0], corners[1, 1] = high_x, high_y
    return 2


@kernel(error_model="numpy")
def distance(weight: float, ux: float, uy: float) -> LeastSquares:
    """Return ``w ‖u − u*‖²``."""
    root = np.sqrt(weight)
    return LeastSquares(root, 0.0, root, root * ux, root * uy)


@kernel(error_model="numpy")
def add_row(problem: LeastSquares, ax: float, ay: float, t: float) -> LeastSquares:
    """Add ``(a·u − t)²`` to ``‖R u − z‖²`` by two Givens rotations: no square is formed."""
    r11, r12, r22, z1, z2 = problem
    if ax != 0.0:
        length = np.hypot(r11, ax)
        c, s = r11 / length, ax / length
        r11 = length
        r12, ay = c * r12 + s * ay, c * ay - s * r12
        z1, t = c * z1 + s * t, c * t - s * z1
    if ay != 0.0:
        length = np.hypot(r22, ay)
        c, s = r22 / length, ay / length
        r22 = length
        z2 = c * z2 + s * t
    return LeastSquares(r11, r12, r22, z1, z2)


@kernel(error_model="numpy")
def nearest(corners: Array, count: int, ux: float, uy: float) -> Point:
    """Return the point of a polygon that is nearest to u*."""
    return _descend(corners, count, distance(1.0, ux, uy), ux, uy)


@kernel(error_model="numpy")
def minimise(
    corners: Array, count: int, problem: LeastSquares, ux: float, uy: float, w: Workspace
) -> Point:
    """Return the point of a polygon that minimises ``‖R u − z‖²``; of several, the nearest to u*.

    Args:
        corners: (capacity, 2) the polygon, left as it is.
        count: its number of corners.
        problem: R and z.
        ux: x component of u*.
        uy: y component of u*.
        w: the working space; `COPY` is written to.
    """
    r11, r12, r22, z1, z2 = problem
    size = np.sqrt(r11 * r11 + r12 * r12 + r22 * r22)
    if size <= ZERO_GRADIENT:
        return nearest(corners, count, ux, uy)
    if abs(r11 * r22) > RANK_ONE * size * size:
        y = z2 / r22
        return _descend(corners, count, problem, (z1 - r12 * y) / r11, y)
    # R = σ p nᵀ: n·u is decided, and u* decides the rest
    angle = 0.5 * np.arctan2(2.0 * r11 * r12, r11 * r11 - r12 * r12 - r22 * r22)
    nx, ny = np.cos(angle), np.sin(angle)
    p1 = r11 * nx + r12 * ny
    p2 = r22 * ny
    low, high = span(corners, count, nx, ny)
    target = min(max((p1 * z1 + p2 * z2) / (p1 * p1 + p2 * p2), low), high)
    chord = w.polygons[COPY]
    copy(corners, count, chord)
    count = slice_at(chord, count, Line(nx, ny, target), w.radius)
    return nearest(chord, count, ux, uy)


@kernel(error_model="numpy")
def contains(corners: Array, count: int, x: float, y: float) -> bool:
    """Return whether a point lies in a polygon of three corners or more, without any tolerance."""
    previous_x, previous_y = corners[count - 1, 0], corners[count - 1, 1]
    for i in range(count):
        corner_x, corner_y = corners[i, 0], corners[i, 1]
        across = (corner_x - previous_x) * (y - previous_y)
        if across < (corner_y - previous_y) * (x - previous_x):
            return False
        previous_x, previous_y = corner_x, corner_y
    return True


@kernel(error_model="numpy")
def _descend(corners: Array, count: int, problem: LeastSquares, cx: float, cy: float) -> Point:
    """Return the minimiser over a polygon of a problem of full rank with its centre at c.

    The point is chosen by the signs of the gradient, not by comparing costs, whose differences
    drown in rounding where the weights are large.
    """
    r11, r12, r22, z1, z2 = problem
    if count == 1:
        return corners[0, 0], corners[0, 1]
    if count > 2 and contains(corners, count, cx, cy):
        return cx, cy
    best = np.inf
    best_x = corners[0, 0]
    best_y = corners[0, 1]
    last = count - 1
    dx, dy = corners[0, 0] - corners[last, 0], corners[0, 1] - corners[last, 1]
    e1 = r11 * corners[0, 0] + r12 * corners[0, 1] - z1
    e2 = r22 * corners[0, 1] - z2
    arriving = (r11 * dx + r12 * dy) * e1 + r22 * dy * e2
    for i in range(count):
        x, y = corners[i, 0], corners[i, 1]
        j = i + 1 if i + 1 < count else 0
        dx, dy = corners[j, 0] - x, corners[j, 1] - y
        d1 = r11 * dx + r12 * dy
        d2 = r22 * dy
        e1 = r11 * x + r12 * y - z1
        e2 = r22 * y - z2
        leaving = d1 * e1 + d2 * e2
        if leaving >= 0.0 and arriving <= 0.0:
            return x, y
        t = -leaving / (d1 * d1 + d2 * d2)
        arriving = leaving + d1 * d1 + d2 * d2
        if 0.0 < t < 1.0:
            px, py = x + t * dx, y + t * dy
            g1 = r11 * px + r12 * py - z1
            g2 = r22 * py - z2
            inward = -dy * (r11 * g1) + dx * (r12 * g1 + r22 * g2)
            if inward >= 0.0 or count == 2:
                return px, py
            x, y, e1, e2 = px, py, g1, g2
        cost = e1 * e1 + e2 * e2
        if cost < best:
            best, best_x, best_y = cost, x, y
    return best_x, best_y
