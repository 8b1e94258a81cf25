"""The robot's whole body as points with radii, and the circle that holds it.

Spheres and capsules are exact: a few points along the axis, each with the radius. Boxes are points
on their edges, cylinders count as capsules, anything else as the sphere around it.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from hcbf_gym.arrays import Array, Integers

ALONG = 5  # points along the axis of a capsule, and along each edge of a box

TILT = 0.2  # the greatest tilt of a walking trunk [rad]

STRIDE = 0.065  # by how much a leg reaches farther from the trunk's centre than at home [m]


class BodyPoints(NamedTuple):
    """The points of a robot's geoms."""

    geom: Integers  # (P,) which geom each point belongs to
    place: Array  # (P, 3) where it is in the geom's frame [m]
    radius: Array  # (P,) of the ball around it [m]


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


def radius(model: mujoco.MjModel, trunk: str, joints: Array) -> float:
    """Return the radius of the circle around the trunk's centre that holds the walking robot [m].

    What is fixed to the trunk, its load included, reaches ``ρ + |z| sin(TILT)`` at most; the
    legs reach `STRIDE` farther than at home.

    Args:
        model: the robot, alone or in its scene.
        trunk: the name of its first body.
        joints: (j,) of the home pose [rad].
    """
    first = model.body(trunk).id
    data = mujoco.MjData(model)
    data.qpos[:7] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    data.qpos[7 : 7 + len(joints)] = joints
    mujoco.mj_kinematics(model, data)
    body = body_of(model, first)
    rotations = data.geom_xmat[body.geom].reshape(-1, 3, 3)
    points = data.geom_xpos[body.geom] + np.einsum("pij,pj->pi", rotations, body.place)
    far = np.hypot(points[:, 0], points[:, 1]) + body.radius
    fixed = model.body_weldid[model.geom_bodyid[body.geom]] == model.body_weldid[first]
    tilted = far + np.sin(TILT) * np.abs(points[:, 2])
    return float(np.where(fixed, tilted, far + STRIDE).max())


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


def stand(data: mujoco.MjData, position: Array, height: float, yaw: float, home: Array) -> None:
    """Put a scene's first robot at rest: trunk (2,) and its height [m], yaw, joints (j,) [rad]."""
    data.qpos[:2] = position
    data.qpos[2] = height
    data.qpos[3:7] = np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)
    data.qpos[7 : 7 + len(home)] = home
