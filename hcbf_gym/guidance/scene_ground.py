"""The cells that a scene's field covers, and the price of a step through each of them."""

from collections.abc import Sequence
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers import Barrier, layout
from hcbf_gym.barriers.many import Several, Shapes
from hcbf_gym.barriers.mapped import MappedRegion
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, as_array, finite_array
from hcbf_gym.guidance.field import Ground, open_ground
from hcbf_gym.guidance.map_ground import MapGround
from hcbf_gym.models.constants import FARTHEST

LEAST_CLEARANCE = 0.01  # of a strict edge [m]: no path leads between two edges that touch


class Edges(NamedTuple):
    """The m barriers of one scene, as the core paints them onto its ground."""

    kind: Integers  # (m,) the shapes, see `barriers.layout`
    parameters: Array  # (m, layout.WIDTH) the numbers of each shape
    priority: Integers  # (m,) the ranks
    clearance: Array  # (m,) the distance of paths from each edge [m]


def edges_of(scenes: BarrierSet, n: int, clearance: Array) -> Edges:
    """Return the edges of scene n; the clearance [m] is () of strict edges, or (N, m)."""
    strict = scenes.keeps_margin[n]
    of_edges = clearance[n] if clearance.ndim else strict * clearance
    reserved = np.maximum(of_edges, strict * LEAST_CLEARANCE)
    return Edges(scenes.kind[n], scenes.parameters[n], scenes.priority[n], reserved)


def ground_at(
    map_ground: MapGround | None, edges: Edges, geometry: Array, t: float, opened: int
) -> Ground:
    """Return a scene's ground on its grid (7,) at time t [s]: its barriers over that of its map."""
    if map_ground is None:
        ground = open_ground(int(geometry[3]), int(geometry[4]), geometry[2])
    elif not (edges.kind < layout.SPEED_LIMIT).any():  # no shape beside the map
        return map_ground.ground
    else:
        ground = Ground(map_ground.ground.cost.copy(), map_ground.ground.rank.copy())
    _core.paint_barriers(*ground, geometry, *edges, t, opened)
    return ground


def corners_of(
    mask: Mask, scenes: BarrierSet, starts: Array, goals: Array, t: Array, extent: ArrayLike | None
) -> Array:
    """Return the corners (N, 2, 2) of the masked scenes: (x_min, y_min), (x_max, y_max) [m].

    Without an extent they enclose start (N, 2), goal (N, 2) and the regions at the times t (N,).
    """
    count = len(goals)
    corners = np.empty((count, 2, 2))
    if extent is None:
        for n in np.flatnonzero(mask).tolist():
            shapes = scenes.kind[n], scenes.parameters[n], scenes.priority[n]
            _core.scene_extent(*shapes, starts[n], goals[n], t[n], corners[n])
        return corners
    shape = (count, 2, 2) if as_array("extent", extent).ndim == 3 else (2, 2)
    corners[:] = finite_array("extent", extent, shape, largest=FARTHEST)
    if (corners[:, 0] >= corners[:, 1]).any():
        raise InvalidInputError(
            f"extent: got {corners.tolist()}, expected ((x_min, y_min), (x_max, y_max))"
        )
    return corners


def read_scenes(
    barriers: BarrierSet | Sequence[Barrier | Shapes | Several], count: int
) -> BarrierSet:
    """Return N scenes; refuse another number of scenes, and barriers of a user's own kind."""
    scenes = barriers if isinstance(barriers, BarrierSet) else BarrierSet([barriers])
    if len(scenes.kind) != count:
        raise InvalidInputError(f"barriers: got {len(scenes.kind)} scenes, expected {count}")
    if (scenes.kind == layout.CUSTOM).any():
        names = sorted({barrier.name for barrier in scenes.own.values()})
        raise InvalidInputError(
            f"guidance: got the barriers {names} of a user's own kind, expected built-in shapes"
        )
    return scenes


def mapped_regions(scenes: BarrierSet) -> dict[int, tuple[MappedRegion, ...]]:
    """Return scene → the classes of its map that are regions, for every scene that has one."""
    regions: dict[int, tuple[MappedRegion, ...]] = {}
    for (n, _), condition in sorted(scenes.atlas.held.items(), key=itemgetter(0)):
        if isinstance(condition, MappedRegion):
            regions[n] = (*regions.get(n, ()), condition)
    return regions
