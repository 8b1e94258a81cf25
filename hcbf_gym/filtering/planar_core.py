"""The filter of N planar double integrators: one compiled call a step."""

import contextlib
import operator
from typing import Any

import numpy as np

from hcbf_gym import programs
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.convexity import warn_of_concave
from hcbf_gym.barriers.late_inputs import check_inputs
from hcbf_gym.barriers.layout import LOWEST_RANK
from hcbf_gym.barriers.margins import LEANING, MARGIN
from hcbf_gym.barriers.own_rows import own_row
from hcbf_gym.barriers.scenes import scenes_of
from hcbf_gym.barriers.set import BarrierSet, Condition
from hcbf_gym.errors import UNREADABLE, InvalidInputError, UnreachableError, shown
from hcbf_gym.filtering import planar_belief, planar_step, solvers
from hcbf_gym.filtering.belief import real_numbers
from hcbf_gym.filtering.core import FilterCore, FilterSettings
from hcbf_gym.filtering.guide import Guide
from hcbf_gym.filtering.planar_records import OWN_ROW, constants, divided
from hcbf_gym.filtering.report import ReportBuffer
from hcbf_gym.filtering.samples import Samples
from hcbf_gym.filtering.threads import Threads
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Coverage, CoveredBy, Estimate, Plant, Reason


class PlanarCore(FilterCore):
    """The filter of N planar double integrators, in compiled code.

    A solver by name takes the place of the compiled program alone: what is believed, the rows and
    the verdict are the same.

    Args:
        plant: of the environment.
        input_set: U, planar.
        settings: what the user asked.
        batch: N of a batch; None for one plant, whose arrays have no leading N.
        threads: how many cores filter parts of a batch at once.

    Raises:
        UnknownNameError: if a name is not known; the message lists the choices.
        InvalidInputError: if an option is unknown or out of range, or the hold is too long for α₁
            or α₂.
    """

    def __init__(
        self,
        plant: Plant,
        input_set: InputSet,
        settings: FilterSettings,
        batch: int | None = None,
        threads: int = 1,
    ):
        count = 1 if batch is None else batch
        super().__init__(plant, input_set, settings, count)
        self._alone = batch is None
        program = programs.make_batch(
            settings.program, input_set=input_set, **self.program_options
        ).settings_of(count)
        self._solver: programs.Program | None = None
        if settings.solver is not None:
            self._solver = programs.make(
                settings.program, input_set=input_set, solver=settings.solver,
                **self.program_options,
            )  # fmt: skip
        self._guide = Guide(settings.guidance, count)
        numbers = self.uncertainty._asdict()
        numbers |= {"rows": self.row_settings.packed, "period": plant.period or 0.0}
        numbers |= {"has_way": self._guide.guides, "through": self._guide.through}
        numbers |= {"brakes": self.brakes_on_alarm, "dip": self.dip}
        numbers |= {"sway": self.sway, "settles": self.settles}
        self._constants, self._program = constants(program, numbers)
        self._parts = divided(program, count, threads)
        self._threads = Threads(len(self._parts))
        self._guides_by_row = program.guided and self._guide.guides
        self._samples = Samples(plant, count)
        self._buffer = ReportBuffer(batch)
        self._buffer.plants["alpha1_scale"] = self.alpha1_scale
        self._m = 0
        self._no_rows = self._own_rows = np.zeros((0, 0), dtype=OWN_ROW)
        self._scene = BarrierSet([()] * count)
        self._version, self._edits = self._scene.version.copy(), -1
        self._refused = self._needs_time = False
        self._listed: tuple[Any, ...] = ()
        self._checked: tuple[Any, ...] = ()
        if not callable(plant.barriers):
            scene = self._read_barriers(plant.barriers)
            self.check_limits(scene)
            self._note_news(scene)
            self._check_inputs()

    def applied_as(self, dtype: Any) -> None:
        """Note the type of the environment's actions; strict rows reserve what rounding takes."""
        super().applied_as(dtype)
        rounds = self.told_as == np.float32
        rounding = 0.5 * np.finfo(np.float32).eps * self.input_set.radius
        self._constants["rounding"] = rounding if rounds else 0.0

    @property
    def guides(self) -> bool:
        """Whether guidance leads the plants, so that they need a goal."""
        return self._guide.guides

    @property
    def conditions(self) -> list[Condition]:
        """Name and rank of the conditions of plant 0, in the order of the report's rows."""
        return self._scene.conditions()

    def restart(self, mask: Mask) -> None:
        """Forget what was known of the masked plants (N,): new episodes have begun there."""
        self._samples.forget(mask)
        self._steps[mask] = 0.0
        self._fresh |= mask

    def begin(self, barriers: Any, estimate: Estimate, goal: Any, extent: Any) -> dict[str, Any]:
        """Look at the first states of new episodes, and return what the infos of a reset say."""
        samples, kept_clear = self._samples, self.uncertainty.distance + self.uncertainty.body
        self._take(barriers, estimate)
        with contextlib.suppress(UnreachableError):  # its rows brake
            self._check_inputs()
        self._doubt(self.check_scene(self._scene.of(self._fresh)))
        self._guide.begin(self._scene, samples.x, kept_clear, (goal, extent), self._fresh)
        self._fresh[:] = False
        self.tell_coverage(self._buffer.plants)
        remembered, counted = samples.plants.copy(), self._steps.copy()
        nothing = np.zeros(2 if self._alone else (self.count, 2))
        u, report = self.step(nothing, barriers, estimate)
        samples.plants[:] = remembered
        self._steps[:] = counted
        told = report["status"] >= programs.FilterStatus.UNSAFE
        report["status"] = report["status"] * told
        report["u_safe"] = np.zeros_like(u)
        for key in ("slack", "delta", "intervention", "fallbacks"):
            report[key] = np.zeros_like(report[key])[()]
        return report

    def step(
        self, u_nominal: Array, barriers: Any, estimate: Estimate
    ) -> tuple[Array, dict[str, Any]]:
        """Filter u* (2,) or (N, 2), and return u with the report of it."""
        samples, buffer, guide = self._samples, self._buffer, self._guide
        self._take(barriers, estimate)
        scene = self._scene
        if scene.kind.shape[1] != self._m:
            self._make_room(scene.kind.shape[1])
        buffer.renew()
        buffer.plants["u_nominal"] = u_nominal
        if scene.own and np.isfinite(u_nominal).all():
            self._make_rows(scene)
        if guide.guides:
            guide.lead(scene, samples, buffer.plants["u_nominal"])
        said = self._filter(
            self._constants,
            self._program,
            (scene.kind, scene.parameters, scene.priority, scene.own_margin, scene.atlas.numbers),
            samples.plants,
            self._own_rows if scene.own else self._no_rows,
            buffer.plants,
            buffer.rows,
        )
        if said == planar_step.NOT_FINITE:
            bad = ~np.isfinite(np.atleast_2d(u_nominal)).all(axis=1)
            raise InvalidInputError(
                f"action: got {shown(np.atleast_2d(u_nominal)[bad].tolist())} for the plants "
                f"{shown(np.flatnonzero(bad).tolist())}, expected finite numbers"
                if self.count > 1
                else f"action: got {u_nominal.tolist()}, expected finite numbers"
            )
        if said == planar_step.MISSHAPED:
            raise InvalidInputError(
                f"barriers: got scenes of the shape {scene.kind.shape} for {self.count} plants, "
                f"expected one for each, of ranks from 1 to {LOWEST_RANK}"
            )
        if estimate.time is None:
            self._steps += 1.0
        if said == planar_step.ASKS:
            self._finish()
        report = buffer.report()
        return report["u_safe"], report

    def _check_inputs(self) -> None:
        """Refuse users' own barriers whose rows miss an input that moves them later.

        Raises:
            InvalidInputError: if there is one, and late inputs are not allowed.
            UnreachableError: if no input reaches a barrier.
        """
        own = tuple(self._scene.own.values())
        if not _same(own, self._checked):
            check_inputs(self.plant.model, own, self.settings.allow_late_inputs)
            warn_of_concave(own, self.plant.model)
            self._checked = own

    def _finish(self) -> None:
        """Brake as the user asks, and warn."""
        told, rows = self._buffer.plants, self._buffer.rows
        if self.plant.brake is not None:
            for i in np.flatnonzero(told["status"] == programs.FilterStatus.BACKUP):
                u = self._users_brake(int(i)).astype(self.told_as)
                told["u_safe"][i] = self._samples.plants["input"][i] = u
                told["intervention"][i] = np.linalg.norm(u - told["u_nominal"][i])
                rows["slack"][i] = rows["delta"][i] = 0.0
        reasons, counts = np.unique(told["reason"], return_counts=True)
        for reason, count in zip(reasons.tolist(), counts.tolist(), strict=True):
            self._warnings.warn(reason, count)

    def _users_brake(self, i: int) -> Array:
        """Return the input of U nearest the user's own; nearest 0 where that asks for a state."""
        asked: Any = self.plant.brake
        if callable(asked):
            known = self._samples.plants["known"][i]
            asked = asked(self._samples.x[i].copy()) if known else None
        wanted = real_numbers(asked, (2,))
        return self.input_set.project(np.zeros(2) if wanted is None else wanted)

    def _filter(self, *arrays: Any) -> int:
        """Filter what the arrays of `planar_step.filter_plants` hold; return what that says."""
        compiled: Any = planar_step
        if self._solver is None and len(self._parts) == 1:
            return compiled.filter_plants(*arrays)
        if self._solver is None:
            return self._filter_parts(*arrays)
        said, part, work, source = compiled.pose(*arrays)
        if said != planar_step.DONE:
            return said
        constants, program, *_, rows = arrays
        answered = solvers.answer(self._solver, work)
        return planar_step.close(constants, program, answered, part, work, source, rows)

    def _filter_parts(
        self, constants: Any, _: Any, scene: Any, sensed: Any, own: Any, told: Any, rows: Any
    ) -> int:
        """Filter parts of the plants at once, as `_filter` does all of them."""
        compiled: Any = planar_step
        if not np.isfinite(told["u_nominal"]).all():
            return planar_step.NOT_FINITE
        *of_plants, atlas = scene

        def filter_part(part: tuple[slice, Array]) -> int:
            these, program = part
            scenes = *(array[these] for array in of_plants), atlas
            each = sensed[these], own[these], told[these], rows[these]
            return compiled.filter_plants(constants, program, scenes, *each)

        return max(self._threads.run(filter_part, self._parts))

    def _take(self, barriers: Any, estimate: Estimate) -> None:
        """Note the states, and the barriers as they are now.

        What is no barriers, or cannot be satisfied, is taken for none: the plants are not believed.
        Where barriers move, and neither the estimate nor the period tells the time, nor are they.
        """
        samples = self._samples
        samples.take(estimate, None if estimate.time is not None else self._time(estimate))
        try:
            scene = self._read_barriers(barriers)
        except InvalidInputError:
            self._listed, self._refused = (), True
            self._version, self._edits = np.full(self.count, -1), -1
        else:
            self._note_news(scene)
        if self._refused:
            samples.doubt(Reason.BARRIERS)
        elif self._needs_time and estimate.time is None:
            samples.doubt(Reason.CLOCK)

    def _note_news(self, scene: BarrierSet) -> None:
        """Take a scene for the present one; what is news in it is looked at."""
        if scene is self._scene and scene.edits == self._edits:
            return
        news = np.ones(self.count, dtype=np.bool_)
        if scene is self._scene:
            news = scene.version != self._version
        self._samples.plants["news"][news] = 1
        self._scene, self._version, self._edits = scene, scene.version.copy(), scene.edits
        changed = news & ~self._fresh & (self._coverage == Coverage.COVERED)
        self._coverage[changed] = Coverage.SCENE  # it was covered with the scene that it began in
        self._covered_by[changed] = CoveredBy.CHANGED
        self.tell_coverage(self._buffer.plants)
        self._needs_time = self.plant.period is None and bool(scene.moves.any())
        self._refused = False
        try:
            self.check_limits(scene)
        except InvalidInputError:
            self._refused = True

    def _read_barriers(self, barriers: Any) -> BarrierSet:
        """Return barriers as a set; the present one where they are the list that was read last.

        Raises:
            InvalidInputError: if they are none.
        """
        if isinstance(barriers, BarrierSet) and barriers.kind.shape[0] == self.count:
            return barriers
        if _same(barriers, self._listed):
            return self._scene
        scene = scenes_of(barriers, self.count)
        self._listed = ()
        if not isinstance(barriers, BarrierSet) and not any(isinstance(b, list) for b in barriers):
            self._listed = tuple(barriers)  # a list of each plant may change in place
        return scene

    def _make_room(self, m: int) -> None:
        """Make room for m rows, and for one of guidance under a program that has a last rank."""
        self._m = m
        self._buffer.widen(m, m + self._guides_by_row)
        self._own_rows = np.zeros((self.count, m), dtype=OWN_ROW)

    def _make_rows(self, scene: BarrierSet) -> None:
        """Look at the states, and make the rows of users' own barriers."""
        plants, out = self._samples.plants, self._own_rows
        for i in range(self.count):
            self._buffer.plants["reason"][i] = planar_belief.look(plants[i])
        names = "x", "time", "model", "lag", "covariance", "growth"
        state = [plants[name] for name in names]
        reserved = scene.reserved(self.uncertainty, *state, period=self.plant.period or 0.0)
        out["margin"] = reserved[MARGIN]
        x, time = plants["x"], plants["time"]
        for (i, k), barrier in scene.own.items():
            of_row = reserved[:LEANING, i, k].tolist()
            try:
                with np.errstate(all="ignore"):
                    row = own_row(barrier, x[i], float(time[i]), self.row_settings, *of_row)
            except UNREADABLE:
                out["b"][i, k] = np.nan
                continue
            out["a_x"][i, k], out["a_y"][i, k] = row.a
            for name in ("b", "h", "alpha2_psi", "psi", "dip"):
                out[name][i, k] = getattr(row, name)


def _same(barriers: Any, listed: tuple[Any, ...]) -> bool:
    """Tell whether a list holds the very barriers that were read last; they never change."""
    if type(barriers) not in (list, tuple) or len(barriers) != len(listed):
        return False
    return all(map(operator.is_, barriers, listed))
