"""The built-in barriers compiled: values and derivatives of N states at once.

What moves is looked at in its own frame: `jet` is the one place where a frame is moved and a shape
looked up. A user's own barrier (`layout.CUSTOM`) is passed over: `BarrierSet` fills it in.
"""

import numpy as np
from numba import njit

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import layout, shapes, speed_limit
from hcbf_gym.barriers.layout import SPEED_LIMIT
from hcbf_gym.barriers.shape import PlanarJet


@njit(cache=True, error_model="numpy", inline="always")
def is_region(kind: int) -> bool:
    """Tell whether a barrier is a built-in one on the position."""
    return kind < SPEED_LIMIT


@njit(cache=True, error_model="numpy", inline="always")
def in_frame(c: Array, x: float, y: float, t: float) -> tuple[float, float]:
    """Return a point of the world (x, y) as the barrier's frame sees it at time t."""
    return x - c[layout.VELOCITY_X] * t, y - c[layout.VELOCITY_Y] * t


@njit(cache=True, error_model="numpy", inline="always")
def jet(kind: int, c: Array, x: float, y: float, t: float) -> PlanarJet:
    """Return h of a region at a point of the world (x, y) and time t, ∇h, d and t; see `shapes`."""
    qx, qy = in_frame(c, x, y, t)
    return shapes.jet(kind, c, qx, qy)


@njit(cache=True, error_model="numpy", inline="always")
def height(kind: int, c: Array, x: float, y: float, t: float) -> float:
    """Return h of a region at a point of the world; infinity for a user's own barrier."""
    return jet(kind, c, x, y, t)[0]


@njit(cache=True, error_model="numpy", inline="always")
def value(kind: int, c: Array, x: Array, t: float) -> float:
    """Return h of one barrier at the state x (4,) and time t; infinity for a user's own."""
    if kind == SPEED_LIMIT:
        return speed_limit.value(c[layout.V_MAX], x[2], x[3])
    return height(kind, c, x[0], x[1], t)


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
            if not is_region(kind[i, k]):
                h[i, k] = value(kind[i, k], c, x[i], t[i])
                sensed[i, k, 0] = h[i, k]
                sensed[i, k, 1:] = 0.0
                continue
            h[i, k], gx, gy, _, _, _ = jet(kind[i, k], c, x[i, 0], x[i, 1], t[i])
            norm = np.sqrt(gx * gx + gy * gy)
            sensed[i, k, 0] = h[i, k]
            sensed[i, k, 1] = gx / norm
            sensed[i, k, 2] = gy / norm
            sensed[i, k, 3] = -(gx * c[layout.VELOCITY_X] + gy * c[layout.VELOCITY_Y])
