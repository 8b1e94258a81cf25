"""Guidance by geodesic fields, stored for N robots in N scenes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hcbf_gym.barriers import Barrier, layout
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, as_array, finite_array, finite_float
from hcbf_gym.guidance import extent as extents
from hcbf_gym.guidance import field as fields
from hcbf_gym.guidance import row as guidance_row
from hcbf_gym.guidance.row import Pull

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEAST_CLEARANCE = 0.01
"""What strict edges reserve at least: where two of them touch there is no way between [m]."""


class Geodesic:
    """The way to the goal in N scenes, as the guidance row of N states.

    A scene's field is computed when it is reset; where regions move, again after every `period`,
    with the regions where they will be half a period later. Scenes that are equal share one
    computation, and a scene that comes back unchanged needs none.

    Args:
        count: N.
        cell: side of a grid cell [m]; larger in scenes of more than 10⁴ cells.
        period: after which the field of a scene that moves is computed anew [s].
        pull: how the row pulls.

    Raises:
        InvalidInputError: if an argument is out of range.

    Attributes:
        field: (N, capacity) the fields T, flat; see `guidance.field`.
        through: (N, capacity) through which rank the goal can be reached from each cell.
        geometry: (N, 5) of the grids.
        goal: (N, 2) [m].

    Examples:
        >>> from hcbf_gym import guidance, scenarios
        >>> scene = scenarios.make("random")
        >>> way = guidance.Geodesic()
        >>> way.reset(scene.barriers, scene.goal, start=scene.start)
        >>> a, b = way.row(np.zeros(4), 0.0)
        >>> a.shape, way.reachable(np.zeros((1, 4))).tolist()
        ((2,), [3])
    """

    def __init__(
        self,
        count: int = 1,
        *,
        cell: float = extents.CELL,
        period: float = 0.5,
        pull: Pull | None = None,
    ):
        if count < 1:
            raise InvalidInputError(f"count: got {count}, expected >= 1")
        self.cell = finite_float("cell", cell, minimum=0.0, exclusive=True)
        self.period = finite_float("period", period, minimum=0.0, exclusive=True)
        self.pull = Pull() if pull is None else pull
        self.geometry, self.goal = np.zeros((count, 5)), np.zeros((count, 2))
        self.field = np.zeros((count, 0), dtype=np.float32)
        self.through = np.zeros((count, 0), dtype=np.int8)
        self._next = np.full(count, np.inf)
        self._moving = False
        self._set: BarrierSet | None = None
        self._clearance = np.zeros((count, 0))
        self._solved = np.full((count, 0), np.nan)

    def reset(
        self,
        barriers: BarrierSet | Sequence[Barrier],
        goal: ArrayLike,
        extent: ArrayLike | None = None,
        clearance: ArrayLike = 0.0,
        *,
        start: ArrayLike = (0.0, 0.0),
        mask: Mask | None = None,
    ) -> None:
        """Compute the fields of scenes that begin, at time zero.

        Args:
            barriers: of N scenes; a sequence of barriers where N is 1.
            goal: (2,) or (N, 2) [m].
            extent: ((x_min, y_min), (x_max, y_max)) [m] of all scenes, or (N, 2, 2); None for what
                start, goal and regions take up.
            clearance: what the edges reserve [m]: margin, body radius; a number for strict edges,
                or (N, m) for each.
            start: (2,) or (N, 2) [m], which the grid has to cover.
            mask: (N,) the scenes that begin; all unless given.

        Raises:
            InvalidInputError: if a barrier is a user's own, there is no goal, a goal or start lies
                outside the extent, or a goal inside a strict region; the fields stay as they were.
        """
        count = len(self.geometry)
        scenes = barriers if isinstance(barriers, BarrierSet) else BarrierSet([barriers])
        if len(scenes.kind) != count:
            raise InvalidInputError(f"barriers: got {len(scenes.kind)} scenes, expected {count}")
        if (scenes.kind == layout.CUSTOM).any():
            names = sorted({barrier.name for barrier in scenes.own.values()})
            raise InvalidInputError(
                f"guidance: got the barriers {names} of a user's own kind, expected built-in shapes"
            )
        chosen = np.ones(count, dtype=np.bool_) if mask is None else mask
        goals = _points("goal", goal, count)
        starts = _points("start", start, count)
        geometry = self._geometry(chosen, scenes, goals, starts, extent)
        kept = self._clearances(scenes, clearance)
        _check(chosen, scenes, goals, starts, geometry)

        self._set, self._clearance = scenes, kept
        self.goal[chosen], self.geometry[chosen] = goals[chosen], geometry[chosen]
        self._reserve(int((geometry[chosen, 3] * geometry[chosen, 4]).max(initial=0.0)))
        velocity = scenes.parameters[..., [layout.VELOCITY_X, layout.VELOCITY_Y]]
        planar = scenes.kind != layout.SPEED_LIMIT
        moves = (planar[..., None] & (velocity != 0.0)).any(axis=(1, 2))
        self._next[chosen] = np.where(moves, self.period, np.inf)[chosen]
        self._moving = bool((self._next < np.inf).any())
        self._solve(chosen, np.where(moves, 0.5 * self.period, 0.0))

    def update(self, t: Array) -> None:
        """Compute anew, at the times t (N,), the fields that are a period old and move."""
        if not self._moving:  # a step has no microsecond to spare for what never comes
            return
        due = t >= self._next
        if due.any():
            self._next[due] = t[due] + self.period
            self._solve(due, t + 0.5 * self.period)

    def rows(self, x: Array, t: Array) -> tuple[Array, Array]:
        """Return a (N, 2) and b (N,) of the rows ``a·u ≥ b`` at N states x (N, 4) and times t (N,).

        Raises:
            InvalidInputError: before the first reset.
        """
        if self._set is None:
            raise InvalidInputError("guidance: there is no scene yet, expected reset() first")
        self.update(t)
        a, b = np.empty((len(x), 2)), np.empty(len(x))
        guidance_row.rows(self.field, self.geometry, self.goal, x, self.pull, a, b)
        return a, b

    def row(self, x: Array, t: float) -> tuple[Array, float]:
        """Return a (2,) and b of the row at one state x (4,) and time t, where N is 1."""
        a, b = self.rows(np.asarray(x, dtype=np.float64)[None], np.array([t]))
        return a[0], float(b[0])

    def reachable(self, x: Array) -> NDArray[np.int64]:
        """Return (N,) through which rank the goal can be reached from the states x (N, 4).

        0: through the open. p > 1: a region of rank p lies on every way, or the robot stands in
        one, and none of a higher rank has to be entered. 1: a strict region lies on every way, so
        not at all.
        """
        return np.array(
            [
                guidance_row.reachable(self.through[n], self.geometry[n], x[n, 0], x[n, 1])
                for n in range(len(x))
            ],
            dtype=np.int64,
        )

    def _geometry(
        self, mask: Mask, scenes: BarrierSet, goal: Array, start: Array, extent: ArrayLike | None
    ) -> Array:
        """Return (N, 5) the grids, new where masked."""
        count = len(goal)
        corners = np.empty((count, 2, 2))
        if extent is None:
            for n in np.flatnonzero(mask):
                extents.scene_extent(
                    scenes.kind[n], scenes.parameters[n], scenes.priority[n], start[n], goal[n],
                    corners[n],
                )  # fmt: skip
        else:
            shape = (count, 2, 2) if as_array("extent", extent).ndim == 3 else (2, 2)
            corners[:] = finite_array("extent", extent, shape)
            if (corners[:, 0] >= corners[:, 1]).any():
                raise InvalidInputError(
                    f"extent: got {corners.tolist()}, expected ((x_min, y_min), (x_max, y_max))"
                )
        geometry = self.geometry.copy()
        for n in np.flatnonzero(mask):
            extents.geometry_of(corners[n], self.cell, geometry[n])
        return geometry

    def _clearances(self, scenes: BarrierSet, clearance: ArrayLike) -> Array:
        """Return (N, m) what each edge reserves."""
        given = as_array("clearance", clearance)
        if given.ndim == 0:
            kept = scenes.keeps_margin * finite_float("clearance", given.item(), minimum=0.0)
        else:
            kept = finite_array("clearance", given, scenes.kind.shape)
        return np.maximum(kept, scenes.keeps_margin * LEAST_CLEARANCE)

    def _reserve(self, cells: int) -> None:
        """Make room for fields of so many cells, retaining those that there are."""
        missing = cells - self.field.shape[1]
        if missing > 0:
            self.field = np.pad(self.field, ((0, 0), (0, missing)))
            self.through = np.pad(self.through, ((0, 0), (0, missing)))

    def _solve(self, mask: Mask, t: Array) -> None:
        """Compute the masked scenes' fields at the times t (N,), none of them twice."""
        scenes = self._set
        assert scenes is not None
        parts = (
            scenes.kind, scenes.parameters, scenes.priority, self._clearance, t, self.goal,
            self.geometry,
        )  # fmt: skip
        at = np.flatnonzero(mask)
        asked = np.column_stack([part[at].reshape(len(at), -1) for part in parts])
        if asked.shape[1] != self._solved.shape[1]:  # another number of barriers
            self._solved = np.full((len(mask), asked.shape[1]), np.nan)
        new = (asked != self._solved[at]).any(axis=1)
        if not new.any():
            return
        at, asked = at[new], asked[new]
        self._solved[at] = asked
        first: dict[bytes, int] = {}
        source = [first.setdefault(row.tobytes(), n) for row, n in zip(asked, at, strict=True)]
        todo = np.zeros_like(mask)
        todo[source] = True
        fields.solve_batch(todo, *parts, self.field, self.through)
        alike = at != source
        to, of = at[alike], np.array(source)[alike]
        self.field[to], self.through[to] = self.field[of], self.through[of]


def _points(name: str, value: ArrayLike | None, count: int) -> Array:
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


def _check(mask: Mask, scenes: BarrierSet, goal: Array, start: Array, geometry: Array) -> None:
    """Refuse goals and starts that no field can serve.

    Raises:
        InvalidInputError: if one lies outside its grid, or a goal inside a strict region.
    """
    x = np.hstack([goal, np.zeros_like(goal)])
    h = scenes.values(x, np.zeros(len(x)))
    strict = (scenes.priority == 1) & (scenes.kind != layout.SPEED_LIMIT)
    inside = mask[:, None] & strict & (h < 0.0)
    if inside.any():
        n, k = np.argwhere(inside)[0].tolist()
        raise InvalidInputError(
            f"goal: got {goal[n].tolist()}, {-h[n, k]:.3f} m inside the strict region number "
            f"{k + 1}, expected a goal outside every region of rank 1"
        )
    low = geometry[:, :2]
    high = low + geometry[:, 2:3] * (geometry[:, [4, 3]] - 1.0)
    for name, point in (("goal", goal), ("start", start)):
        outside = mask & ((point < low - 1e-9) | (point > high + 1e-9)).any(axis=1)
        if outside.any():
            n = int(np.argmax(outside))
            raise InvalidInputError(
                f"{name}: got {point[n].tolist()}, expected a point within the extent "
                f"({low[n].tolist()}, {high[n].tolist()})"
            )
