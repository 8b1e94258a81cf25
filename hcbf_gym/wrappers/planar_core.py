"""The filter of N planar double integrators: one compiled call a step."""

import contextlib
import operator
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hcbf_gym import programs
from hcbf_gym.barriers.late_inputs import check_inputs
from hcbf_gym.barriers.layout import LOWEST_RANK
from hcbf_gym.barriers.margins import derive_all
from hcbf_gym.barriers.rows import RowSettings
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import (
    UNREADABLE,
    InvalidInputError,
    UnreachableError,
    check_options,
    choose,
)
from hcbf_gym.guidance.geodesic import Geodesic
from hcbf_gym.guidance.local import Local
from hcbf_gym.guidance.row import Pull
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Estimate, Plant, Reason
from hcbf_gym.wrappers import fused, senses
from hcbf_gym.wrappers.belief import KNOWN_FAULTS, real_numbers
from hcbf_gym.wrappers.filter_core import Array, FilterCore, FilterSettings, Mask, kept

_PER_PLANT = ("margin", "intervention", "fallbacks", "model_error", "reachable", "deadlock")


class PlanarCore(FilterCore):
    """The filter of N planar double integrators, in compiled code.

    Args:
        plant: of the environment.
        input_set: U, planar.
        settings: what the user asked.
        batch: N of a batch; None for one plant, whose arrays have no leading N.

    Raises:
        UnknownNameError: if a name is not known; the message lists the choices.
        InvalidInputError: if an option is unknown or out of range, or the hold is too long for α₁
            or α₂.
    """

    def __init__(
        self, plant: Plant, input_set: InputSet, settings: FilterSettings, batch: int | None = None
    ):
        count = 1 if batch is None else batch
        super().__init__(plant, input_set, settings, count)
        self._alone = batch is None
        self.program = programs.make_batch(
            settings.program, input_set=input_set, **self.program_options
        )
        program = self.program.settings_of(count)
        self._guides_by_row = program.guided
        held = settings.rows == "held" and plant.period is not None
        hold = {"period": plant.period, "u_max": input_set.radius} if held else {}
        self.row_settings = RowSettings(self.alpha1, self.alpha2, **hold)
        self.uncertainty = kept(plant, settings.margin, held)
        self._way, self._through = _guidance(settings.guidance, count)
        self._constants: Any = (
            tuple(program),
            self.row_settings.packed.copy(),
            tuple(map(float, self.uncertainty)),
            0.0 if plant.period is None else float(plant.period),
            self._through,
            tuple(Pull()),
            self.brakes_on_alarm,
        )
        self._no_way = (
            np.zeros((count, 0), dtype=np.float32),
            np.zeros((count, 0), dtype=np.int8),
            np.zeros((count, 5)),
            np.zeros((count, 2)),
            np.zeros((0, 3)),
        )
        self._memory = np.zeros(count, dtype=senses.MEMORY)
        self._x, self._t = np.zeros((count, 4)), np.zeros(count)
        self._lag, self._covariance = np.zeros((count, 4)), np.zeros((count, 4, 4))
        self._model = np.zeros((count, 4))
        self._fault = np.zeros(count, dtype=np.int64)
        told = self._lag, self._covariance, self._fault
        self._beside_model = senses.Sensed(self._x, self._t, self._model, *told)
        self._as_model = senses.Sensed(self._x, self._t, self._x, *told)
        self._sensed = self._as_model
        self._faulty = self._lagging = self._spread = False  # what was told last, if anything
        self._codes = np.empty((2, count), dtype=np.int64)
        self._work: Any = ()
        self._size = 0
        self._parts_of_one: tuple[tuple[str, Any], ...] = ()
        self._scene = BarrierSet([()] * count)
        self._listed: tuple[Any, ...] = ()
        self._checked: tuple[Any, ...] = ()
        if not callable(plant.barriers):
            self._read_barriers(plant.barriers)
            self._check_inputs()

    def restart(self, mask: Mask) -> None:
        """Forget what was known of the masked plants (N,): new episodes have begun there."""
        self._memory[mask] = 0
        self._steps[mask] = 0.0
        self._fresh |= mask

    def begin(self, barriers: Any, estimate: Estimate, goal: Any, extent: Any) -> dict[str, Any]:
        """Look at the first states of new episodes, and return what the infos of a reset say."""
        self._take(estimate)
        self._take_barriers(barriers)
        with contextlib.suppress(UnreachableError):  # its rows brake
            self._check_inputs()
        self._doubt(self.check_scene(self._scene.of(self._fresh)))
        if self._way is not None:
            self._find_ways(goal, extent)
        self._fresh[:] = False
        remembered, counted = self._memory.copy(), self._steps.copy()
        nothing = np.zeros(2 if self._alone else (self.count, 2))
        u, report = self.step(nothing, barriers, estimate)
        self._memory[:] = remembered
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
        self._take(estimate)
        self._take_barriers(barriers)
        scene, wanted = self._scene, u_nominal[None] if self._alone else u_nominal
        work = self._space(scene.kind.shape[1])
        codes = self._codes if self._alone else np.empty_like(self._codes)
        given = bool(scene.own)
        if given and np.isfinite(wanted).all():
            self._make_rows(scene, work, codes[fused.REASON])
        flat = np.empty(self._size)
        said = fused.filter_plants(
            self._constants,
            (scene.kind, scene.parameters, scene.priority, scene.own_margin),
            self._sensed,
            self._no_way if self._way is None else self._guided(self._way, wanted),
            work,
            self._memory,
            wanted,
            flat,
            codes,
            given,
        )
        if said == fused.NOT_FINITE:
            raise InvalidInputError(f"action: got {u_nominal.tolist()}, expected finite numbers")
        if said == fused.MISSHAPED:
            raise InvalidInputError(
                f"barriers: got scenes of the shape {scene.kind.shape} for {self.count} plants, "
                f"expected one for each, of ranks from 1 to {LOWEST_RANK}"
            )
        if estimate.time is None:
            self._steps += 1.0
        report = self._report(u_nominal, flat, codes)
        if said == fused.ASKS:
            self._finish(report, codes)
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
            self._checked = own

    def _find_ways(self, goal: Any, extent: Any) -> None:
        """Let guidance look at the scenes that begin."""
        if isinstance(self._way, Local):
            self._way.reset(self._scene, mask=self._fresh)
        elif self._way is not None:
            clearance = self.uncertainty.distance + self.uncertainty.body
            start = np.where(np.isfinite(self._x[:, :2]), self._x[:, :2], 0.0)
            self._way.reset(self._scene, goal, extent, clearance, start=start, mask=self._fresh)

    def _guided(self, way: Geodesic | Local, u_nominal: Array) -> tuple[Any, ...]:
        """Return what guides the plants now, as the compiled call reads it."""
        if isinstance(way, Local):
            way.barriers = self._scene
            a, b = way.rows(self._x, self._t, u_nominal)
            return (*self._no_way[:4], np.column_stack([a, b]))
        way.update(self._t)
        return way.field, way.through, way.geometry, way.goal, self._no_way[4]

    def _report(self, u_nominal: Array, flat: Array, codes: Any) -> dict[str, Any]:
        """Return the parts of an answer by their names."""
        report: dict[str, Any] = {"u_nominal": u_nominal}
        if self._alone:
            for name, part in self._parts_of_one:
                report[name] = flat[part]
            report["status"], report["reason"] = codes[0, 0], codes[1, 0]
            report["covered"], report["alpha1_scale"] = self._coverage[0], self._scale[0]
            return report
        m = self._work[3].shape[2]
        views = fused.answer_views.py_func(flat, self.count, m, self._work[2].shape[1])
        report["u_safe"] = views.u
        report["slack"], report["delta"] = views.slack[:, :m], views.delta[:, :m]
        for name in _PER_PLANT:
            report[name] = getattr(views, name)
        report["status"], report["reason"] = codes
        report["covered"], report["alpha1_scale"] = self._coverage.copy(), self._scale.copy()
        return report

    def _finish(self, report: dict[str, Any], codes: Any) -> None:
        """Brake as the user asks; warn."""
        if self.plant.brake is not None:
            for i in np.flatnonzero(codes[fused.STATUS] == programs.FilterStatus.BACKUP):
                at = ... if self._alone else i
                report["u_safe"][at] = u = self._users_brake(int(i))
                report["slack"][at] = report["delta"][at] = 0.0
                gap = np.linalg.norm(u - np.atleast_2d(report["u_nominal"])[i])
                self._write(report, "intervention", int(i), gap)
                self._memory[i]["input"] = u
        for reason in np.unique(codes[fused.REASON]).tolist():
            self._announcer.say(reason, int((codes[fused.REASON] == reason).sum()))

    def _users_brake(self, i: int) -> Array:
        """Return the input of U nearest the user's own; nearest 0 where that asks for a state."""
        asked: Any = self.plant.brake
        if callable(asked):
            asked = asked(self._x[i].copy()) if self._memory[i]["known"] else None
        wanted = real_numbers(asked, (2,))
        return self.input_set.project(np.zeros(2) if wanted is None else wanted)

    def _write(self, report: dict[str, Any], name: str, i: int, value: Any) -> None:
        """Set the entry of plant `i` in a report."""
        if self._alone:
            report[name] = value
        else:
            report[name][i] = value

    def _take(self, estimate: Estimate) -> None:
        """Note what is known of the plants; what does not fit is a fault of theirs."""
        if estimate.fault is not None or self._faulty:
            self._faulty = estimate.fault is not None
            self._fault[:] = self._alarms(estimate.fault) if self._faulty else 0
        sound = _copy(self._x, estimate.x)
        if estimate.time is None:
            self._t[:] = self._time(estimate)
        elif not _copy(self._t, estimate.time):
            self._t[:] = -np.inf  # what is no time does not go on
        self._sensed = self._as_model
        if estimate.model is not None:
            self._sensed = self._beside_model
            sound &= _copy(self._model, estimate.model)
        if estimate.lag is not None or self._lagging:
            self._lagging = estimate.lag is not None
            self._lag[:] = 0.0
            sound &= not self._lagging or _copy(self._lag, estimate.lag)
        if estimate.covariance is not None or self._spread:
            self._spread = estimate.covariance is not None
            self._covariance[:] = 0.0
            sound &= not self._spread or _copy(self._covariance, estimate.covariance)
        if not sound:
            self._blame(Reason.STATE)
        elif estimate.age is not None:
            self._check_age(estimate.age)

    def _blame(self, reason: Any, mask: Any = ...) -> None:
        """Note why the masked plants are not believed."""
        self._fault[mask], self._faulty = reason, True

    def _alarms(self, fault: Any) -> Any:
        """Return the alarms (N,) that the plants raise themselves; what is none is a bad state."""
        alarms = np.zeros(self.count)
        if not _copy(alarms, fault) or not np.isin(alarms, KNOWN_FAULTS).all():
            return Reason.STATE
        return alarms

    def _check_age(self, age: Any) -> None:
        """Note which states are older than the plant allows, or of no age at all."""
        ages = np.full(self.count, np.nan)
        _copy(ages, age)
        most = np.inf if self.plant.max_age is None else self.plant.max_age
        self._blame(Reason.AGE, ~(np.isfinite(ages) & (ages >= 0.0) & (ages <= most)))

    def _take_barriers(self, barriers: Any) -> None:
        """Note the barriers as they are now; where they are none, the plants are not believed."""
        if isinstance(barriers, BarrierSet) and barriers.kind.shape[0] == self.count:
            self._scene = barriers
            return
        if _same(barriers, self._listed):
            return
        try:
            self._read_barriers(barriers)
        except InvalidInputError:
            self._listed = ()
            self._blame(Reason.BARRIERS, self._fault == 0)

    def _read_barriers(self, barriers: Any) -> None:
        """Make a scene of a list of barriers.

        Raises:
            InvalidInputError: if it is none, or a speed limit cannot be kept.
        """
        if not isinstance(barriers, Sequence) or isinstance(barriers, str):
            raise InvalidInputError(f"barriers: got {barriers!r}, expected a sequence of Barriers")
        scene = BarrierSet([tuple(barriers)])
        self._scene, self._listed = scene, tuple(barriers)

    def _space(self, m: int) -> Any:
        """Return working space for m rows, and one for guidance under a lexicographic program."""
        guided = self._way is not None and self._guides_by_row
        if not self._work or self._work[3].shape[2] != m:
            n, total = self.count, m + guided
            self._work = (
                np.zeros((n, total, 2)),
                np.zeros((4, n, total)),
                np.ones((n, total), dtype=np.int64),
                np.zeros((2, n, m)),
                np.zeros((n, 2)),
            )
            self._size = fused.answer_size(n, m, total)
            ends = np.cumsum([2, total, total, m]).tolist()
            self._parts_of_one = (
                ("u_safe", slice(0, 2)),
                ("slack", slice(2, 2 + m)),
                ("delta", slice(ends[1], ends[1] + m)),
                ("margin", slice(ends[2], ends[3])),
                *((name, ends[3] + k) for k, name in enumerate(_PER_PLANT[1:])),
            )
        return self._work

    def _make_rows(self, scene: BarrierSet, work: Any, reason: Any) -> None:
        """Look at the states (reasons (N,)), and write the rows of users' own barriers."""
        a, out, priority, margin, _ = work
        for i in range(self.count):
            reason[i] = senses.look(self._memory[i], self._sensed, i, self.plant.period or 0.0)
        m = scene.kind.shape[1]
        priority[:, :m] = scene.priority
        margin[0], margin[1] = derive_all(self.uncertainty, scene, *self._sensed[:-1])
        try:
            rows = scene.rows(self._x, self._t, self.row_settings, margin[0], margin[1])
        except UNREADABLE:
            out[:] = np.nan
            return
        a[:, :m], out[0, :, :m], out[1, :, :m] = rows.a, rows.b, rows.h
        out[2, :, :m] = rows.alpha2_psi


def _guidance(choice: Any, count: int) -> tuple[Geodesic | Local | None, int]:
    """Return what guides N plants, or None, and the highest rank that gives way to it.

    Raises:
        UnknownNameError: if there is no such guidance; the message lists the choices.
        InvalidInputError: on an unknown option.
    """
    if choice is None:
        return None, 0
    options = dict(choice) if isinstance(choice, Mapping) else {"kind": choice}
    check_options("guidance", options, ("kind", "through"))
    kinds = {"geodesic": Geodesic, "local": Local}
    kind = choose("guidance", options.get("kind", "geodesic"), kinds)
    return kind(count), int(options.get("through", 0))


def _copy(target: Array, value: Any) -> bool:
    """Copy a value (N, …), or of one plant without the N; tell whether it is made of numbers."""
    if isinstance(value, float) and target.shape == (1,):
        target[0] = value
        return True
    one = len(target) == 1
    if type(value) is not np.ndarray or value.dtype.char != "d":
        shapes = (target.shape, target.shape[1:]) if one else (target.shape,)
        found = (real_numbers(value, shape) for shape in shapes)
        value = next((numbers for numbers in found if numbers is not None), None)
        if value is None:
            return False
    if value.shape != target.shape and not (one and value.shape == target.shape[1:]):
        return False
    target[...] = value
    return True


def _same(barriers: Any, listed: tuple[Any, ...]) -> bool:
    """Tell whether a list holds the very barriers that were read last; they never change."""
    if type(barriers) not in (list, tuple) or len(barriers) != len(listed):
        return False
    return all(map(operator.is_, barriers, listed))
