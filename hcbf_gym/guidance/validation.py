"""The reasons why no path leads to a goal: each check returns a sentence, or "" if it passes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Field, Mask, Ranks
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, as_array, finite_array, finite_float
from hcbf_gym.guidance import field as fields
from hcbf_gym.guidance.map_ground import MapGround

ROUNDING = 1e-9  # by how much of a cell a point may be outside of the grid


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
    is_finite = np.isfinite(given)
    numbers = finite_array(name, np.where(is_finite, given, 0.0), shape)
    return np.broadcast_to(np.where(is_finite, numbers, np.nan), (count, 2)).copy()


def clearance_of(value: ArrayLike, shape: tuple[int, int]) -> Array:
    """Return a clearance () or (N, m) [m]; refuse a negative one, and any other shape."""
    given = as_array("clearance", value)
    if given.ndim == 0:
        return np.array(finite_float("clearance", given.item(), minimum=0.0))
    clearance = finite_array("clearance", value, shape)
    if (clearance < 0.0).any():
        raise InvalidInputError(f"clearance: got {clearance.min():g}, expected >= 0 for every edge")
    return clearance


def refusals(
    mask: Mask,
    scenes: BarrierSet,
    map_grounds: Sequence[MapGround | None],
    goals: Array,
    starts: Array,
    geometry: Array,
    t: Array,
) -> dict[int, str]:
    """Return scene → why no path leads to its goal, as far as known before a field is computed.

    Args:
        mask: (N,) the scenes that are checked.
        scenes: the barriers of all N scenes.
        map_grounds: the grounds of their maps; None for scenes without a map.
        goals: (N, 2) [m].
        starts: (N, 2) [m].
        geometry: (N, 7) the grids, see `guidance.field`.
        t: (N,) [s].
    """
    x = np.hstack([np.where(np.isfinite(goals), goals, 0.0), np.zeros_like(goals)])
    h = scenes.values(x, t)
    strict = (scenes.priority == 1) & (scenes.kind != layout.SPEED_LIMIT)
    reasons: dict[int, str] = {}
    for n in np.flatnonzero(mask).tolist():
        why = (
            _not_finite("goal", goals[n])
            or _not_finite("start", starts[n])
            or _off_grid("goal", goals[n], geometry[n])
            or _off_grid("start", starts[n], geometry[n])
            or _beside_walls(map_grounds[n], goals[n])
            or _inside(goals[n], h[n], strict[n])
        )
        if why:
            reasons[n] = why
    return reasons


def _not_finite(name: str, point: Array) -> str:
    """Return why a point (2,) is refused unless its coordinates are finite."""
    if np.isfinite(point).all():
        return ""
    return f"{name}: got {point.tolist()}, expected finite numbers"


def _off_grid(name: str, point: Array, geometry: Array) -> str:
    """Return why a point (2,) is refused unless the grid (7,) contains it."""
    cell = np.array(_core.field_to_cells(point[0], point[1], geometry))
    last = geometry[3:5] - 1.0
    if (cell >= -ROUNDING).all() and (cell <= last + ROUNDING).all():
        return ""
    low = fields.to_world(0.0, 0.0, geometry)
    high = fields.to_world(float(last[0]), float(last[1]), geometry)
    return f"{name}: got {point.tolist()}, expected a point within the extent ({low}, {high})"


def _beside_walls(map_ground: MapGround | None, goal: Array) -> str:
    """Return why a goal (2,) is refused unless the body's centre can be there on the map."""
    if map_ground is None:
        return ""
    j, i = _core.field_cell_of(goal[0], goal[1], map_ground.geometry)
    if map_ground.ground.rank[j + 1, i + 1] != 1:  # the ground has a border of one cell
        return ""
    return (
        f"goal: got {goal.tolist()}, too close to {map_ground.name_at(j, i, 1)}, rank 1, "
        f"expected {map_ground.clearance:.3f} m and the class's own margin of room around it"
    )


def _inside(goal: Array, h: Array, strict: Mask) -> str:
    """Return why a goal (2,) is refused if a strict region contains it, by all h (m,) there."""
    entered = np.flatnonzero(strict & (h < 0.0))
    if len(entered) == 0:
        return ""
    k = int(entered[0])
    return (
        f"goal: got {goal.tolist()}, {-h[k]:.3f} m inside the strict region number "
        f"{k + 1}, expected a goal outside every region of rank 1"
    )


def blocked(
    map_ground: MapGround, rank: Ranks, field: Field, start: Array, goal: Array, opened: int
) -> str:
    """Return why a goal (2,) is refused if a closed region of the map is on every path to it."""
    start_cell = _core.field_cell_of(start[0], start[1], map_ground.geometry)
    crossed_rank, j, i = _core.field_crossing(rank, field, *start_cell, opened)
    if crossed_rank == 0:
        return ""
    x, y = fields.to_world(j, i, map_ground.geometry)
    is_strict = crossed_rank == 1
    why = "the body does not fit through there" if is_strict else "it may not be crossed"
    option = f'{{"kind": "geodesic", "through": {crossed_rank}}}'
    remedy = "" if is_strict else f", or guidance={option}"
    return (
        f"goal: got {goal.tolist()}: every path from {start.tolist()} leads through "
        f"{map_ground.name_at(j, i, crossed_rank)}, rank {crossed_rank}, at ({x:.2f}, {y:.2f}), "
        f"and {why}; expected a goal that can be reached{remedy}"
    )
