"""Which goals and starts guidance takes: others are refused before anything changes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, as_array, finite_array
from hcbf_gym.guidance import field as fields
from hcbf_gym.guidance.map_ground import MapGround


def points(name: str, value: ArrayLike | None, count: int) -> Array:
    """Return (N, 2) points of one point or N.

    Raises:
        InvalidInputError: if there is none, or it is not made of finite numbers.
    """
    if value is None:
        raise InvalidInputError(
            f'{name}: got None, expected (2,) [m]; guidance "geodesic" needs a {name}, '
            '"local" does not'
        )
    shape = (count, 2) if as_array(name, value).ndim == 2 else (2,)
    return np.broadcast_to(finite_array(name, value, shape), (count, 2)).copy()


def check_extent(mask: Mask, goal: Array, start: Array, geometry: Array) -> None:
    """Refuse goals and starts that no grid covers.

    Raises:
        InvalidInputError: if one lies outside its grid.
    """
    for name, point in (("goal", goal), ("start", start)):
        for n in np.flatnonzero(mask).tolist():
            place = geometry[n]
            cell = np.array(fields.to_cells(point[n, 0], point[n, 1], place))
            last = place[3:5] - 1.0
            if (cell < -1e-9).any() or (cell > last + 1e-9).any():
                low = fields.to_world(0.0, 0.0, place)
                high = fields.to_world(last[0], last[1], place)
                raise InvalidInputError(
                    f"{name}: got {point[n].tolist()}, expected a point within the extent "
                    f"({low}, {high})"
                )


def check_on_maps(mask: Mask, grounds: Sequence[MapGround | None], goal: Array) -> None:
    """Refuse goals that a body's centre cannot be at.

    Raises:
        InvalidInputError: if one is nearer to cells of rank 1 than the clearance.
    """
    for n in np.flatnonzero(mask).tolist():
        base = grounds[n]
        if base is None:
            continue
        j, i = fields.cell_of(goal[n, 0], goal[n, 1], base.geometry)
        if base.ground.rank[j + 1, i + 1] == 1:
            raise InvalidInputError(
                f"goal: got {goal[n].tolist()}, too close to {base.name_at(j, i, 1)}, rank 1, "
                f"expected {base.clearance:.3f} m and the class's own margin of room around it"
            )


def check_goal(mask: Mask, scenes: BarrierSet, goal: Array, time: Array) -> None:
    """Refuse goals that no field can serve.

    Raises:
        InvalidInputError: if one lies inside a strict region.
    """
    x = np.hstack([goal, np.zeros_like(goal)])
    h = scenes.values(x, time)
    strict = (scenes.priority == 1) & (scenes.kind != layout.SPEED_LIMIT)
    inside = mask[:, None] & strict & (h < 0.0)
    if inside.any():
        n, k = np.argwhere(inside)[0].tolist()
        raise InvalidInputError(
            f"goal: got {goal[n].tolist()}, {-h[n, k]:.3f} m inside the strict region number "
            f"{k + 1}, expected a goal outside every region of rank 1"
        )
