"""The built-in barriers compiled: values, gradients and rows of N states at once.

Each function transcribes the class of the same name in `barriers`, which is the readable form and
the reference of the tests. Points, gradients and Hessians travel as scalars, so that nothing is
allocated per state.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
PlanarJet = tuple[float, float, float, float, float, float]

HALF_PLANE, DISC, ELLIPSE, CONVEX_POLYGON, SPEED_LIMIT = 0, 1, 2, 3, 4
TINY = 1e-9


@njit(cache=True)
def norm_jet(x: float, y: float) -> PlanarJet:
    """Return ‖r‖, its gradient and its Hessian (xx, xy, yy)."""
    distance = np.sqrt(x * x + y * y)
    if distance < TINY:
        return distance, 1.0, 0.0, 0.0, 0.0, 0.0
    nx, ny = x / distance, y / distance
    return distance, nx, ny, ny * ny / distance, -nx * ny / distance, nx * nx / distance


@njit(cache=True)
def ellipse_jet(c: Array, x: float, y: float) -> PlanarJet:
    """Return H, ∇H and ∇²H of an ellipse."""
    dx, dy, scale = x - c[2], y - c[3], c[8]
    n, zx, zy, cxx, cxy, cyy = norm_jet(c[4] * dx + c[5] * dy, c[6] * dx + c[7] * dy)
    return (
        scale * (n - 1.0),
        scale * (c[4] * zx + c[6] * zy),
        scale * (c[5] * zx + c[7] * zy),
        scale * (c[4] * (c[4] * cxx + c[6] * cxy) + c[6] * (c[4] * cxy + c[6] * cyy)),
        scale * (c[5] * (c[4] * cxx + c[6] * cxy) + c[7] * (c[4] * cxy + c[6] * cyy)),
        scale * (c[5] * (c[5] * cxx + c[7] * cxy) + c[7] * (c[5] * cxy + c[7] * cyy)),
    )


@njit(cache=True)
def polygon_jet(c: Array, x: float, y: float) -> PlanarJet:
    """Return H, ∇H and ∇²H of a convex polygon."""
    corners = int(c[2])
    height, height_nx, height_ny = -np.inf, 0.0, 0.0
    nearest, offset_x, offset_y, on_edge = np.inf, 0.0, 0.0, False
    for i in range(corners):
        j = (i + 1) % corners
        ax, ay = c[3 + 2 * i], c[4 + 2 * i]
        ex, ey = c[3 + 2 * j] - ax, c[4 + 2 * j] - ay
        length2 = ex * ex + ey * ey
        length = np.sqrt(length2)
        nx, ny = ey / length, -ex / length
        above = nx * (x - ax) + ny * (y - ay)
        if above > height:
            height, height_nx, height_ny = above, nx, ny
        along = min(max(((x - ax) * ex + (y - ay) * ey) / length2, 0.0), 1.0)
        ox, oy = x - (ax + along * ex), y - (ay + along * ey)
        distance = np.sqrt(ox * ox + oy * oy)
        if distance < nearest:
            nearest, offset_x, offset_y, on_edge = distance, ox, oy, 0.0 < along < 1.0
    if height <= 0.0:
        return height, height_nx, height_ny, 0.0, 0.0, 0.0
    distance, nx, ny, hxx, hxy, hyy = norm_jet(offset_x, offset_y)
    if on_edge:
        return distance, nx, ny, 0.0, 0.0, 0.0
    return distance, nx, ny, hxx, hxy, hyy


@njit(cache=True)
def planar_jet(kind: int, c: Array, x: float, y: float) -> PlanarJet:
    """Return H, ∇H (x, y) and ∇²H (xx, xy, yy) of a planar barrier in its own frame."""
    if kind == HALF_PLANE:
        return c[2] * x + c[3] * y - c[4], c[2], c[3], 0.0, 0.0, 0.0
    if kind == DISC:
        distance, nx, ny, hxx, hxy, hyy = norm_jet(x - c[2], y - c[3])
        return distance - c[4], nx, ny, hxx, hxy, hyy
    if kind == ELLIPSE:
        return ellipse_jet(c, x, y)
    return polygon_jet(c, x, y)


@njit(cache=True)
def planar_value(kind: int, c: Array, x: float, y: float) -> float:
    """Return H alone: a batch looks at its barriers ten times a step."""
    if kind == HALF_PLANE:
        return c[2] * x + c[3] * y - c[4]
    dx, dy = x - c[2], y - c[3]
    if kind == DISC:
        return np.sqrt(dx * dx + dy * dy) - c[4]
    if kind == ELLIPSE:
        zx, zy = c[4] * dx + c[5] * dy, c[6] * dx + c[7] * dy
        return c[8] * (np.sqrt(zx * zx + zy * zy) - 1.0)
    nearest2, outside, corners = np.inf, False, int(c[2])
    ax, ay = c[1 + 2 * corners], c[2 + 2 * corners]
    for i in range(corners):
        bx, by = c[3 + 2 * i], c[4 + 2 * i]
        ex, ey, ox, oy = bx - ax, by - ay, x - ax, y - ay
        outside |= ey * ox - ex * oy > 0.0
        along = min(max((ox * ex + oy * ey) / (ex * ex + ey * ey), 0.0), 1.0)
        ox, oy = ox - along * ex, oy - along * ey
        nearest2 = min(nearest2, ox * ox + oy * oy)
        ax, ay = bx, by
    return np.sqrt(nearest2) if outside else -np.sqrt(nearest2)


@njit(cache=True)
def speed_limit(c: Array, vx: float, vy: float) -> float:
    """Return h of a speed limit."""
    return (c[2] * c[2] - vx * vx - vy * vy) / (2.0 * c[2])


@njit(cache=True)
def class_k(c: Array, h: float) -> float:
    """Return α(h)."""
    if c[0] == 0.0:
        return c[1] * h
    return np.sign(h) * c[1] * np.log1p(c[2] * abs(h) / c[3])


@njit(cache=True)
def class_k_derivative(c: Array, h: float) -> float:
    """Return dα/dh."""
    if c[0] == 0.0:
        return c[1]
    return c[1] * c[2] / (c[2] * abs(h) + c[3])


@njit(cache=True)
def value(kind: int, c: Array, x: Array, t: float) -> float:
    """Return h of one barrier at the state x (4,) and time t."""
    if kind == SPEED_LIMIT:
        return speed_limit(c, x[2], x[3])
    return planar_value(kind, c, x[0] - c[0] * t, x[1] - c[1] * t)


@njit(cache=True)
def values(kind: NDArray[np.int64], parameters: Array, x: Array, t: Array, h: Array) -> None:
    """Write h (N, m) of N states x (N, 4) at the times t (N,)."""
    for i in range(x.shape[0]):
        for k in range(kind.shape[1]):
            h[i, k] = value(kind[i, k], parameters[i, k], x[i], t[i])


@njit(cache=True)
def along(kind: NDArray[np.int64], parameters: Array, x: Array, t: Array, h: Array) -> None:
    """Write h (k, m) of one scene, kind (m,), at k states x (k, 4) and times t (k,)."""
    for i in range(x.shape[0]):
        for k in range(kind.shape[0]):
            h[i, k] = value(kind[k], parameters[k], x[i], t[i])


@njit(cache=True)
def sense(
    kind: NDArray[np.int64], parameters: Array, x: Array, t: Array, h: Array, sensed: Array
) -> None:
    """Write h (N, m) and what a policy sees of each barrier, (N, m, 4): h, unit ∇h, ∂h/∂t."""
    for i in range(x.shape[0]):
        for k in range(kind.shape[1]):
            c = parameters[i, k]
            if kind[i, k] == SPEED_LIMIT:
                h[i, k] = speed_limit(c, x[i, 2], x[i, 3])
                sensed[i, k, 0] = h[i, k]
                sensed[i, k, 1:] = 0.0
                continue
            qx, qy = x[i, 0] - c[0] * t[i], x[i, 1] - c[1] * t[i]
            h[i, k], gx, gy, _, _, _ = planar_jet(kind[i, k], c, qx, qy)
            norm = np.sqrt(gx * gx + gy * gy)
            sensed[i, k, 0] = h[i, k]
            sensed[i, k, 1] = gx / norm
            sensed[i, k, 2] = gy / norm
            sensed[i, k, 3] = -(gx * c[0] + gy * c[1])


@njit(cache=True)
def rows(
    kind: NDArray[np.int64],
    parameters: Array,
    margin: Array,
    x: Array,
    t: Array,
    alpha1: Array,
    alpha2: Array,
    a: Array,
    b: Array,
    h: Array,
    alpha2_psi: Array,
) -> None:
    """Write the double integrator's rows of N states; see `general.GeneralRows`.

    With r = v − w the velocity seen from the barrier's frame,
    ``a = ∇H`` and ``b = −α₂(ψ) − rᵀ∇²H r − α₁'(h) ∇H·r``, ``ψ = ∇H·r + α₁(h)``.
    """
    for i in range(x.shape[0]):
        for k in range(kind.shape[1]):
            c = parameters[i, k]
            if kind[i, k] == SPEED_LIMIT:
                h[i, k] = speed_limit(c, x[i, 2], x[i, 3])
                a[i, k, 0] = -x[i, 2] / c[2]
                a[i, k, 1] = -x[i, 3] / c[2]
                alpha2_psi[i, k] = class_k(alpha2, h[i, k] - c[3])
                b[i, k] = -alpha2_psi[i, k]
                continue
            qx, qy = x[i, 0] - c[0] * t[i], x[i, 1] - c[1] * t[i]
            rx, ry = x[i, 2] - c[0], x[i, 3] - c[1]
            h[i, k], gx, gy, hxx, hxy, hyy = planar_jet(kind[i, k], c, qx, qy)
            kept = h[i, k] - margin[i, k]
            h_dot = gx * rx + gy * ry
            curving = rx * rx * hxx + 2.0 * rx * ry * hxy + ry * ry * hyy
            a[i, k, 0] = gx
            a[i, k, 1] = gy
            alpha2_psi[i, k] = class_k(alpha2, h_dot + class_k(alpha1, kept))
            b[i, k] = -alpha2_psi[i, k] - curving - class_k_derivative(alpha1, kept) * h_dot
