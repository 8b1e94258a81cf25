"""The built-in barriers compiled: values and derivatives of N states at once.

Each function transcribes the class of the same name in `shapes`, which is the readable form and
the reference of the tests. Points and gradients travel as scalars, so that nothing is allocated
per state. A user's own barrier (`layout.CUSTOM`) is passed over: `BarrierSet` fills it in.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.barriers import layout
from hcbf_gym.barriers.layout import CONVEX_POLYGON, CUSTOM, DISC, ELLIPSE, HALF_PLANE, SPEED_LIMIT

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
PlanarJet = tuple[float, float, float, float, float, float]

TINY = 1e-9
"""Below this distance [m] from a region's centre its gradient is taken along +x."""


@njit(cache=True, error_model="numpy")
def _point_jet(x: float, y: float) -> PlanarJet:
    """Return ‖r‖ with its gradient, the distance ‖r‖ from the core, and the tangent."""
    distance = np.sqrt(x * x + y * y)
    if distance < TINY:
        return distance, 1.0, 0.0, np.inf, 0.0, 1.0
    nx, ny = x / distance, y / distance
    return distance, nx, ny, distance, -ny, nx


@njit(cache=True, error_model="numpy")
def _ellipse_jet(c: Array, x: float, y: float) -> PlanarJet:
    dx, dy, scale = x - c[layout.CENTER_X], y - c[layout.CENTER_Y], c[layout.SHORTER_AXIS]
    xx, xy = scale * c[layout.MAP_XX], scale * c[layout.MAP_XY]
    yx, yy = scale * c[layout.MAP_YX], scale * c[layout.MAP_YY]
    n, nx, ny, distance, tx, ty = _point_jet(xx * dx + xy * dy, yx * dx + yy * dy)
    return (
        n - scale,
        xx * nx + yx * ny,
        xy * nx + yy * ny,
        distance,
        xx * tx + yx * ty,
        xy * tx + yy * ty,
    )


@njit(cache=True, error_model="numpy")
def _polygon_jet(c: Array, x: float, y: float) -> PlanarJet:
    corners = layout.vertex_count(c)
    height, height_nx, height_ny = -np.inf, 0.0, 0.0
    nearest2, offset_x, offset_y = np.inf, 0.0, 0.0
    on_edge, edge_nx, edge_ny = False, 0.0, 0.0
    first = layout.FIRST_VERTEX
    for i in range(corners):
        j = i + 1 if i + 1 < corners else 0
        ax, ay = c[first + 2 * i], c[first + 1 + 2 * i]
        ex, ey = c[first + 2 * j] - ax, c[first + 1 + 2 * j] - ay
        length2 = ex * ex + ey * ey
        length = np.sqrt(length2)
        nx, ny = ey / length, -ex / length
        above = nx * (x - ax) + ny * (y - ay)
        if above > height:
            height, height_nx, height_ny = above, nx, ny
        along = min(max(((x - ax) * ex + (y - ay) * ey) / length2, 0.0), 1.0)
        ox, oy = x - (ax + along * ex), y - (ay + along * ey)
        distance2 = ox * ox + oy * oy
        if distance2 < nearest2:
            nearest2, offset_x, offset_y = distance2, ox, oy
            on_edge, edge_nx, edge_ny = 0.0 < along < 1.0, nx, ny
    nearest = np.sqrt(nearest2)
    if height <= 0.0 or nearest < TINY:
        return height, height_nx, height_ny, np.inf, -height_ny, height_nx
    if on_edge:
        return nearest, edge_nx, edge_ny, np.inf, -edge_ny, edge_nx
    return _point_jet(offset_x, offset_y)


@njit(cache=True, error_model="numpy")
def polygon_edge(c: Array, i: int) -> tuple[float, float, float, float]:
    """Return the start (x, y) and the vector (x, y) of edge i of a polygon [m]."""
    first, j = layout.FIRST_VERTEX, i + 1
    if j == layout.vertex_count(c):
        j = 0
    ax, ay = c[first + 2 * i], c[first + 1 + 2 * i]
    return ax, ay, c[first + 2 * j] - ax, c[first + 1 + 2 * j] - ay


@njit(cache=True, error_model="numpy")
def planar_jet(kind: int, c: Array, x: float, y: float) -> PlanarJet:
    """Return a planar barrier and its derivatives at the point (x, y) of its own frame.

    Every built-in Hessian has rank one, ``∇²H = t tᵀ / d``: d is the distance from the region's
    core (a disc's centre, a polygon's corner), and infinite where H is flat.

    Returns:
        H, ∇H (x, y), d, t (x, y).
    """
    if kind == HALF_PLANE:
        nx, ny = c[layout.NORMAL_X], c[layout.NORMAL_Y]
        return nx * x + ny * y - c[layout.OFFSET], nx, ny, np.inf, -ny, nx
    if kind == DISC:
        n, nx, ny, distance, tx, ty = _point_jet(x - c[layout.CENTER_X], y - c[layout.CENTER_Y])
        return n - c[layout.RADIUS], nx, ny, distance, tx, ty
    if kind == ELLIPSE:
        return _ellipse_jet(c, x, y)
    return _polygon_jet(c, x, y)


@njit(cache=True, error_model="numpy")
def planar_value(kind: int, c: Array, x: float, y: float) -> float:
    """Return H alone: a batch looks at its barriers ten times a step; infinity for a user's own."""
    if kind == HALF_PLANE:
        return c[layout.NORMAL_X] * x + c[layout.NORMAL_Y] * y - c[layout.OFFSET]
    dx, dy = x - c[layout.CENTER_X], y - c[layout.CENTER_Y]
    if kind == DISC:
        return np.sqrt(dx * dx + dy * dy) - c[layout.RADIUS]
    if kind == ELLIPSE:
        zx = c[layout.MAP_XX] * dx + c[layout.MAP_XY] * dy
        zy = c[layout.MAP_YX] * dx + c[layout.MAP_YY] * dy
        return c[layout.SHORTER_AXIS] * (np.sqrt(zx * zx + zy * zy) - 1.0)
    if kind != CONVEX_POLYGON:
        return np.inf
    nearest2, outside = np.inf, False
    corners, first = layout.vertex_count(c), layout.FIRST_VERTEX
    ax, ay = c[first + 2 * corners - 2], c[first + 2 * corners - 1]
    for i in range(corners):
        bx, by = c[first + 2 * i], c[first + 1 + 2 * i]
        ex, ey, ox, oy = bx - ax, by - ay, x - ax, y - ay
        outside |= ey * ox - ex * oy > 0.0
        along = min(max((ox * ex + oy * ey) / (ex * ex + ey * ey), 0.0), 1.0)
        ox, oy = ox - along * ex, oy - along * ey
        nearest2 = min(nearest2, ox * ox + oy * oy)
        ax, ay = bx, by
    return np.sqrt(nearest2) if outside else -np.sqrt(nearest2)


@njit(cache=True, error_model="numpy")
def speed_limit(c: Array, vx: float, vy: float) -> float:
    """Return h of a speed limit."""
    v_max = c[layout.V_MAX]
    return (v_max * v_max - vx * vx - vy * vy) / (2.0 * v_max)


@njit(cache=True, error_model="numpy")
def value(kind: int, c: Array, x: Array, t: float) -> float:
    """Return h of one barrier at the state x (4,) and time t; infinity for a user's own."""
    if kind == SPEED_LIMIT:
        return speed_limit(c, x[2], x[3])
    vx, vy = c[layout.VELOCITY_X], c[layout.VELOCITY_Y]
    return planar_value(kind, c, x[0] - vx * t, x[1] - vy * t)


@njit(cache=True, error_model="numpy")
def values(kind: Integers, parameters: Array, x: Array, t: Array, h: Array) -> None:
    """Write h (N, m) of N states x (N, 4) at the times t (N,)."""
    for i in range(x.shape[0]):
        for k in range(kind.shape[1]):
            h[i, k] = value(kind[i, k], parameters[i, k], x[i], t[i])


@njit(cache=True, error_model="numpy")
def along(kind: Integers, parameters: Array, x: Array, t: Array, h: Array) -> None:
    """Write h (k, m) of one scene, kind (m,), at k states x (k, 4) and times t (k,)."""
    for i in range(x.shape[0]):
        for k in range(kind.shape[0]):
            h[i, k] = value(kind[k], parameters[k], x[i], t[i])


@njit(cache=True, error_model="numpy")
def sense(kind: Integers, parameters: Array, x: Array, t: Array, h: Array, sensed: Array) -> None:
    """Write h (N, m) and what a policy sees of each barrier, (N, m, 4): h, unit ∇h, ∂h/∂t."""
    for i in range(x.shape[0]):
        for k in range(kind.shape[1]):
            c = parameters[i, k]
            if kind[i, k] in (SPEED_LIMIT, CUSTOM):
                h[i, k] = value(kind[i, k], c, x[i], t[i])
                sensed[i, k, 0] = h[i, k]
                sensed[i, k, 1:] = 0.0
                continue
            vx, vy = c[layout.VELOCITY_X], c[layout.VELOCITY_Y]
            h[i, k], gx, gy, _, _, _ = planar_jet(
                kind[i, k], c, x[i, 0] - vx * t[i], x[i, 1] - vy * t[i]
            )
            norm = np.sqrt(gx * gx + gy * gy)
            sensed[i, k, 0] = h[i, k]
            sensed[i, k, 1] = gx / norm
            sensed[i, k, 2] = gy / norm
            sensed[i, k, 3] = -(gx * vx + gy * vy)
