"""The filter of N planar double integrators: one compiled call a step."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hcbf_gym import programs
from hcbf_gym.barriers.margins import derive_all
from hcbf_gym.barriers.rows import CbfRows, RowSettings
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, check_options, choose
from hcbf_gym.guidance.geodesic import Geodesic
from hcbf_gym.guidance.local import Local
from hcbf_gym.guidance.row import Pull
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Estimate, Plant
from hcbf_gym.programs.exact.program import filter_exactly
from hcbf_gym.programs.planar.cascade import GRADED
from hcbf_gym.programs.planar.records import LEXICOGRAPHIC
from hcbf_gym.wrappers import fused, monitor
from hcbf_gym.wrappers.filter_core import Array, FilterCore, FilterSettings, Mask, kept

_PER_PLANT = ("margin", "intervention", "status", "fallbacks", "model_error", "reachable",
              "deadlock")  # fmt: skip


class PlanarCore(FilterCore):
    """The filter of N planar double integrators, in compiled code.

    Args:
        plant: of the environment.
        input_set: U, planar.
        settings: what the user asked.
        count: N.

    Raises:
        UnknownNameError: if a name is not known; the message lists the choices.
        InvalidInputError: if an option is unknown or out of range, or the hold is too long for α₁
            or α₂.
    """

    def __init__(self, plant: Plant, input_set: InputSet, settings: FilterSettings, count: int):
        super().__init__(plant, input_set, settings, count)
        self.program = programs.make_batch(
            settings.program, input_set=input_set, **self.program_options
        )
        held = settings.rows == "held" and plant.period is not None
        hold = {"period": plant.period, "u_max": input_set.radius} if held else {}
        self.row_settings = RowSettings(self.alpha1, self.alpha2, **hold)
        self.uncertainty = kept(plant, settings.margin, held)
        self._way, self._through = _guidance(settings.guidance, count)
        self._constants: Any = (
            tuple(self.program.settings),
            self.row_settings.packed.copy(),
            tuple(map(float, self.uncertainty)),
            0.0 if plant.period is None else float(plant.period),
            self._through,
            tuple(Pull()),
        )
        self._no_way = (
            np.zeros((count, 0), dtype=np.float32),
            np.zeros((count, 0), dtype=np.int8),
            np.zeros((count, 5)),
            np.zeros((count, 2)),
            np.zeros((0, 3)),
        )
        self._memory = np.zeros((count, fused.MEMORY))
        self._x, self._t = np.zeros((count, 4)), np.zeros(count)
        self._lag, self._covariance = np.zeros((count, 4)), np.zeros((count, 4, 4))
        self._model = np.zeros((count, 4))
        self._fresh: Mask = np.ones(count, dtype=np.bool_)
        self._work: Any = ()
        self._size = 0
        self._parts_of_one: tuple[tuple[str, Any], ...] = ()
        self._set: tuple[Any, BarrierSet] | None = None

    def restart(self, mask: Mask) -> None:
        """Forget what was known of the masked plants (N,): new episodes have begun there."""
        self._memory[mask, : monitor.ALARM] = 0.0
        self._memory[mask, -1] = 0.0
        self._steps[mask] = 0.0
        self._fresh |= mask

    def begin(self, barriers: Any, estimate: Estimate, goal: Any, extent: Any) -> dict[str, Any]:
        """Look at the first states of new episodes, and return what the infos of a reset say."""
        scene = self._scene(barriers)
        self._take(estimate)
        if isinstance(self._way, Local):
            self._way.reset(scene, mask=self._fresh)
        elif self._way is not None:
            clearance = self.uncertainty.distance + self.uncertainty.body
            self._way.reset(scene, goal, extent, clearance, start=self._x[:, :2], mask=self._fresh)
        self._fresh[:] = False
        remembered, counted = self._memory.copy(), self._steps.copy()
        many = np.ndim(estimate.x) == 2
        u, report = self.step(np.zeros((self.count, 2) if many else 2), barriers, estimate)
        self._memory[:] = remembered
        self._steps[:] = counted
        outside = report["status"] == programs.FilterStatus.UNSAFE
        report["status"] = report["status"] * outside
        report["u_safe"] = np.zeros_like(u)
        for key in ("slack", "delta", "intervention", "fallbacks"):
            report[key] = np.zeros_like(report[key])[()]
        return report

    def step(
        self, u_nominal: Array, barriers: Any, estimate: Estimate
    ) -> tuple[Array, dict[str, Any]]:
        """Filter u* (2,) or (N, 2), and return u with the report of it."""
        scene = self._scene(barriers)
        self._take(estimate)
        if estimate.time is None:
            self._steps += 1.0
        model = self._x if estimate.model is None else self._model
        wanted = u_nominal if u_nominal.ndim == 2 else u_nominal[None]
        m = scene.kind.shape[1]
        work = self._space(m)
        given = bool(scene.own)
        if given:
            self._make_rows(scene, work)
        flat = np.empty(self._size)
        said = fused.filter_plants(
            self._constants,
            (scene.kind, scene.parameters, scene.priority, scene.own_margin),
            (self._x, self._t, model, self._lag, self._covariance),
            self._no_way if self._way is None else self._guided(self._way, wanted),
            work,
            self._memory,
            wanted,
            flat,
            given,
        )
        if said == fused.NOT_FINITE:
            raise InvalidInputError(f"action: got {u_nominal.tolist()}, expected finite numbers")
        report = self._report(u_nominal, flat)
        if said == fused.ASKS:
            self._finish(report, scene)
            monitor.warn_once(self._memory)
        return report["u_safe"], report

    def _guided(self, way: Geodesic | Local, u_nominal: Array) -> tuple[Any, ...]:
        """Return what guides the plants now, as the compiled call reads it."""
        if isinstance(way, Local):
            a, b = way.rows(self._x, self._t, u_nominal)
            return (*self._no_way[:4], np.column_stack([a, b]))
        way.update(self._t)
        return way.field, way.through, way.geometry, way.goal, self._no_way[4]

    def _report(self, u_nominal: Array, flat: Array) -> dict[str, Any]:
        """Return the parts of an answer by their names."""
        report: dict[str, Any] = {"u_nominal": u_nominal}
        if u_nominal.ndim == 1:
            for name, part in self._parts_of_one:
                report[name] = flat[part]
            return report
        m = self._work[3].shape[2]
        views = fused.answer_views.py_func(flat, self.count, m, self._work[2].shape[1])
        report["u_safe"] = views.u
        report["slack"], report["delta"] = views.slack[:, :m], views.delta[:, :m]
        for name in _PER_PLANT:
            report[name] = getattr(views, name)
        return report

    def _finish(self, report: dict[str, Any], scene: BarrierSet) -> None:
        """Solve in rational arithmetic the states that the compiled programs left to it."""
        a, rows, priority, _, wanted = self._work
        m = scene.kind.shape[1]
        for i in np.flatnonzero(np.atleast_1d(report["status"]) == GRADED):
            state = CbfRows(a[i], rows[0, i], rows[1, i], priority[i], rows[2, i])
            exact = filter_exactly(self.program.cascade, self.input_set, wanted[i], state)
            u_nominal = np.atleast_2d(report["u_nominal"])[i]
            moved = bool((np.abs(exact.u - u_nominal) > 0.0).any())
            sensed = scene.kind[i], scene.priority[i], a[i], rows[1, i]
            outside = fused.is_outside(*sensed, self.uncertainty.body)
            status = fused.conclude(int(exact.status), moved, outside, exact.slack[:m])
            where = () if self.count == 1 and report["u_safe"].ndim == 1 else (i,)
            report["u_safe"][where] = exact.u
            report["slack"][where], report["delta"][where] = exact.slack[:m], exact.delta[:m]
            gap = np.linalg.norm(exact.u - u_nominal)
            for name, value in (
                ("status", float(status)),
                ("intervention", gap),
                ("fallbacks", float(exact.fallbacks)),
            ):
                if where:
                    report[name][where] = value
                else:
                    report[name] = np.float64(value)
            self._memory[i, 6:8] = exact.u

    def _take(self, estimate: Estimate) -> None:
        """Note what is known of the plants."""
        self._x[:] = estimate.x
        self._t[:] = estimate.time if estimate.time is not None else self._time(estimate)
        self._model[:] = estimate.x if estimate.model is None else estimate.model
        if estimate.lag is not None:
            self._lag[:] = estimate.lag
        if estimate.covariance is not None:
            self._covariance[:] = estimate.covariance

    def _scene(self, barriers: Any) -> BarrierSet:
        """Return the barriers as a `BarrierSet`."""
        if isinstance(barriers, BarrierSet):
            return barriers
        if self._set is None or self._set[0] is not barriers:
            scene = BarrierSet([tuple(barriers)])
            scene.check(self.row_settings)
            self._set = barriers, scene
        return self._set[1]

    def _space(self, m: int) -> Any:
        """Return working space for m rows, and one for guidance under a lexicographic program."""
        guided = self._way is not None and self.program.settings.kind == LEXICOGRAPHIC
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

    def _make_rows(self, scene: BarrierSet, work: Any) -> None:
        """Write the rows of scenes with users' own barriers, slower than compiled ones."""
        a, out, priority, margin, _ = work
        m = scene.kind.shape[1]
        margin[0], margin[1] = derive_all(
            self.uncertainty, scene, self._x, self._t, self._model, self._lag, self._covariance
        )
        rows = scene.rows(self._x, self._t, self.row_settings, margin[0], margin[1])
        a[:, :m], out[0, :, :m], out[1, :, :m], out[2, :, :m] = (
            rows.a,
            rows.b,
            rows.h,
            rows.alpha2_psi,
        )
        priority[:, :m] = scene.priority


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
