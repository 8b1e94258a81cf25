"""Why guidance finds no path to a goal, as far as that is known before a field is computed."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, as_array, finite_array
from hcbf_gym.guidance import field as fields
from hcbf_gym.guidance.map_ground import MapGround


def points(name: str, value: ArrayLike | None, count: int) -> Array:
    """Return (N, 2) points of one point or N; NaN for coordinates that are not finite.

    Raises:
        InvalidInputError: if there is none, or it is not made of real numbers.
    """
    if value is None:
        raise InvalidInputError(
            f'{name}: got None, expected (2,) [m]; guidance "geodesic" needs a {name}, '
            '"local" does not'
        )
    given = as_array(name, value)
    shape = (count, 2) if given.ndim == 2 else (2,)
    if given.dtype.kind != "f":
        return np.broadcast_to(finite_array(name, given, shape), (count, 2)).copy()
    known = np.isfinite(given)
    found = finite_array(name, np.where(known, given, 0.0), shape)
    return np.broadcast_to(np.where(known, found, np.nan), (count, 2)).copy()


def refusals(
    mask: Mask,
    scenes: BarrierSet,
    grounds: Sequence[MapGround | None],
    place: tuple[Array, Array, Array],
    t: Array,
) -> dict[int, str]:
    """Return scene → why no path leads to its goal, where that is known before there is a field.

    Args:
        mask: (N,) which scenes.
        scenes: of all N.
        grounds: of their maps.
        place: goals (N, 2) [m], starts (N, 2) [m] and the geometry (N, 7) of the grids.
        t: (N,) [s].
    """
    goal, start, geometry = place
    x = np.hstack([np.where(np.isfinite(goal), goal, 0.0), np.zeros_like(goal)])
    h = scenes.values(x, t)
    strict = (scenes.priority == 1) & (scenes.kind != layout.SPEED_LIMIT)
    found: dict[int, str] = {}
    for n in np.flatnonzero(mask).tolist():
        found[n] = (
            _unknown("goal", goal[n])
            or _unknown("start", start[n])
            or _beyond("goal", goal[n], geometry[n])
            or _beyond("start", start[n], geometry[n])
            or _beside_walls(grounds[n], goal[n])
            or _inside(goal[n], h[n], strict[n])
        )
    return {n: why for n, why in found.items() if why}


def _unknown(name: str, point: Array) -> str:
    """Return why a point (2,) is none; "" where it is finite."""
    if np.isfinite(point).all():
        return ""
    return f"{name}: got {point.tolist()}, expected finite numbers"


def _beyond(name: str, point: Array, geometry: Array) -> str:
    """Return why a point (2,) is none on a grid (7,); "" where it is on it."""
    cell = np.array(_core.field_to_cells(point[0], point[1], geometry))
    last = geometry[3:5] - 1.0
    if not ((cell < -1e-9).any() or (cell > last + 1e-9).any()):
        return ""
    low = fields.to_world(0.0, 0.0, geometry)
    high = fields.to_world(float(last[0]), float(last[1]), geometry)
    return f"{name}: got {point.tolist()}, expected a point within the extent ({low}, {high})"


def _beside_walls(base: MapGround | None, goal: Array) -> str:
    """Return why a body's centre cannot be at a goal (2,) on a map; "" where it can."""
    if base is None:
        return ""
    j, i = _core.field_cell_of(goal[0], goal[1], base.geometry)
    if base.ground.rank[j + 1, i + 1] != 1:
        return ""
    return (
        f"goal: got {goal.tolist()}, too close to {base.name_at(j, i, 1)}, rank 1, "
        f"expected {base.clearance:.3f} m and the class's own margin of room around it"
    )


def _inside(goal: Array, h: Array, strict: Mask) -> str:
    """Return in which strict region a goal (2,) is, by h (m,) there; "" where in none."""
    inside = np.flatnonzero(strict & (h < 0.0))
    if len(inside) == 0:
        return ""
    k = int(inside[0])
    return (
        f"goal: got {goal.tolist()}, {-h[k]:.3f} m inside the strict region number "
        f"{k + 1}, expected a goal outside every region of rank 1"
    )
