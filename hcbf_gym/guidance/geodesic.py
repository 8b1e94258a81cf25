"""Guidance by geodesic fields, stored for N robots in N scenes."""

from collections.abc import Sequence
from operator import itemgetter

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers import Barrier, layout
from hcbf_gym.barriers.many import Several, Shapes
from hcbf_gym.barriers.mapped import Mapped, MappedRegion
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, as_array, finite_array, finite_float
from hcbf_gym.guidance import extent as extents
from hcbf_gym.guidance import field as fields
from hcbf_gym.guidance import row as guidance_row
from hcbf_gym.guidance import validation
from hcbf_gym.guidance.ground import Ground, open_ground, paint_barriers
from hcbf_gym.guidance.map_ground import MapGround
from hcbf_gym.guidance.row import Pull
from hcbf_gym.models.constants import FARTHEST

LEAST_CLEARANCE = 0.01
"""What strict edges reserve at least: where two of them touch no path leads between [m]."""

_Question = tuple[MapGround | None, bytes]
"""What a field answers: the ground of the scene's map, and all the numbers of the scene."""


class Geodesic:
    """The shortest paths to the goal in N scenes, as the guidance row of N states.

    A scene's field is computed when it is reset, and when the cells of its map change; where
    regions move, again after every `period`, with the regions where they will be half a period
    later. Scenes that are equal share one computation, and a scene that comes back unchanged needs
    none. Where a scene has a map, the field's cells are the map's.

    Args:
        count: N.
        through: ranks from it on may be crossed at their price, above 1; 0 for none. All others
            are crossed only where no other path is left, see `march`.
        cell: side of a grid cell [m]; larger in scenes of more than 10⁴ cells.
        period: after which the field of a scene that moves is computed anew [s].
        pull: how the row pulls.

    Raises:
        InvalidInputError: if an argument is out of range.

    Attributes:
        field: (N, capacity) the fields T, flat; see `guidance.field`.
        through: (N, capacity) through which rank the goal can be reached from each cell.
        zone: (N, capacity) the rank of the map's zone that a cell lies in, 0 in none or rank 1.
        geometry: (N, 7) of the grids, see `guidance.field`.
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
        through: int = 0,
        cell: float = extents.CELL,
        period: float = 0.5,
        pull: Pull | None = None,
    ):
        if count < 1:
            raise InvalidInputError(f"count: got {count}, expected >= 1")
        self.cell = finite_float("cell", cell, minimum=0.0, exclusive=True)
        self.period = finite_float("period", period, minimum=0.0, exclusive=True)
        self.pull = Pull() if pull is None else pull
        self.geometry, self.goal = np.zeros((count, 7)), np.zeros((count, 2))
        self.field = np.zeros((count, 0), dtype=np.float32)
        self.through = np.zeros((count, 0), dtype=np.int8)
        self.zone = np.zeros((count, 0), dtype=np.int8)
        self._opened = through
        self._grounds: list[MapGround | None] = [None] * count
        self._solved: list[_Question | None] = [None] * count
        self._held: dict[tuple[int, int], Mapped] = {}
        self._next = np.full(count, np.inf)
        self._moving = False
        self._set: BarrierSet | None = None
        self._asked: ArrayLike = 0.0  # what edges reserve [m]
        self._clearance = np.zeros((count, 0))  # of the scenes whose fields were computed last

    def reset(
        self,
        barriers: BarrierSet | Sequence[Barrier | Shapes | Several],
        goal: ArrayLike,
        extent: ArrayLike | None = None,
        clearance: ArrayLike = 0.0,
        *,
        start: ArrayLike = (0.0, 0.0),
        mask: Mask | None = None,
        time: ArrayLike = 0.0,
    ) -> None:
        """Compute the fields of scenes that begin.

        Args:
            barriers: of N scenes; a sequence of barriers where N is 1.
            goal: (2,) or (N, 2) [m].
            extent: ((x_min, y_min), (x_max, y_max)) [m] of all scenes, or (N, 2, 2); None for what
                start, goal and regions take up. Where a scene has a map, the map's grid counts.
            clearance: what the edges reserve [m]: margin, body radius; a number for strict edges,
                or (N, m) for each.
            start: (2,) or (N, 2) [m], which the grid has to cover.
            mask: (N,) the scenes that begin; all unless given.
            time: () or (N,) at which they do [s].

        Raises:
            InvalidInputError: if a barrier is a user's own, there is no goal, a goal or start lies
                outside the extent or the map, or a goal inside a strict region; the fields stay as
                they were. On a map, too, if no path leads from the start to the goal; the message
                says what lies on it.
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
        goals = validation.points("goal", goal, count)
        starts = validation.points("start", start, count)
        grounds = self._grounds_of(chosen, scenes, clearance)
        begun_at = np.array(np.broadcast_to(time, count), dtype=np.float64)
        geometry = self._geometry(chosen, scenes, (goals, starts, begun_at), extent, grounds)
        self._clearances(scenes, clearance)  # fit
        validation.check_extent(chosen, goals, starts, geometry)
        validation.check_on_maps(chosen, grounds, goals)
        validation.check_goal(chosen, scenes, goals, begun_at)

        self._set, self._grounds, self._asked = scenes, grounds, clearance
        self._held = dict(scenes.atlas.held)
        self.goal[chosen], self.geometry[chosen] = goals[chosen], geometry[chosen]
        self._reserve(int((geometry[chosen, 3] * geometry[chosen, 4]).max(initial=0.0)))
        velocity = scenes.parameters[..., [layout.VELOCITY_X, layout.VELOCITY_Y]]
        planar = scenes.kind != layout.SPEED_LIMIT
        moves = (planar[..., None] & (velocity != 0.0)).any(axis=(1, 2))
        self._next[chosen] = np.where(moves, begun_at + self.period, np.inf)[chosen]
        self._moving = bool((self._next < np.inf).any())
        t = begun_at + np.where(moves, 0.5 * self.period, 0.0)
        self._solve(chosen, t)
        for n in np.flatnonzero(chosen).tolist():
            self._refuse(n, starts[n], float(t[n]))

    def update(self, t: Array) -> None:
        """Compute anew, at the times t (N,), the fields that are a period old and move."""
        if not self._moving:  # a step has no microsecond to spare for what never comes
            return
        due = t >= self._next
        if due.any():
            self._next[due] = t[due] + self.period
            self._solve(due, t + 0.5 * self.period)

    def follow(self, scenes: BarrierSet, t: Array) -> None:
        """Compute anew, at the times t (N,), the fields of the scenes whose maps have changed.

        Args:
            scenes: of all N, their maps on the grids that they had.
            t: (N,) [s].

        Raises:
            InvalidInputError: if a map has another grid; the fields stay as they were.
        """
        held = scenes.atlas.held
        if held == self._held:
            return
        self._held = dict(held)
        grounds = list(self._grounds)
        changed = np.zeros(len(self.goal), dtype=np.bool_)
        followed: dict[tuple[int, ...], MapGround] = {}
        for n, regions in _regions_of(scenes).items():
            ground = grounds[n]
            if ground is None or ground.regions == regions:
                continue
            key = id(ground), *map(id, regions)
            if key not in followed:
                followed[key] = ground.with_regions(regions)
            grounds[n] = followed[key]
            changed[n] = True
        self._set, self._grounds = scenes, grounds
        self._solve(changed, t + np.where(np.isfinite(self._next), 0.5 * self.period, 0.0))

    def rows(self, x: Array, t: Array) -> tuple[Array, Array]:
        """Return a (N, 2) and b (N,) of the rows ``a·u ≥ b`` at N states x (N, 4) and times t (N,).

        Raises:
            InvalidInputError: before the first reset.
        """
        if self._set is None:
            raise InvalidInputError("guidance: there is no scene yet, expected reset() first")
        self.update(t)
        out = np.zeros((len(x), 3))
        guidance_row.rows(self.field, self.geometry, self.goal, x, self.pull, out)
        return out[:, :2], out[:, 2]

    def row(self, x: Array, t: float) -> tuple[Array, float]:
        """Return a (2,) and b of the row at one state x (4,) and time t, where N is 1."""
        a, b = self.rows(np.asarray(x, dtype=np.float64)[None], np.array([t]))
        return a[0], float(b[0])

    def reachable(self, x: Array) -> Integers:
        """Return (N,) through which rank the goal can be reached from the states x (N, 4).

        0: through the open. p > 1: a region of rank p lies on every path, or the robot stands in
        one, and none of a higher rank has to be entered. 1: a strict region lies on every path, so
        not at all.
        """
        reachable, zone = np.empty((2, len(x)))
        guidance_row.ranks_at(self.through, self.zone, self.geometry, x, reachable, zone)
        return reachable.astype(np.int64)

    def _grounds_of(
        self, mask: Mask, scenes: BarrierSet, clearance: ArrayLike
    ) -> list[MapGround | None]:
        """Return the grounds of N scenes' maps, new where masked; scenes of one map share it."""
        grounds = [None if new else g for new, g in zip(mask, self._grounds, strict=True)]
        if not scenes.atlas:
            return grounds
        kept = max(finite_float("clearance", clearance, minimum=0.0), LEAST_CLEARANCE)
        known = {g.regions: g for g in self._grounds if g is not None and g.clearance == kept}
        for n, regions in _regions_of(scenes).items():
            if mask[n]:
                if regions not in known:
                    known[regions] = MapGround(regions, kept, self._opened)
                grounds[n] = known[regions]
        return grounds

    def _geometry(
        self,
        mask: Mask,
        scenes: BarrierSet,
        world: tuple[Array, Array, Array],
        extent: ArrayLike | None,
        grounds: Sequence[MapGround | None],
    ) -> Array:
        """Return (N, 7) the grids, new where masked; the world is goals, starts and times."""
        goal, start, time = world
        count = len(goal)
        corners = np.empty((count, 2, 2))
        if extent is None:
            for n in np.flatnonzero(mask).tolist():
                extents.scene_extent(
                    scenes.kind[n], scenes.parameters[n], scenes.priority[n], start[n], goal[n],
                    time[n], corners[n],
                )  # fmt: skip
        else:
            shape = (count, 2, 2) if as_array("extent", extent).ndim == 3 else (2, 2)
            corners[:] = finite_array("extent", extent, shape, largest=FARTHEST)
            if (corners[:, 0] >= corners[:, 1]).any():
                raise InvalidInputError(
                    f"extent: got {corners.tolist()}, expected ((x_min, y_min), (x_max, y_max))"
                )
        geometry = self.geometry.copy()
        for n in np.flatnonzero(mask).tolist():
            ground = grounds[n]
            if ground is None:
                extents.geometry_over(corners[n], self.cell, geometry[n])
            else:
                geometry[n] = ground.geometry
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
            self.zone = np.pad(self.zone, ((0, 0), (0, missing)))

    def _solve(self, mask: Mask, t: Array) -> None:
        """Compute the masked scenes' fields at the times t (N,), none of them twice."""
        scenes = self._set
        assert scenes is not None
        self._clearance = self._clearances(scenes, self._asked)  # there may be others than before
        parts = (
            scenes.kind, scenes.parameters, scenes.priority, self._clearance, t, self.goal,
            self.geometry,
        )  # fmt: skip
        first: dict[_Question, int] = {}
        for n in np.flatnonzero(mask).tolist():
            base = self._grounds[n]
            question = base, b"".join(part[n].tobytes() for part in parts)
            if question == self._solved[n]:
                continue
            self._solved[n] = question
            of = first.setdefault(question, n)
            if of != n:
                for array in (self.field, self.through, self.zone):
                    array[n] = array[of]
                continue
            ground = self._ground(n, float(t[n]))
            place = self.geometry[n], self.goal[n], self._opened
            fields.solve(ground, *place, self.field[n], self.through[n])
            self.zone[n] = 0
            if base is not None:
                rank = base.ground.rank[1:-1, 1:-1]
                fields.grid(self.zone[n], base.geometry)[:] = np.where(rank > 1, rank, 0)

    def _ground(self, n: int, t: float) -> Ground:
        """Return what a scene's field walks on at time t: the map's ground, with its barriers."""
        base, scenes, geometry = self._grounds[n], self._set, self.geometry[n]
        assert scenes is not None
        if base is None:
            ground = open_ground(int(geometry[3]), int(geometry[4]), geometry[2])
        elif not scenes.is_region[n].any():
            return base.ground
        else:
            ground = Ground(base.ground.cost.copy(), base.ground.rank.copy())
        paint_barriers(
            ground, geometry, scenes.kind[n], scenes.parameters[n], scenes.priority[n],
            self._clearance[n], t, self._opened,
        )  # fmt: skip
        return ground

    def _refuse(self, n: int, start: Array, t: float) -> None:
        """Refuse a scene on a map where no path leads from the start to the goal.

        Raises:
            InvalidInputError: if there is none; the message says what lies on the cheapest.
        """
        base = self._grounds[n]
        if base is None:
            return
        field = fields.grid(self.field[n], base.geometry)
        at = fields.cell_of(start[0], start[1], base.geometry)
        rank, j, i = fields.crossing(self._ground(n, t).rank, field, *at, self._opened)
        if rank > 0:
            x, y = fields.to_world(j, i, base.geometry)
            what = "the body does not fit through there" if rank == 1 else "it may not be crossed"
            remedy = "" if rank == 1 else f", or guidance with through={rank}"
            raise InvalidInputError(
                f"goal: got {self.goal[n].tolist()}: every way from {start.tolist()} leads through "
                f"{base.name_at(j, i, rank)}, rank {rank}, at ({x:.2f}, {y:.2f}), and {what}; "
                f"expected a goal that can be reached{remedy}"
            )


def _regions_of(scenes: BarrierSet) -> dict[int, tuple[MappedRegion, ...]]:
    """Return scene → the classes of its map that are regions, for scenes that have one."""
    found: dict[int, list[MappedRegion]] = {}
    for (n, _), one in sorted(scenes.atlas.held.items(), key=itemgetter(0)):
        if isinstance(one, MappedRegion):
            found.setdefault(n, []).append(one)
    return {n: tuple(regions) for n, regions in found.items()}
