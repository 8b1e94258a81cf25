"""Guidance by geodesic fields, stored for N robots in N scenes."""

from collections.abc import Sequence
from operator import itemgetter

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import _core, errors
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers import Barrier, layout
from hcbf_gym.barriers.many import Several, Shapes
from hcbf_gym.barriers.mapped import Mapped, MappedRegion
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, as_array, finite_array, finite_float, reals
from hcbf_gym.guidance import field as fields
from hcbf_gym.guidance import validation
from hcbf_gym.guidance.field import Ground, Pull, open_ground
from hcbf_gym.guidance.map_ground import MapGround
from hcbf_gym.models.constants import FARTHEST

LEAST_CLEARANCE = 0.01
"""What strict edges reserve at least: where two of them touch no path leads between [m]."""

_Inputs = tuple[MapGround | None, bytes]
"""What a field follows from: the ground of the scene's map, and all the numbers of the scene."""


class Geodesic:
    """The shortest paths to the goal in N scenes, as the guidance row of N states.

    A scene's field is computed when it is reset, when its goal moves by more than a cell, and when
    the cells of its map change; where regions move, again after every `period`, with the regions
    where they will be half a period later. Scenes that are equal share one computation, and a scene
    that comes back unchanged needs none. Where a scene has a map, the field's cells are the map's.

    Args:
        count: N.
        through: ranks from it on may be crossed at their price, above 1; 0 for none. All others
            are crossed only where no other path is left, see `guidance.field`.
        cell: side of a grid cell [m]; larger in scenes of more than 10⁴ cells.

    Raises:
        InvalidInputError: if an argument is out of range.

    Attributes:
        field: (N, capacity) the fields T, flat; see `guidance.field`.
        through: (N, capacity) through which rank the goal can be reached from each cell.
        zone: (N, capacity) the rank of the map's zone that a cell is in, 0 in none or rank 1.
        geometry: (N, 7) of the grids, see `guidance.field`.
        goal: (N, 2) [m].
        lost: scene → why no path leads to its goal; scenes that are not in it have one.

    Examples:
        >>> from hcbf_gym import guidance, scenarios
        >>> scene = scenarios.make("random")
        >>> way = guidance.Geodesic()
        >>> way.reset(scene.barriers, scene.goal, start=scene.start)
        >>> a, b = way.rows(np.zeros((1, 4)), np.zeros(1))
        >>> a.shape, way.reachable(np.zeros((1, 4))).tolist()
        ((1, 2), [3])
    """

    period = 0.5
    pull = Pull()

    def __init__(self, count: int = 1, *, through: int = 0, cell: float = fields.CELL):
        count = errors.count("count", count)
        self._opened = errors.count("through", through, minimum=0)
        self.cell = finite_float("cell", cell, minimum=0.0, exclusive=True)
        self.geometry, self.goal = np.zeros((count, 7)), np.zeros((count, 2))
        self.field = np.zeros((count, 0), dtype=np.float32)
        self.through = np.zeros((count, 0), dtype=np.int8)
        self.zone = np.zeros((count, 0), dtype=np.int8)
        self.lost: dict[int, str] = {}
        self._aim = np.full((count, 2), np.nan)  # the goals that were looked at last [m]
        self._scenes: list[BarrierSet | None] = [None] * count  # with which fields are computed
        self._grounds: list[MapGround | None] = [None] * count
        self._solved: list[_Inputs | None] = [None] * count
        self._held: dict[tuple[int, int], Mapped] = {}
        self._next = np.full(count, np.inf)
        self._moving = False
        self._clearance: ArrayLike = 0.0

    def reset(
        self,
        barriers: BarrierSet | Sequence[Barrier | Shapes | Several],
        goal: ArrayLike,
        extent: ArrayLike | None = None,
        clearance: ArrayLike = 0.0,
        *,
        start: ArrayLike = (0.0, 0.0),
        mask: Mask | None = None,
        t: ArrayLike = 0.0,
    ) -> None:
        """Compute the fields of scenes that begin.

        Args: as `begin` takes them.

        Raises:
            InvalidInputError: as `begin` does; or if no path leads from a start to its goal.
        """
        chosen = np.ones(len(self.goal), dtype=np.bool_) if mask is None else mask
        self.begin(barriers, goal, extent, clearance, start=start, mask=chosen, t=t)
        for n in np.flatnonzero(chosen).tolist():
            if n in self.lost:
                raise InvalidInputError(self.lost[n])

    def begin(
        self,
        barriers: BarrierSet | Sequence[Barrier | Shapes | Several],
        goal: ArrayLike | None,
        extent: ArrayLike | None = None,
        clearance: ArrayLike = 0.0,
        *,
        start: ArrayLike = (0.0, 0.0),
        mask: Mask | None = None,
        t: ArrayLike = 0.0,
    ) -> None:
        """Compute the fields of scenes that begin, or whose goals have moved.

        No path leads to a goal that is not finite, outside the extent or the map, or inside a
        strict region, nor from a start outside of them; on a map, nor where a closed region is on
        every path. `lost` then states why.

        Args:
            barriers: of N scenes; a sequence of barriers where N is 1.
            goal: (2,) or (N, 2) [m].
            extent: ((x_min, y_min), (x_max, y_max)) [m] of all scenes, or (N, 2, 2); None for what
                start, goal and regions take up. Where a scene has a map, the map's grid counts.
            clearance: what the edges reserve [m]: margin, body radius; a number for strict edges,
                or (N, m) for each.
            start: (2,) or (N, 2) [m], which the grid has to cover.
            mask: (N,) of which scenes; all unless given.
            t: () or (N,) the present [s].

        Raises:
            InvalidInputError: if a barrier is a user's own, there is no goal, or an array is
                malformed; the fields stay as they were.
        """
        count = len(self.geometry)
        scenes = _read(barriers, count)
        chosen = np.ones(count, dtype=np.bool_) if mask is None else mask
        now = np.array(np.broadcast_to(t, count), dtype=np.float64)
        goals = validation.points("goal", goal, count)
        starts = validation.points("start", start, count)
        known = chosen & np.isfinite(goals + starts).all(axis=1)
        grounds = self._grounds_of(known, scenes, clearance)
        geometry = self._geometry(known, scenes, (goals, starts, now), extent, grounds)
        reserved = reals("clearance", clearance)
        if reserved.ndim == 0:
            finite_float("clearance", reserved.item(), minimum=0.0)
        else:
            finite_array("clearance", reserved, scenes.kind.shape)
        refused = validation.refusals(chosen, scenes, grounds, (goals, starts, geometry), now)

        self._clearance, self._held = clearance, dict(scenes.atlas.held)
        self._aim[chosen], self._next[chosen] = goals[chosen], now[chosen] + self.period
        for n in np.flatnonzero(chosen).tolist():
            self.lost.pop(n, None)
        self.lost |= refused
        fresh = chosen.copy()
        fresh[list(refused)] = False
        for n in np.flatnonzero(fresh).tolist():
            self._scenes[n], self._grounds[n] = scenes, grounds[n]
        self.goal[fresh], self.geometry[fresh] = goals[fresh], geometry[fresh]
        self._make_room(int((geometry[fresh, 3] * geometry[fresh, 4]).max(initial=0.0)))
        self._solve_fresh(scenes, fresh, starts, now)

    def _make_room(self, cells: int) -> None:
        """Widen the fields of all scenes to a number of cells, if they have fewer."""
        missing = cells - self.field.shape[1]
        for name in ("field", "through", "zone") if missing > 0 else ():
            setattr(self, name, np.pad(getattr(self, name), ((0, 0), (0, missing))))

    def _solve_fresh(self, scenes: BarrierSet, fresh: Mask, start: Array, now: Array) -> None:
        """Compute the fields of scenes that begin, and note where no path leads on their maps."""
        velocity = scenes.parameters[..., [layout.VELOCITY_X, layout.VELOCITY_Y]]
        planar = scenes.kind != layout.SPEED_LIMIT
        moves = (planar[..., None] & (velocity != 0.0)).any(axis=(1, 2))
        self._next[fresh & ~moves] = np.inf
        later = now + np.where(moves, 0.5 * self.period, 0.0)
        self._solve(fresh, later)
        for n in np.flatnonzero(fresh).tolist():
            why = self._blocked(n, start[n], float(later[n]))
            if why:
                self.lost[n], self._next[n] = why, now[n] + self.period
        self._moving = bool((self._next < np.inf).any())

    def pursue(
        self,
        scenes: BarrierSet,
        goal: ArrayLike | None,
        extent: ArrayLike | None,
        start: Array,
        t: Array,
        anew: bool = False,
    ) -> None:
        """Compute anew the fields of goals that have moved by more than a cell.

        A scene without a path to its goal is tried again after every `period`.

        Args:
            scenes: of all N, as they are now.
            goal: (2,) or (N, 2), where the goals are now [m].
            extent: as `begin` takes it.
            start: (N, 2) where the robots are [m]; NaN where that is not known.
            t: (N,) [s].
            anew: whether all fields are computed anew.

        Raises:
            InvalidInputError: as `begin` does.
        """
        goals = validation.points("goal", goal, len(self.goal))
        cell = np.maximum(self.geometry[:, 2], self.cell)
        near = np.abs(goals - self._aim).max(axis=1) <= cell
        again = anew | ~near
        for n in self.lost:
            again[n] |= bool(t[n] >= self._next[n])
        again &= np.isfinite(start).all(axis=1)
        led = near.copy()
        led[list(self.lost)] = False
        self.goal[led] = goals[led]
        if again.any():
            self.begin(scenes, goals, extent, self._clearance, start=start, mask=again, t=t)

    def lose(self, why: str) -> None:
        """Note why no path is known to any goal."""
        self.lost = dict.fromkeys(range(len(self.goal)), why)
        self._aim[:] = np.nan

    def update(self, t: Array) -> None:
        """Compute anew, at the times t (N,), the fields that are a period old and move."""
        if not self._moving:  # a step has no microsecond to spare for what never comes
            return
        due = t >= self._next
        due[list(self.lost)] = False
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
        for n in np.flatnonzero(changed).tolist():
            self._scenes[n], self._grounds[n] = scenes, grounds[n]
        self._solve(changed, t + np.where(np.isfinite(self._next), 0.5 * self.period, 0.0))

    def rows(self, x: Array, t: Array) -> tuple[Array, Array]:
        """Return a (N, 2) and b (N,) of the rows ``a·u ≥ b`` at N states x (N, 4) and times t (N,).

        At the goal, and where the state is not finite, a row requests nothing: a = 0, b = −1.

        Raises:
            InvalidInputError: before the first reset.
        """
        if None in self._scenes:
            raise InvalidInputError("guidance: there is no scene yet, expected reset() first")
        self.update(t)
        out = np.zeros((len(x), 3))
        _core.guidance_rows(self.field, self.geometry, self.goal, x, self.pull, out)
        return out[:, :2], out[:, 2]

    def reachable(self, x: Array) -> Integers:
        """Return (N,) through which rank the goal can be reached from the states x (N, 4).

        0: through the open. p > 1: a region of rank p is on every path, or the robot is in one, and
        none of a higher rank has to be entered. 1: a strict region is on every path: not at all.
        """
        reachable, zone = np.empty((2, len(x)))
        _core.guidance_ranks(self.through, self.zone, self.geometry, x, reachable, zone)
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
                _core.scene_extent(
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
                _core.geometry_over(corners[n], self.cell, geometry[n])
            else:
                geometry[n] = ground.geometry
        return geometry

    def _solve(self, mask: Mask, t: Array) -> None:
        """Compute the masked scenes' fields at the times t (N,), none of them twice."""
        first: dict[_Inputs, int] = {}
        for n in np.flatnonzero(mask).tolist():
            base, parts = self._grounds[n], self._parts(n)
            numbers = *parts, t[n], self.goal[n], self.geometry[n]
            inputs = base, b"".join(part.tobytes() for part in numbers)
            self._aim[n] = self.goal[n]
            if inputs == self._solved[n]:
                continue
            self._solved[n] = inputs
            of = first.setdefault(inputs, n)
            if of != n:
                for array in (self.field, self.through, self.zone):
                    array[n] = array[of]
                continue
            where = self.geometry[n], self.goal[n], self._opened
            ground = self._ground(n, float(t[n]))
            _core.solve_field(*ground, *where, self.field[n], self.through[n])
            self.zone[n] = 0
            if base is not None:
                rank = base.ground.rank[1:-1, 1:-1]
                fields.grid(self.zone[n], base.geometry)[:] = np.where(rank > 1, rank, 0)

    def _parts(self, n: int) -> tuple[Integers, Array, Integers, Array]:
        """Return kind, parameters, priority and clearance of a scene's edges."""
        scenes = self._scenes[n]
        assert scenes is not None
        keeps, given = scenes.keeps_margin[n], np.asarray(self._clearance)
        kept = np.maximum(given[n] if given.ndim else keeps * given, keeps * LEAST_CLEARANCE)
        return scenes.kind[n], scenes.parameters[n], scenes.priority[n], kept

    def _ground(self, n: int, t: float) -> Ground:
        """Return what a scene's field walks on at time t: the map's ground, with its barriers."""
        base, parts, geometry = self._grounds[n], self._parts(n), self.geometry[n]
        if base is None:
            ground = open_ground(int(geometry[3]), int(geometry[4]), geometry[2])
        elif not (parts[0] < layout.SPEED_LIMIT).any():
            return base.ground
        else:
            ground = Ground(base.ground.cost.copy(), base.ground.rank.copy())
        _core.paint_barriers(*ground, geometry, *parts, t, self._opened)
        return ground

    def _blocked(self, n: int, start: Array, t: float) -> str:
        """Return why no path leads from the start to the goal on a map; "" where one does."""
        base = self._grounds[n]
        if base is None:
            return ""
        field = fields.grid(self.field[n], base.geometry)
        at = _core.field_cell_of(start[0], start[1], base.geometry)
        rank, j, i = _core.field_crossing(self._ground(n, t).rank, field, *at, self._opened)
        if rank == 0:
            return ""
        x, y = fields.to_world(j, i, base.geometry)
        what = "the body does not fit through there" if rank == 1 else "it may not be crossed"
        remedy = f', or guidance={{"kind": "geodesic", "through": {rank}}}' if rank > 1 else ""
        return (
            f"goal: got {self.goal[n].tolist()}: every path from {start.tolist()} leads through "
            f"{base.name_at(j, i, rank)}, rank {rank}, at ({x:.2f}, {y:.2f}), and {what}; "
            f"expected a goal that can be reached{remedy}"
        )


def _read(barriers: BarrierSet | Sequence[Barrier | Shapes | Several], count: int) -> BarrierSet:
    """Return N scenes of built-in barriers.

    Raises:
        InvalidInputError: if there are others, or another number of scenes.
    """
    scenes = barriers if isinstance(barriers, BarrierSet) else BarrierSet([barriers])
    if len(scenes.kind) != count:
        raise InvalidInputError(f"barriers: got {len(scenes.kind)} scenes, expected {count}")
    if (scenes.kind == layout.CUSTOM).any():
        names = sorted({barrier.name for barrier in scenes.own.values()})
        raise InvalidInputError(
            f"guidance: got the barriers {names} of a user's own kind, expected built-in shapes"
        )
    return scenes


def _regions_of(scenes: BarrierSet) -> dict[int, tuple[MappedRegion, ...]]:
    """Return scene → the classes of its map that are regions, for scenes that have one."""
    found: dict[int, list[MappedRegion]] = {}
    for (n, _), one in sorted(scenes.atlas.held.items(), key=itemgetter(0)):
        if isinstance(one, MappedRegion):
            found.setdefault(n, []).append(one)
    return {n: tuple(regions) for n, regions in found.items()}
