"""Guidance by geodesic fields, stored for N robots in N scenes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import _core, errors
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers import Barrier, layout
from hcbf_gym.barriers.many import Several, Shapes
from hcbf_gym.barriers.mapped import Mapped, MappedRegion
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, finite_float
from hcbf_gym.guidance import field as fields
from hcbf_gym.guidance import scene_ground, validation
from hcbf_gym.guidance.field import Ground, Pull
from hcbf_gym.guidance.map_ground import MapGround

_Inputs = tuple[MapGround | None, bytes]
"""All that determines a field: the ground of the scene's map, and the bytes of its numbers."""


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
        geometry: (N, 7) the geometry of the grids, see `guidance.field`.
        goal: (N, 2) the goals [m].
        lost: scene → why no path leads to its goal; scenes that are not in it have one.

    Examples:
        >>> from hcbf_gym import guidance, scenarios
        >>> scene = scenarios.make("random")
        >>> guide = guidance.Geodesic()
        >>> guide.reset(scene.barriers, scene.goal, start=scene.start)
        >>> a, b = guide.rows(np.zeros((1, 4)), np.zeros(1))
        >>> a.shape, guide.reachable(np.zeros((1, 4))).tolist()
        ((1, 2), [3])
    """

    period = 0.5  # the time between two computations of a field whose regions move [s]
    pull = Pull()  # the parameters of the row

    def __init__(self, count: int = 1, *, through: int = 0, cell: float = fields.CELL):
        count = errors.count("count", count)
        self._opened = errors.count("through", through, minimum=0)
        self.cell = finite_float("cell", cell, minimum=0.0, exclusive=True)
        self.geometry, self.goal = np.zeros((count, 7)), np.zeros((count, 2))
        self.field = np.zeros((count, 0), dtype=np.float32)
        self.through = np.zeros((count, 0), dtype=np.int8)
        self.zone = np.zeros((count, 0), dtype=np.int8)
        self.lost: dict[int, str] = {}
        self._latest_goal = np.full((count, 2), np.nan)  # for which a field was last sought [m]
        self._scenes: list[BarrierSet | None] = [None] * count  # None before the first reset
        self._map_grounds: list[MapGround | None] = [None] * count
        self._solved_inputs: list[_Inputs | None] = [None] * count
        self._maps: dict[tuple[int, int], Mapped] = {}  # of the latest scenes, see `BarrierSet`
        self._due = np.full(count, np.inf)  # when a field is computed again; inf for never [s]
        self._any_due = False
        self._clearance: Array = np.zeros(())

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
        """Compute the fields of scenes that begin; the arguments are those of `begin`.

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
        strict region, nor from a start outside of them. On a map none leads through a closed
        region. `lost` then states why.

        Args:
            barriers: those of N scenes; a sequence of barriers where N is 1.
            goal: (2,) or (N, 2) [m].
            extent: ((x_min, y_min), (x_max, y_max)) [m] of all scenes, or (N, 2, 2); None for the
                box around start, goal and regions. Where a scene has a map, the map's grid counts.
            clearance: the distance that paths keep from edges [m], such as margin and body radius:
                a number for strict edges, or (N, m) for each edge.
            start: (2,) or (N, 2) [m], which the grid has to cover.
            mask: (N,) the scenes that begin; all unless given.
            t: () or (N,) the present [s].

        Raises:
            InvalidInputError: if a barrier is a user's own, there is no goal, or an array is
                malformed; the fields stay as they were.
        """
        count = len(self.geometry)
        scenes = scene_ground.read_scenes(barriers, count)
        chosen = np.ones(count, dtype=np.bool_) if mask is None else mask
        now = np.array(np.broadcast_to(t, count), dtype=np.float64)
        goals = validation.points("goal", goal, count)
        starts = validation.points("start", start, count)
        known = chosen & np.isfinite(goals + starts).all(axis=1)
        read_clearance = validation.clearance_of(clearance, scenes.kind.shape)
        map_grounds = self._map_grounds_of(known, scenes, read_clearance)
        corners = scene_ground.corners_of(known, scenes, starts, goals, now, extent)
        geometry = self._geometry_of(known, corners, map_grounds)
        refused = validation.refusals(chosen, scenes, map_grounds, goals, starts, geometry, now)

        # nothing has changed up to here: an error leaves all fields as they were
        self._clearance, self._maps = read_clearance, dict(scenes.atlas.held)
        self._latest_goal[chosen], self._due[chosen] = goals[chosen], now[chosen] + self.period
        for n in np.flatnonzero(chosen).tolist():
            self.lost.pop(n, None)
        self.lost |= refused
        fresh = chosen.copy()
        fresh[list(refused)] = False
        for n in np.flatnonzero(fresh).tolist():
            self._scenes[n], self._map_grounds[n] = scenes, map_grounds[n]
        self.goal[fresh], self.geometry[fresh] = goals[fresh], geometry[fresh]
        self._make_room(int((geometry[fresh, 3] * geometry[fresh, 4]).max(initial=0.0)))
        self._solve_fresh(scenes, fresh, starts, now)

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
            scenes: the barriers of all N scenes, as they are now.
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
        within_cell = np.abs(goals - self._latest_goal).max(axis=1) <= cell
        is_lost = np.zeros(len(self.goal), dtype=np.bool_)
        is_lost[list(self.lost)] = True
        retarget = within_cell & ~is_lost  # the row aims at the exact goal, the field is retained
        self.goal[retarget] = goals[retarget]
        again = anew | ~within_cell | (is_lost & (t >= self._due))
        again &= np.isfinite(start).all(axis=1)
        if again.any():
            self.begin(scenes, goals, extent, self._clearance, start=start, mask=again, t=t)

    def lose(self, why: str) -> None:
        """Note why no path is known to any goal."""
        self.lost = dict.fromkeys(range(len(self.goal)), why)
        self._latest_goal[:] = np.nan

    def update(self, t: Array) -> None:
        """Compute anew, at the times t (N,), the fields that are a period old and move."""
        if not self._any_due:  # saves a step some microseconds where no region moves
            return
        due = t >= self._due
        due[list(self.lost)] = False
        if due.any():
            self._due[due] = t[due] + self.period
            self._solve(due, t + 0.5 * self.period)

    def follow(self, scenes: BarrierSet, t: Array) -> None:
        """Compute anew, at the times t (N,), the fields of the scenes whose maps have changed.

        Args:
            scenes: the barriers of all N scenes, their maps on the grids that they had.
            t: (N,) [s].

        Raises:
            InvalidInputError: if a map has another grid; the fields stay as they were.
        """
        if scenes.atlas.held == self._maps:
            return
        self._maps = dict(scenes.atlas.held)
        repainted: dict[tuple[MapGround, tuple[MappedRegion, ...]], MapGround] = {}
        changed: dict[int, MapGround] = {}
        for n, regions in scene_ground.mapped_regions(scenes).items():
            before = self._map_grounds[n]
            if before is None or before.regions == regions:
                continue
            if (before, regions) not in repainted:
                repainted[before, regions] = before.with_regions(regions)
            changed[n] = repainted[before, regions]
        for n, map_ground in changed.items():
            self._scenes[n], self._map_grounds[n] = scenes, map_ground
        mask = np.zeros(len(self.goal), dtype=np.bool_)
        mask[list(changed)] = True
        self._solve(mask, t + np.where(np.isfinite(self._due), 0.5 * self.period, 0.0))

    def rows(self, x: Array, t: Array) -> tuple[Array, Array]:
        """Return a (N, 2) and b (N,) of the rows ``a·u ≥ b`` at N states x (N, 4) and times t (N,).

        At the goal, and where the state is not finite, a row requests nothing: a = 0, b = −1.

        Raises:
            InvalidInputError: before the first reset.
        """
        if None in self._scenes:
            raise InvalidInputError("guidance: there is no scene yet, expected reset() first")
        self.update(t)
        rows = np.zeros((len(x), 3))
        _core.guidance_rows(self.field, self.geometry, self.goal, x, self.pull, rows)
        return rows[:, :2], rows[:, 2]

    def reachable(self, x: Array) -> Integers:
        """Return (N,) through which rank the goal can be reached from the states x (N, 4).

        0: through the open. p > 1: a region of rank p is on every path, or the robot is in one, and
        none of a higher rank has to be entered. 1: a strict region is on every path: not at all.
        """
        reachable, zone = np.empty((2, len(x)))
        _core.guidance_ranks(self.through, self.zone, self.geometry, x, reachable, zone)
        return reachable.astype(np.int64)

    def _map_grounds_of(
        self, mask: Mask, scenes: BarrierSet, clearance: Array
    ) -> list[MapGround | None]:
        """Return the grounds of N scenes' maps, new where masked; scenes of one map share it."""
        grounds = list(self._map_grounds)
        for n in np.flatnonzero(mask).tolist():
            grounds[n] = None
        if not scenes.atlas:
            return grounds
        if clearance.ndim:
            raise InvalidInputError(
                "clearance: got one of each edge (N, m) on a map, expected a number [m]"
            )
        reserved = max(float(clearance), scene_ground.LEAST_CLEARANCE)
        old = [ground for ground in self._map_grounds if ground is not None]
        painted = {ground.regions: ground for ground in old if ground.clearance == reserved}
        for n, regions in scene_ground.mapped_regions(scenes).items():
            if mask[n]:
                if regions not in painted:
                    painted[regions] = MapGround(regions, reserved, self._opened)
                grounds[n] = painted[regions]
        return grounds

    def _geometry_of(
        self, mask: Mask, corners: Array, map_grounds: Sequence[MapGround | None]
    ) -> Array:
        """Return the grids (N, 7), new where masked: the map's, or over the corners (N, 2, 2)."""
        geometry = self.geometry.copy()
        for n in np.flatnonzero(mask).tolist():
            map_ground = map_grounds[n]
            if map_ground is None:
                _core.geometry_over(corners[n], self.cell, geometry[n])
            else:
                geometry[n] = map_ground.geometry
        return geometry

    def _make_room(self, cells: int) -> None:
        """Widen the fields of all scenes to a number of cells, if they have fewer."""
        missing = cells - self.field.shape[1]
        if missing > 0:
            for name in ("field", "through", "zone"):
                setattr(self, name, np.pad(getattr(self, name), ((0, 0), (0, missing))))

    def _solve_fresh(self, scenes: BarrierSet, fresh: Mask, starts: Array, now: Array) -> None:
        """Compute the fields of scenes that begin, and note where no path leads on their maps."""
        velocity = scenes.parameters[..., [layout.VELOCITY_X, layout.VELOCITY_Y]]
        is_region = scenes.kind != layout.SPEED_LIMIT
        moves = (is_region[..., None] & (velocity != 0.0)).any(axis=(1, 2))
        self._due[fresh & ~moves] = np.inf
        solved_for = now + np.where(moves, 0.5 * self.period, 0.0)
        self._solve(fresh, solved_for)
        for n in np.flatnonzero(fresh).tolist():
            map_ground = self._map_grounds[n]
            if map_ground is None:
                continue
            rank = self._ground(n, float(solved_for[n])).rank
            field = fields.grid(self.field[n], map_ground.geometry)
            why = validation.blocked(map_ground, rank, field, starts[n], self.goal[n], self._opened)
            if why:
                self.lost[n], self._due[n] = why, now[n] + self.period
        self._any_due = bool((self._due < np.inf).any())

    def _solve(self, mask: Mask, t: Array) -> None:
        """Compute the masked scenes' fields at the times t (N,); equal scenes share one."""
        first_scene: dict[_Inputs, int] = {}
        for n in np.flatnonzero(mask).tolist():
            numbers = *self._edges(n), t[n], self.goal[n], self.geometry[n]
            inputs = self._map_grounds[n], b"".join(array.tobytes() for array in numbers)
            self._latest_goal[n] = self.goal[n]
            if inputs == self._solved_inputs[n]:
                continue
            self._solved_inputs[n] = inputs
            equal_scene = first_scene.setdefault(inputs, n)
            if equal_scene == n:
                self._march(n, float(t[n]))
            else:
                for array in (self.field, self.through, self.zone):
                    array[n] = array[equal_scene]

    def _march(self, n: int, t: float) -> None:
        """Compute the field of scene n at time t [s], and the zones of its map."""
        grid, goal, map_ground = self.geometry[n], self.goal[n], self._map_grounds[n]
        ground = self._ground(n, t)
        _core.solve_field(*ground, grid, goal, self._opened, self.field[n], self.through[n])
        self.zone[n] = 0
        if map_ground is not None:
            rank = map_ground.ground.rank[1:-1, 1:-1]
            fields.grid(self.zone[n], grid)[:] = np.where(rank > 1, rank, 0)

    def _edges(self, n: int) -> scene_ground.Edges:
        """Return the edges of scene n."""
        scenes = self._scenes[n]
        assert scenes is not None
        return scene_ground.edges_of(scenes, n, self._clearance)

    def _ground(self, n: int, t: float) -> Ground:
        """Return the ground of scene n at time t [s]."""
        grid, map_ground = self.geometry[n], self._map_grounds[n]
        return scene_ground.ground_at(map_ground, self._edges(n), grid, t, self._opened)
