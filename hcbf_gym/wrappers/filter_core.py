"""What stands between u* and u: rows, program, status, and the monitor, for N plants."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym import programs, records
from hcbf_gym.barriers import class_k
from hcbf_gym.barriers.class_k import LogClassK
from hcbf_gym.barriers.general import GeneralRows, margins
from hcbf_gym.barriers.rows import CbfRows, RowSettings
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import check_options, choose, finite_float
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Estimate, Plant
from hcbf_gym.models.reduced_order import DoubleIntegrator

Array = NDArray[np.float64]

ROW_OPTIONS = ("alpha1", "alpha2")

USUAL_ROWS_MARGIN = 0.01
"""What usual rows keep against the dip of h between two samples [m]."""


class FilterSettings(NamedTuple):
    """What the user asked of a filter.

    Attributes:
        program: its name.
        rows: "held" or "usual".
        margin: [m]; None derives it.
        solver: its name; None is the compiled path where there is one.
        options: α₁, α₂ and the program's own.
    """

    program: str
    rows: str
    margin: float | None
    solver: str | None
    options: dict[str, Any]


def plain_options(options: dict[str, Any]) -> dict[str, Any]:
    """Return options in JSON's terms, class-K functions as dicts, for a wrapper's spec."""
    kinds = class_k.KINDS
    return {
        key: records.to_dict(value, kinds) if type(value) in kinds.values() else value
        for key, value in options.items()
    }


class FilterCore:
    """What both cores share: the settings, read once at the door.

    Args:
        plant: of the environment.
        input_set: U.
        settings: what the user asked.
        count: N, how many plants are filtered at once.

    Raises:
        UnknownNameError: if a name is not known; the message lists the choices.
        InvalidInputError: if an option is unknown or out of range.
    """

    def __init__(self, plant: Plant, input_set: InputSet, settings: FilterSettings, count: int):
        choose("rows", settings.rows, dict.fromkeys(("held", "usual")))
        allowed = (*ROW_OPTIONS, *programs.options(settings.program))
        check_options(f"safety filter {settings.program!r}", settings.options, allowed)
        self.plant, self.input_set, self.count = plant, input_set, count
        self.row_settings = RowSettings(
            class_k.make(settings.options.get("alpha1", LogClassK())),
            class_k.make(settings.options.get("alpha2", 2.0)),
            plant.period if settings.rows == "held" else None,
            input_set.radius,
        )
        margin = settings.margin
        if margin is None:
            known = plant.uncertainty
            margin = USUAL_ROWS_MARGIN if known is None else known.distance
        self.margin = finite_float("margin", margin, minimum=0.0)
        self.program_options = {k: v for k, v in settings.options.items() if k not in ROW_OPTIONS}

    def restart(self, mask: NDArray[np.bool_]) -> None:
        """Forget what was known of the masked plants (N,)."""

    def empty_report(self, barriers: Any, estimate: Estimate) -> dict[str, Any]:
        """Return what the infos of a reset say: zeros, in the shapes of a step's report."""
        n, n_u = np.shape(estimate.x)[:-1], self.input_set.n_u
        m = barriers.kind.shape[-1] if isinstance(barriers, BarrierSet) else len(barriers)
        u, row, one = np.zeros((*n, n_u)), np.zeros((*n, m)), np.zeros(n)[()]
        nothing = programs.FilterResult(u=u, slack=row, delta=row, status=one, fallbacks=one)
        return self._report(u, nothing, row.copy())

    def step(
        self, u_nominal: Array, barriers: Any, estimate: Estimate
    ) -> tuple[Array, dict[str, Any]]:
        """Filter u* (n_u,) or (N, n_u) and return u with the report of it."""
        raise NotImplementedError

    def _report(
        self, wanted: Array, result: programs.FilterResult, margin: Array
    ) -> dict[str, Any]:
        return {
            "u_nominal": wanted.copy(),
            "u_safe": result.u.copy(),
            "slack": result.slack.copy(),
            "delta": result.delta.copy(),
            "status": np.float64(result.status),
            "intervention": np.linalg.norm(result.u - wanted, axis=-1),
            "fallbacks": np.float64(result.fallbacks),
            "margin": margin,
            "model_error": np.zeros(wanted.shape[:-1])[()],
            "reachable": np.zeros(wanted.shape[:-1])[()],
        }


class PlanarCore(FilterCore):
    """The filter of N planar double integrators with built-in barriers, in compiled code."""

    def __init__(self, plant: Plant, input_set: InputSet, settings: FilterSettings, count: int):
        super().__init__(plant, input_set, settings, count)
        self.program: programs.BatchProgram = programs.make_batch(
            settings.program, input_set=input_set, **self.program_options
        )

    def step(
        self, u_nominal: Array, barriers: BarrierSet, estimate: Estimate
    ) -> tuple[Array, dict[str, Any]]:
        """Filter u* (2,) or (N, 2) and return u with the report of it."""
        x, t = np.atleast_2d(estimate.x), np.atleast_1d(np.asarray(estimate.time, dtype=float))
        rows = barriers.rows(x, t, self.row_settings, self.margin)
        result = self.program(np.atleast_2d(u_nominal), rows)
        margin = barriers.margins(self.margin)
        if u_nominal.ndim == 1:
            result, margin = programs.FilterResult(*(field[0] for field in result)), margin[0]
        return result.u, self._report(u_nominal, result, margin)


class GeneralCore(FilterCore):
    """The filter of one plant: any model, any barriers, any number of inputs, any solver."""

    def __init__(self, plant: Plant, input_set: InputSet, settings: FilterSettings, count: int):
        super().__init__(plant, input_set, settings, count)
        solver = {} if settings.solver is None else {"solver": settings.solver}
        self.program: programs.Program = programs.make(
            settings.program, input_set=input_set, **solver, **self.program_options
        )
        self._general_rows = GeneralRows(
            plant.model, self.row_settings.alpha1, self.row_settings.alpha2
        )
        self._steps = 0

    def restart(self, mask: NDArray[np.bool_]) -> None:
        """Start counting time again."""
        self._steps = 0

    def step(
        self, u_nominal: Array, barriers: Any, estimate: Estimate
    ) -> tuple[Array, dict[str, Any]]:
        """Filter u* (n_u,) and return u with the report of it."""
        time = estimate.time
        if time is None:
            time = self._steps * (self.plant.period or 0.0)
        self._steps += 1
        rows, margin = self._rows(barriers, estimate.x, float(time))
        result = self.program(u_nominal, rows)
        return result.u, self._report(u_nominal, result, margin)

    def _rows(self, barriers: Any, x: Array, time: float) -> tuple[CbfRows, Array]:
        """Return the rows (m,) of the present state and their margins."""
        if isinstance(barriers, BarrierSet):
            batch = barriers.rows(x[None], np.array([time]), self.row_settings, self.margin)
            rows = CbfRows(*(field[0] for field in batch if field is not None))
            return rows, barriers.margins(self.margin)[0]
        margin = margins(barriers, self.margin)
        return self._general_rows(barriers, x, time, margin), margin


def make_core(
    plant: Plant, input_set: InputSet, settings: FilterSettings, count: int
) -> FilterCore:
    """Return the core that fits: the compiled one for the planar double integrator."""
    planar = plant.model == DoubleIntegrator()
    kind = (
        PlanarCore
        if planar and settings.solver is None and callable(plant.barriers)
        else GeneralCore
    )
    return kind(plant, input_set, settings, count)
