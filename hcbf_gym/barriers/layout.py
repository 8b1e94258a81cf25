"""Where each number of a barrier stands in the arrays that the compiled kernels read.

A barrier is a kind, one of the integers below, and a block of `WIDTH` numbers. The functions here
write a block and return its kind; the constants name its columns for those who read it. No other
module knows a column by its number.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Pair = tuple[float, float]

HALF_PLANE, DISC, ELLIPSE, CONVEX_POLYGON, SPEED_LIMIT, CUSTOM = range(6)
"""The kinds; CUSTOM stands for a user's own barrier, which Python evaluates."""

MAX_VERTICES = 8
"""Most corners of a polygon."""
LOWEST_RANK = 64
"""The largest number that a priority may be: compiled code has room for so many levels."""

VELOCITY_X, VELOCITY_Y = 0, 1  # of the barrier's frame [m/s], every planar kind
NORMAL_X, NORMAL_Y, OFFSET = 2, 3, 4  # half-plane
CENTER_X, CENTER_Y = 2, 3  # disc and ellipse [m]
RADIUS = 4  # disc [m]
MAP_XX, MAP_XY, MAP_YX, MAP_YY = 4, 5, 6, 7  # ellipse: its axes as unit circle, row by row [1/m]
SHORTER_AXIS = 8  # ellipse [m]
VERTEX_COUNT, FIRST_VERTEX = 2, 3  # polygon: x and y of each corner from FIRST_VERTEX on [m]
V_MAX = 2  # speed limit [m/s]

WIDTH = FIRST_VERTEX + 2 * MAX_VERTICES


@njit(cache=True)
def vertex_count(c: Array) -> int:
    """Return how many corners a polygon's block has, within what it can hold."""
    count = c[VERTEX_COUNT]
    return int(count) if 1.0 <= count <= MAX_VERTICES else 1


@njit(cache=True)
def half_plane(c: Array, normal: Pair, offset: float) -> int:
    """Write ``h = n·p − offset`` into the block c (WIDTH,)."""
    c[:] = 0.0
    c[NORMAL_X], c[NORMAL_Y] = normal
    c[OFFSET] = offset
    return HALF_PLANE


@njit(cache=True)
def disc(c: Array, velocity: Pair, center: Pair, radius: float) -> int:
    """Write the outside of a disc into the block c (WIDTH,)."""
    c[:] = 0.0
    c[VELOCITY_X], c[VELOCITY_Y] = velocity
    c[CENTER_X], c[CENTER_Y] = center
    c[RADIUS] = radius
    return DISC


@njit(cache=True)
def ellipse(c: Array, velocity: Pair, center: Pair, semi_axes: Pair, angle: float) -> int:
    """Write the outside of an ellipse into the block c (WIDTH,)."""
    c[:] = 0.0
    c[VELOCITY_X], c[VELOCITY_Y] = velocity
    c[CENTER_X], c[CENTER_Y] = center
    first, second = semi_axes
    c[MAP_XX], c[MAP_XY] = np.cos(angle) / first, np.sin(angle) / first
    c[MAP_YX], c[MAP_YY] = -np.sin(angle) / second, np.cos(angle) / second
    c[SHORTER_AXIS] = min(first, second)
    return ELLIPSE


@njit(cache=True)
def convex_polygon(c: Array, velocity: Pair, vertices: Array) -> int:
    """Write the outside of a polygon with the corners (k, 2) into the block c (WIDTH,)."""
    c[:] = 0.0
    c[VELOCITY_X], c[VELOCITY_Y] = velocity
    c[VERTEX_COUNT] = vertices.shape[0]
    for i in range(vertices.shape[0]):
        c[FIRST_VERTEX + 2 * i] = vertices[i, 0]
        c[FIRST_VERTEX + 2 * i + 1] = vertices[i, 1]
    return CONVEX_POLYGON


@njit(cache=True)
def speed_limit(c: Array, v_max: float) -> int:
    """Write a cap on the speed into the block c (WIDTH,)."""
    c[:] = 0.0
    c[V_MAX] = v_max
    return SPEED_LIMIT
