"""The robot's whole body as points with radii, and how near it comes to every region.

Spheres and capsules are exact: a few points along the axis, each with the radius. Boxes are points
on their edges, cylinders count as capsules, anything else as the sphere around it.
"""

from typing import NamedTuple

import mujoco
import numpy as np
from numba import njit

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import kernels, layout, pieces
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs.simulation import Simulation
from hcbf_gym.errors import choose

BODIES = ("point", "footprint")
"""What must stay outside: the point that follows the model, or the whole robot."""

ALONG = 5
"""Points along the axis of a capsule, and along each edge of a box."""

TILT = 0.2
"""How far the trunk leans at most while it walks [rad]."""

STRIDE = 0.065
"""How much farther from the trunk's centre a leg reaches in its stride than at home [m]."""


class BodyPoints(NamedTuple):
    """The points of a robot's geoms.

    Attributes:
        geom: (P,) which geom each point belongs to.
        place: (P, 3) where it is in the geom's frame [m].
        radius: (P,) of the ball around it [m].
    """

    geom: Integers
    place: Array
    radius: Array


class Footprint:
    """How near the whole robot comes to the barriers of a scene.

    Args:
        model: the compiled scene.
        trunk: the name of the robot's first body.
    """

    def __init__(self, model: mujoco.MjModel, trunk: str):
        self._model = model
        self._trunk = model.body(trunk).id
        self._body = body_of(model, self._trunk)

    def radius(self, joints: Array) -> float:
        """Return the radius of the circle around the trunk's centre that holds the walking robot.

        What is fixed to the trunk, its load included, reaches ``ρ + |z| sin(TILT)`` at most; the
        legs reach `STRIDE` farther than at home.

        Args:
            joints: (12,) of the home pose [rad].
        """
        data = mujoco.MjData(self._model)
        data.qpos[:7] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
        data.qpos[7 : 7 + len(joints)] = joints
        mujoco.mj_kinematics(self._model, data)
        body = self._body
        places = data.geom_xpos[self._body.geom]
        rotations = data.geom_xmat[body.geom].reshape(-1, 3, 3)
        points = places + np.einsum("pij,pj->pi", rotations, body.place)
        far = np.hypot(points[:, 0], points[:, 1]) + body.radius
        weld = self._model.body_weldid[self._model.geom_bodyid[body.geom]]
        fixed = weld == self._model.body_weldid[self._trunk]
        leaning = far + np.sin(TILT) * np.abs(points[:, 2])
        return float(np.where(fixed, leaning, far + STRIDE).max())

    def h(self, data: mujoco.MjData, barriers: BarrierSet, t: float) -> Array:
        """Return the least h (m,) of each barrier over the whole body at time t [s]."""
        least = np.empty(barriers.kind.shape[1])
        scene = barriers.kind[0], barriers.parameters[0], barriers.atlas.numbers
        body_h(self._body, data.geom_xpos, data.geom_xmat, scene, t, least)
        return least

    def reach(self, data: mujoco.MjData) -> float:
        """Return the greatest horizontal distance of the body from the trunk's origin [m]."""
        return reach(self._body, data.geom_xpos, data.geom_xmat, data.xpos[self._trunk])


def footprint_of(body: str, simulation: Simulation) -> Footprint | None:
    """Return what measures the whole robot's distance; None for a point.

    Args:
        body: a name of `BODIES`.
        simulation: the scene with the robot in it.

    Raises:
        UnknownNameError: if there is no such body.
    """
    choose("body", body, dict.fromkeys(BODIES))
    return None if body == "point" else Footprint(simulation.model, simulation.trunk)


def body_of(model: mujoco.MjModel, root: int) -> BodyPoints:
    """Return the points of every geom of the robot whose tree starts at the body `root`."""
    geoms = np.flatnonzero(model.body_rootid[model.geom_bodyid] == root)
    parts = [_points(model, int(geom)) for geom in geoms]
    counts = [len(place) for place, _ in parts]
    return BodyPoints(
        np.repeat(geoms, counts).astype(np.int64),
        np.concatenate([place for place, _ in parts]),
        np.concatenate([np.full(n, r) for n, (_, r) in zip(counts, parts, strict=True)]),
    )


def _points(model: mujoco.MjModel, geom: int) -> tuple[Array, float]:
    """Return points (k, 3) of a geom in its own frame, and the radius around them [m]."""
    kind = model.geom_type[geom]
    size = model.geom_size[geom]
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
def reach(body: BodyPoints, position: Array, rotation: Array, centre: Array) -> float:
    """Return the greatest horizontal distance of the body from a point (2,) [m].

    Args:
        body: the points.
        position: (ngeom, 3) of the geoms in the world [m].
        rotation: (ngeom, 9) of the geoms, row by row.
        centre: (2,) [m].
    """
    geom, place, radius = body
    farthest = 0.0
    for p in range(geom.size):
        x, y = _world(place[p], position[geom[p]], rotation[geom[p]])
        distance = np.sqrt((x - centre[0]) ** 2 + (y - centre[1]) ** 2) + radius[p]
        farthest = max(farthest, distance)
    return farthest


@njit(cache=True)
def body_h(
    body: BodyPoints,
    position: Array,
    rotation: Array,
    scene: tuple[Integers, Array, Array],
    t: float,
    h: Array,
) -> None:
    """Write the least h (m,) of each barrier over the whole body; a speed limit's is infinite.

    ``h_body = min_p h(p) − r_p ‖∇h(p)‖``; as h is convex, it is no greater than h anywhere on the
    ball around p.

    Args:
        body: the points.
        position: (ngeom, 3) of the geoms in the world [m].
        rotation: (ngeom, 9) of the geoms, row by row.
        scene: (m,) which kernel evaluates each barrier, (m, WIDTH) what it reads, and where the
            pieces of maps stand.
        t: time [s].
        h: (m,) to be written [m].
    """
    geom, place, radius = body
    kind, parameters, atlas = scene
    h[:] = np.inf
    for p in range(geom.size):
        x, y = _world(place[p], position[geom[p]], rotation[geom[p]])
        for k in range(kind.size):
            if kind[k] == layout.MAPPED:
                found = pieces.nearest(atlas, int(parameters[k, layout.PIECES]), x, y)
                h[k] = min(h[k], found.distance - radius[p])
            if not kernels.is_region(kind[k]):
                continue
            jet = kernels.jet(kind[k], parameters[k], x, y, t)
            steepness = np.sqrt(jet[1] * jet[1] + jet[2] * jet[2])
            h[k] = min(h[k], jet[0] - radius[p] * steepness)


@njit(cache=True)
def _world(place: Array, position: Array, rotation: Array) -> tuple[float, float]:
    """Return where a point of a geom is in the plane of the world [m]."""
    return (
        position[0] + rotation[0] * place[0] + rotation[1] * place[1] + rotation[2] * place[2],
        position[1] + rotation[3] * place[0] + rotation[4] * place[1] + rotation[5] * place[2],
    )
