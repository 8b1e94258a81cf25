"""The built-in barriers compiled: values and derivatives of N states at once.

What moves is evaluated in its own frame: `jet` is the one place where a frame is moved and a shape
looked up. A user's own barrier (`layout.CUSTOM`) is passed over: `BarrierSet` fills it in.
"""

import numpy as np

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import layout, pieces, shapes, speed_limit, zone
from hcbf_gym.barriers.layout import MAPPED, SPEED_LIMIT, ZONES
from hcbf_gym.barriers.shape import PlanarJet
from hcbf_gym.compilation import kernel
from hcbf_gym.models.constants import FARTHEST


@kernel(error_model="numpy", inline="always")
def is_region(kind: int) -> bool:
    """Return whether a barrier is a built-in shape."""
    return kind < SPEED_LIMIT


@kernel(error_model="numpy", inline="always")
def in_frame(c: Array, x: float, y: float, t: float) -> tuple[float, float]:
    """Return a point of the world (x, y) as the barrier's frame sees it at time t."""
    return x - c[layout.VELOCITY_X] * t, y - c[layout.VELOCITY_Y] * t


@kernel(error_model="numpy", inline="always")
def jet(kind: int, c: Array, x: float, y: float, t: float) -> PlanarJet:
    """Return h of a region at a point of the world (x, y) and time t, ∇h, d and t; see `shapes`."""
    qx, qy = in_frame(c, x, y, t)
    return shapes.jet(kind, c, qx, qy)


@kernel(error_model="numpy", inline="always")
def height(kind: int, c: Array, x: float, y: float, t: float) -> float:
    """Return h of a region at a point of the world; infinity for a user's own barrier."""
    return jet(kind, c, x, y, t)[0]


@kernel(error_model="numpy", inline="always")
def is_mapped(kind: int) -> bool:
    """Return whether a barrier is a class of a map."""
    return MAPPED <= kind <= ZONES


@kernel(error_model="numpy")
def of_map(kind: int, c: Array, distance: float, vx: float, vy: float) -> float:
    """Return h of a class of a map at a distance from its nearest piece and a velocity."""
    distance = min(distance, FARTHEST)  # where there is no piece at all
    if kind == MAPPED:
        return distance
    return zone.value(c[layout.V_MAX], max(0.0, distance - c[layout.KEPT]), vx, vy)


@kernel(error_model="numpy", inline="always")
def value(kind: int, c: Array, atlas: Array | None, x: Array, t: float) -> float:
    """Return h of one barrier at the state x (4,) and time t; infinity for a user's own."""
    if kind == SPEED_LIMIT:
        return speed_limit.value(c[layout.V_MAX], x[2], x[3])
    if atlas is not None and is_mapped(kind):
        distance = pieces.nearest(atlas, int(c[layout.PIECES]), x[0], x[1]).distance
        return of_map(kind, c, distance, x[2], x[3])
    return height(kind, c, x[0], x[1], t)


@kernel(error_model="numpy")
def values(
    kind: Integers, parameters: Array, atlas: Array | None, x: Array, t: Array, h: Array
) -> None:
    """Write h (N, m) of N states x (N, 4) at the times t (N,), in N scenes or all in one.

    Args:
        kind: (N, m), or (1, m) of one scene.
        parameters: (N, m, WIDTH) or (1, m, WIDTH).
        atlas: where the pieces of maps stand; None where there is no map.
        x: (N, 4) positions [m] and velocities [m/s].
        t: (N,) times [s].
        h: (N, m) to be written.
    """
    for i in range(x.shape[0]):
        n = i if kind.shape[0] > 1 else 0
        for k in range(kind.shape[1]):
            h[i, k] = value(kind[n, k], parameters[n, k], atlas, x[i], t[i])


@kernel(error_model="numpy")
def sense(
    kind: Integers,
    parameters: Array,
    atlas: Array | None,
    x: Array,
    t: Array,
    h: Array,
    sensed: Array,
) -> None:
    """Write h (N, m) and what a policy sees of each barrier, (N, m, 4): h, unit ∇h, ∂h/∂t.

    Args: as `values`, each scene with its state. Three zeros follow h of what is no region.
    """
    for i in range(x.shape[0]):
        for k in range(kind.shape[1]):
            c = parameters[i, k]
            sensed[i, k, 1:] = 0.0
            if atlas is not None and kind[i, k] == MAPPED:
                jet_there = pieces.jet(atlas, int(c[layout.PIECES]), x[i, 0], x[i, 1])
                h[i, k], sensed[i, k, 1], sensed[i, k, 2] = jet_there
            elif is_region(kind[i, k]):
                h[i, k], gx, gy, _, _, _ = jet(kind[i, k], c, x[i, 0], x[i, 1], t[i])
                norm = np.sqrt(gx * gx + gy * gy)
                sensed[i, k, 1] = gx / norm
                sensed[i, k, 2] = gy / norm
                sensed[i, k, 3] = -(gx * c[layout.VELOCITY_X] + gy * c[layout.VELOCITY_Y])
            else:
                h[i, k] = value(kind[i, k], c, atlas, x[i], t[i])
            sensed[i, k, 0] = h[i, k]
