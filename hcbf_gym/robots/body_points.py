"""The robot's body as points with radii, and the circle that encloses the walking robot.

A sphere or a capsule becomes a few points along its axis with its radius, a box points on its
edges. A cylinder counts as a capsule, any other geom as the sphere around it.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from hcbf_gym.arrays import Array, Integers

POINTS_PER_AXIS = 5  # number of points along a capsule's axis and along each edge of a box
TILT = 0.2  # the greatest tilt of a walking trunk [rad]
STRIDE = 0.065  # by how much more than at home a leg reaches from the trunk's centre at most [m]


class BodyPoints(NamedTuple):
    """The points of a robot's geoms."""

    geom: Integers  # (P,) the geom that each point belongs to
    place: Array  # (P, 3) position in the geom's frame [m]
    radius: Array  # (P,) radius of the ball around each point [m]


def body_of(model: mujoco.MjModel, root: int) -> BodyPoints:
    """Return the points of every geom of the robot whose tree starts at the body `root`."""
    geoms = np.flatnonzero(model.body_rootid[model.geom_bodyid] == root)
    points, radii = zip(*(_points(model, int(geom)) for geom in geoms), strict=True)
    counts = [len(of_geom) for of_geom in points]
    return BodyPoints(
        geom=np.repeat(geoms, counts).astype(np.int64),
        place=np.concatenate(points),
        radius=np.repeat(radii, counts),
    )


def radius(model: mujoco.MjModel, trunk: str, joints: Array) -> float:
    """Return the radius [m] of the circle around the trunk that encloses the walking robot.

    A point that is fixed to the trunk reaches ``ρ + |z| sin(TILT)`` at most, ρ from the vertical
    axis and z high at home. The legs reach `STRIDE` farther than at home.

    Args:
        model: the robot, alone or in its scene.
        trunk: the name of its first body.
        joints: (j,) angles of the home pose [rad].
    """
    root = model.body(trunk).id
    data = mujoco.MjData(model)
    data.qpos[:7] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    data.qpos[7 : 7 + len(joints)] = joints
    mujoco.mj_kinematics(model, data)
    body = body_of(model, root)
    rotations = data.geom_xmat[body.geom].reshape(-1, 3, 3)
    points = data.geom_xpos[body.geom] + np.einsum("pij,pj->pi", rotations, body.place)
    reach = np.hypot(points[:, 0], points[:, 1]) + body.radius  # at home
    is_fixed = model.body_weldid[model.geom_bodyid[body.geom]] == model.body_weldid[root]
    tilted = reach + np.sin(TILT) * np.abs(points[:, 2])
    return float(np.where(is_fixed, tilted, reach + STRIDE).max())


def _points(model: mujoco.MjModel, geom: int) -> tuple[Array, float]:
    """Return points (k, 3) of a geom in its own frame, and the radius around them [m]."""
    kind = model.geom_type[geom]
    size = model.geom_size[geom]
    axis = np.linspace(-1.0, 1.0, POINTS_PER_AXIS)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.zeros((1, 3)), float(size[0])
    if kind in (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER):
        return np.column_stack([0.0 * axis, 0.0 * axis, size[1] * axis]), float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        ends = (-1.0, 1.0)
        edges_along_x = np.array([[x, y, z] for x in axis for y in ends for z in ends])
        edges = [np.roll(edges_along_x, shift, axis=1) for shift in range(3)]  # along x, y, z
        return np.unique(np.concatenate(edges), axis=0) * size, 0.0
    return np.zeros((1, 3)), float(model.geom_rbound[geom])


def stand(data: mujoco.MjData, position: Array, height: float, yaw: float, home: Array) -> None:
    """Pose a scene's first robot: position (2,) and height [m], yaw and home joints (j,) [rad]."""
    data.qpos[:2] = position
    data.qpos[2] = height
    data.qpos[3:7] = np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)
    data.qpos[7 : 7 + len(home)] = home
