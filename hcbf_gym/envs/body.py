"""The robot's whole body as points with radii, and how near it comes to every region.

Spheres and capsules are exact: a few points along the axis, each with the radius. Boxes are points
on their edges, cylinders count as capsules, anything else as the sphere around it.
"""

from typing import NamedTuple

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.barriers import kernels, layout

Array = NDArray[np.float64]

ALONG = 5
"""Points along the axis of a capsule, and along each edge of a box."""


class Body(NamedTuple):
    """The points of a robot's geoms.

    Attributes:
        geom: (P,) which geom each point belongs to.
        place: (P, 3) where it is in the geom's frame [m].
        radius: (P,) of the ball around it [m].
    """

    geom: NDArray[np.int64]
    place: Array
    radius: Array


def body_of(model: mujoco.MjModel, root: int) -> Body:
    """Return the points of every geom of the robot whose tree starts at the body `root`."""
    geoms = np.flatnonzero(model.body_rootid[model.geom_bodyid] == root)
    parts = [_points(model, int(geom)) for geom in geoms]
    counts = [len(place) for place, _ in parts]
    return Body(
        np.repeat(geoms, counts).astype(np.int64),
        np.concatenate([place for place, _ in parts]),
        np.concatenate([np.full(n, r) for n, (_, r) in zip(counts, parts, strict=True)]),
    )


def _points(model: mujoco.MjModel, geom: int) -> tuple[Array, float]:
    """Return points (k, 3) of a geom in its own frame, and the radius around them [m]."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    axis = np.linspace(-1.0, 1.0, ALONG)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.zeros((1, 3)), float(size[0])
    if kind in (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER):
        return np.column_stack([0.0 * axis, 0.0 * axis, size[1] * axis]), float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        ends = np.array([-1.0, 1.0])
        edges = [
            np.roll(np.array([[a, b, c] for a in axis for b in ends for c in ends]), k, axis=1)
            for k in range(3)
        ]
        return np.unique(np.concatenate(edges), axis=0) * size, 0.0
    return np.zeros((1, 3)), float(model.geom_rbound[geom])


@njit(cache=True)
def reach(body: Body, position: Array, rotation: Array, centre: Array) -> float:
    """Return the greatest horizontal distance of the body from a point (2,) [m].

    Args:
        body: the points.
        position: (ngeom, 3) of the geoms in the world [m].
        rotation: (ngeom, 9) of the geoms, row by row.
        centre: (2,) [m].
    """
    farthest = 0.0
    for p in range(body.geom.size):
        x, y = _world(body, p, position, rotation)
        distance = np.sqrt((x - centre[0]) ** 2 + (y - centre[1]) ** 2) + body.radius[p]
        farthest = max(farthest, distance)
    return farthest


@njit(cache=True)
def body_h(
    body: Body,
    position: Array,
    rotation: Array,
    kind: NDArray[np.int64],
    parameters: Array,
    t: float,
    h: Array,
) -> None:
    """Write the least h (m,) of each barrier over the whole body; a speed limit's is infinite.

    ``h_body = min_p h(p) − r_p``; as ‖∇h‖ ≤ 1 it is no greater than h anywhere on the ball.

    Args:
        body: the points.
        position: (ngeom, 3) of the geoms in the world [m].
        rotation: (ngeom, 9) of the geoms, row by row.
        kind: (m,) which kernel evaluates each barrier.
        parameters: (m, WIDTH) what it reads.
        t: time [s].
        h: (m,) to be written [m].
    """
    h[:] = np.inf
    for p in range(body.geom.size):
        x, y = _world(body, p, position, rotation)
        for k in range(kind.size):
            if kind[k] >= layout.SPEED_LIMIT:
                continue
            c = parameters[k]
            qx, qy = x - c[layout.VELOCITY_X] * t, y - c[layout.VELOCITY_Y] * t
            h[k] = min(h[k], kernels.planar_value(kind[k], c, qx, qy) - body.radius[p])


@njit(cache=True)
def _world(body: Body, p: int, position: Array, rotation: Array) -> tuple[float, float]:
    """Return where a point is in the plane of the world [m]."""
    g = body.geom[p]
    r = rotation[g]
    a, b, c = body.place[p]
    return (
        position[g, 0] + r[0] * a + r[1] * b + r[2] * c,
        position[g, 1] + r[3] * a + r[4] * b + r[5] * c,
    )
