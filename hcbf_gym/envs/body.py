"""How near the robot's whole body comes to every region."""

import mujoco
import numpy as np

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import kernels, layout, pieces
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.compilation import kernel
from hcbf_gym.envs.simulation import Simulation
from hcbf_gym.errors import choose
from hcbf_gym.robots.body_points import BodyPoints, body_of, in_plane, radius, reach

BODIES = ("point", "footprint")
"""What must stay outside: the point that follows the model, or the whole robot."""


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
        """Return the radius that holds the walking robot [m]; see `body_points.radius`."""
        return radius(self._model, self._model.body(self._trunk).name, joints)

    def h(self, data: mujoco.MjData, barriers: BarrierSet, t: float) -> Array:
        """Return the least h (m,) of each barrier over the whole body at time t [s]."""
        least = np.empty(barriers.kind.shape[1])
        scene = barriers.kind[0], barriers.parameters[0]
        atlas = barriers.atlas.numbers
        body_h(self._body, data.geom_xpos, data.geom_xmat, scene, atlas, t, least)
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


@kernel()
def body_h(
    body: BodyPoints,
    position: Array,
    rotation: Array,
    scene: tuple[Integers, Array],
    atlas: Array | None,
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
        scene: (m,) which kernel evaluates each barrier, and (m, WIDTH) what it reads.
        atlas: where the pieces of maps stand; None where there is no map.
        t: time [s].
        h: (m,) to be written [m].
    """
    geom, place, radius = body
    kind, parameters = scene
    h[:] = np.inf
    for p in range(geom.size):
        x, y = in_plane(place[p], position[geom[p]], rotation[geom[p]])
        for k in range(kind.size):
            if atlas is not None and kind[k] == layout.MAPPED:
                found = pieces.nearest(atlas, int(parameters[k, layout.PIECES]), x, y)
                h[k] = min(h[k], found.distance - radius[p])
            if not kernels.is_region(kind[k]):
                continue
            jet = kernels.jet(kind[k], parameters[k], x, y, t)
            steepness = np.sqrt(jet[1] * jet[1] + jet[2] * jet[2])
            h[k] = min(h[k], jet[0] - radius[p] * steepness)
