"""The filter of N planar double integrators: one compiled call a step."""

import operator
from collections.abc import Sequence

import numpy as np

from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers import braking
from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.convexity import warn_of_concave
from hcbf_gym.barriers.general_kernels import LEANING, MARGIN, PLACED, WIDTH
from hcbf_gym.barriers.own_rows import usual, write_own_row
from hcbf_gym.barriers.relative_degree import Reach
from hcbf_gym.barriers.rows import B
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.unknown import Known
from hcbf_gym.errors import UNREADABLE, CoverageWarning, InvalidInputError, warn_caller
from hcbf_gym.filtering.core import FilterCore, SceneArrays
from hcbf_gym.filtering.guide import Guide
from hcbf_gym.filtering.settings import FilterSettings
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Coverage, Estimate, Plant, Reason


class PlanarCore(FilterCore):
    """The filter of N planar double integrators, in compiled code.

    A solver by name takes the place of the compiled program alone: what is believed, the rows and
    the verdict are the same.

    Args: as `FilterCore` takes them; U is planar.
    """

    def __init__(
        self,
        plant: Plant,
        input_set: InputSet,
        settings: FilterSettings,
        batch: int | None = None,
        threads: int = 1,
    ):
        super().__init__(plant, input_set, settings, batch, threads)
        self._guide = Guide(
            settings.guidance,
            self.count,
            0.0 if plant.axle is None else plant.axle.look_ahead,
            self.cell,
        )
        self._constants["has_way"] = self._guide.guides
        self._constants["through"] = self._guide.through
        self._guides_by_row = bool(self._constants["guided"][0]) and self._guide.guides
        self._no_rows: Array = np.zeros((0, 0, WIDTH + 2))
        self._own_rows = self._no_rows
        self._checked: tuple[Barrier, ...] = ()
        self._said: set[str] = set()
        self._read_static()

    @property
    def guides(self) -> bool:
        """Whether guidance leads the plants, so that they need a goal."""
        return self._guide.guides

    def follow_maps(self, follows: bool) -> None:
        """Let guidance take up maps that change, or lead by what it knew when the scene began."""
        self._guide.follows = follows

    def _make_room(self, m: int) -> None:
        """Make room for m rows, and for one of guidance under a program that has a last rank."""
        self._buffer.widen(m, m + self._guides_by_row)
        self._own_rows = np.zeros((self.count, m, WIDTH + 2))
        self._own_rows[..., PLACED] = 1.0

    def _accept(self, scene: BarrierSet) -> tuple[Sequence[Barrier], Sequence[Reach]]:
        """Return users' own barriers, where they are others than before."""
        own = tuple(scene.own.values())
        if len(own) == len(self._checked) and all(map(operator.is_, own, self._checked)):
            return (), ()
        self._checked = ()
        reaches = [usual(self.row_settings).reach(barrier) for barrier in own]
        warn_of_concave(own, self.plant.model)
        self._checked = own
        return own, reaches

    def _looks_back(self) -> bool:
        """Write what strict conditions lack of the scene until now; return whether that is known.

        The filter is asked as if the scene had stayed, and forgets that it was.
        """
        scene, samples, buffer = self._scene, self._samples, self._buffer
        stands = scene.edits == self._edits and scene.kind.shape[1] == self._m
        if self._refused or scene.own or not stands:
            return False
        before = samples.remembered()
        buffer.u_nominal[...] = 0.0
        numbers = scene.kind, scene.parameters, scene.priority, scene.own_margin
        self._filter((*numbers, scene.atlas.numbers), self._no_rows)
        plants = samples.plants
        least = {name: plants[name].copy() for name in ("kept", "headway")}
        samples.restore(before)
        unseen = plants["change"] != 0  # by any step: what was before that counts, too
        for name, now in least.items():
            plants[name] = np.where(unseen, np.maximum(plants[name], now), now)
        return True

    def _enter(self, goal: object, extent: object, is_first: bool) -> None:
        """Look at the scenes that begin; see `begin`."""
        self.covering.doubt(self.check_scene(self._scene.of(self._fresh)), self._fresh)
        world = self._samples.origin.world((goal, extent)) or (None, None)
        try:
            self._guide.begin(self._scene, self._samples, self.clearance, world, self._fresh)
        except InvalidInputError as error:
            if is_first:
                raise
            self._guide.lose(str(error))

    @property
    def lost(self) -> str:
        """Why guidance finds no path to the goal of a plant, the first one; "" where it does."""
        return self._why_lost(np.ones(self.count, dtype=np.bool_))

    def _why_lost(self, plants: Mask) -> str:
        """Return why guidance finds no path for the first of the masked plants (N,)."""
        why, origin = self._guide.why(plants), self._samples.origin
        far = f" (positions count from {origin.at.tolist()} here)" if why and origin.is_far else ""
        return why + far

    def _cause(self, reason: int, estimate: Estimate) -> str:
        """Return what exactly is wrong of the first plant with a reason; "" for no more."""
        if reason != Reason.GOAL:
            return super()._cause(reason, estimate)
        return self._why_lost(self._buffer.plants["reason"] == reason)

    def check_scene(self, scenes: BarrierSet) -> Integers:
        """Return (N,) a `Coverage` of each scene: OUTSIDE where rank 1 cannot be promised in it.

        Warns once of each thing that α₁, U and the speed limit cannot satisfy.

        Args:
            scenes: of the new episodes.

        Raises:
            InvalidInputError: if the margin leaves nothing of a speed limit, or a held input can
                pass it from rest within one period.
        """
        margin, fastest = self.plant.uncertainty.speed, self.plant.fastest or np.inf
        self.check_limits(scenes)
        covered = np.full(len(scenes.kind), Coverage.COVERED, dtype=np.int64)
        for one in braking.shortcomings(scenes, self.alpha1, self.input_set, margin, fastest):
            if not one.promised:
                covered[one.scenes] = Coverage.OUTSIDE
            if one.what not in self._said:
                self._said.add(one.what)
                warn_caller(f"safety filter: {one.says}", CoverageWarning)
        return covered

    def _made(self, scene: BarrierSet, u_nominal: Array) -> tuple[SceneArrays, Array]:
        """Return the scenes, and the rows of users' own barriers; lead the plants."""
        if self._guide.guides:  # before any state is looked at, whoever has barriers of their own
            world = self._samples.origin.world(self._world)
            self._guide.lead(scene, self._samples, self._buffer.u_nominal, world)
        own = self._no_rows
        if scene.own:
            own = self._own_rows
            if np.isfinite(u_nominal).all():
                self._make_rows(scene)
        numbers = scene.kind, scene.parameters, scene.priority, scene.own_margin
        return (*numbers, scene.atlas.numbers), own

    def _make_rows(self, scene: BarrierSet) -> None:
        """Look at the states, and make the rows of users' own barriers."""
        plants, out = self._samples.plants, self._own_rows
        self._filter_of.believe()
        reach = 0.0 if self.plant.axle is None else self.plant.axle.look_ahead
        reserve, told = self.reserve, self._samples.told
        known = Known(*(plants[name].copy() for name in Known._fields))
        entries = [(i, k, barrier) for (i, k), barrier in scene.own.items()]
        least = scene.own_margin + reserve.fixed
        reserve.write(
            (scene.kind, scene.parameters), least, entries if told or reserve.is_steep else (),
            known, plants["growth"].copy(), out,
        )  # fmt: skip
        x, time = plants["x"], plants["time"]
        for (i, k), barrier in scene.own.items():
            if barrier.reads_position:  # which binds the point before an axle
                out[i, k, MARGIN] += reach
            of_row = out[i, k, MARGIN:LEANING].tolist()
            try:
                with np.errstate(all="ignore"):
                    state = x[i], float(time[i])
                    write_own_row(
                        barrier, *state, self.row_settings, of_row, out[i, k], (self._kinks, i)
                    )
            except UNREADABLE:
                out[i, k, B] = np.nan
