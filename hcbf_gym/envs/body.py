"""The footprint: the distance of the robot's whole body from every region."""

import mujoco
import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs.simulation import Simulation
from hcbf_gym.errors import choose
from hcbf_gym.robots.body_points import body_of, radius


class Footprint:
    """Measures the distance of the whole robot, whose first body is the trunk, from barriers."""

    def __init__(self, model: mujoco.MjModel, trunk: str):
        self._model = model
        self._trunk = model.body(trunk).id
        self._body = body_of(model, self._trunk)

    def radius(self, joints: Array) -> float:
        """Return the radius around the trunk that contains the walking robot [m].

        The joints (j,) are those of the home pose [rad]; see `body_points.radius`.
        """
        return radius(self._model, self._model.body(self._trunk).name, joints)

    def h(self, data: mujoco.MjData, barriers: BarrierSet, t: float) -> Array:
        """Return the least h (m,) of each barrier over the whole body at time t [s].

        The body is a set of balls with centres p and radii r_p: ``min_p h(p) − r_p ‖∇h(p)‖``. As h
        is convex, this is no greater than h anywhere on a ball. A speed limit's is infinite.
        """
        least = np.empty(barriers.kind.shape[1])
        scene = barriers.kind[0], barriers.parameters[0]
        atlas = barriers.atlas.numbers
        _core.body_heights(self._body, data.geom_xpos, data.geom_xmat, *scene, atlas, t, least)
        return least

    def reach(self, data: mujoco.MjData) -> float:
        """Return the greatest horizontal distance of the body from the trunk's origin [m]."""
        trunk = data.xpos[self._trunk]
        return _core.body_reach(self._body, data.geom_xpos, data.geom_xmat, trunk)


def footprint_of(body: str, simulation: Simulation) -> Footprint | None:
    """Return the footprint of the robot for the body "footprint", and None for "point"."""
    choose("body", body, dict.fromkeys(("point", "footprint")))
    return None if body == "point" else Footprint(simulation.model, simulation.trunk)
