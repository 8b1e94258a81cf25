"""The filter of one plant of any model, with any barriers, inputs and solver."""

from typing import Any

import numpy as np

from hcbf_gym import programs
from hcbf_gym.barriers.general import GeneralRows
from hcbf_gym.barriers.margins import derive_all
from hcbf_gym.barriers.rows import CbfRows, RowSettings
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.constants import ASKING, STANDING
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Estimate, Plant
from hcbf_gym.models.reduced_order import DoubleIntegrator
from hcbf_gym.programs import FilterStatus
from hcbf_gym.wrappers.filter_core import Array, FilterCore, FilterSettings, Mask, kept
from hcbf_gym.wrappers.fused import is_unsafe
from hcbf_gym.wrappers.monitor import Monitor


class GeneralCore(FilterCore):
    """The filter of one plant: usual rows from jets, and a program of any number of inputs.

    Args:
        plant: of the environment.
        input_set: U.
        settings: what the user asked.

    Raises:
        UnknownNameError: if a name is not known; the message lists the choices.
        InvalidInputError: if an option is unknown or out of range, or guidance is asked for.
    """

    def __init__(self, plant: Plant, input_set: InputSet, settings: FilterSettings):
        super().__init__(plant, input_set, settings, 1)
        if settings.guidance is not None:
            raise InvalidInputError(
                f"guidance: got {settings.guidance!r} with {type(plant.model).__name__} and solver "
                f"{settings.solver!r}, expected None: only the planar double integrator is guided"
            )
        solver = {} if settings.solver is None else {"solver": settings.solver}
        self.program = programs.make(
            settings.program, input_set=input_set, **solver, **self.program_options
        )
        self.uncertainty = kept(plant, settings.margin, held=False)
        self._rows_of = GeneralRows(plant.model, self.alpha1, self.alpha2)
        self._row_settings = RowSettings(self.alpha1, self.alpha2)
        self._monitor = Monitor(plant.model, plant.period, input_set.radius)

    def restart(self, mask: Mask) -> None:
        """Forget what was known of the plant: a new episode has begun."""
        self._steps[:] = 0.0
        self._monitor.forget()

    def begin(self, barriers: Any, estimate: Estimate, goal: Any, extent: Any) -> dict[str, Any]:
        """Look at the first state of a new episode, and return what the infos of a reset say."""
        rows, kept = self._rows(barriers, estimate)
        zeros = np.zeros(self.input_set.n_u)
        status = FilterStatus.UNSAFE if self._outside(rows, barriers) else FilterStatus.NOMINAL
        slack = np.zeros(rows.b.size)
        result = programs.FilterResult(zeros, slack, slack.copy(), status, 0)
        return _report(zeros, result, kept, 0.0, False)

    def step(
        self, u_nominal: Array, barriers: Any, estimate: Estimate
    ) -> tuple[Array, dict[str, Any]]:
        """Filter u* (n_u,), and return u with the report of it."""
        rows, kept = self._rows(barriers, estimate)
        self._steps += 1.0
        x = np.asarray(estimate.x, dtype=np.float64)
        model_error = self._monitor.observe(x)
        result = self.program(u_nominal, rows)
        if self._outside(rows, barriers) and result.status < FilterStatus.UNSAFE:
            result = result._replace(status=FilterStatus.UNSAFE)
        self._monitor.expect(x, result.u)
        self._announcer.say(self._monitor.alarm)
        return result.u, _report(u_nominal, result, kept, model_error, self._stands(x, u_nominal))

    def _stands(self, x: Array, u_nominal: Array) -> bool:
        """Tell whether the plant stands though u* asks it to move, where the model knows v."""
        at = self.plant.model.velocity_at
        if at is None:
            return False
        return bool(
            np.linalg.norm(x[at : at + 2]) < STANDING and np.linalg.norm(u_nominal) > ASKING
        )

    def _rows(self, barriers: Any, estimate: Estimate) -> tuple[CbfRows, tuple[Array, Array]]:
        """Return the rows (m,) of the present state, with their margins and conditioning."""
        x, time = np.asarray(estimate.x, dtype=np.float64), float(np.ravel(self._time(estimate))[0])
        if isinstance(barriers, BarrierSet):
            if self.plant.model != DoubleIntegrator():
                raise InvalidInputError(
                    f"plant: got a BarrierSet with {self.plant.model}, expected a sequence of "
                    "barriers: a set makes rows of the planar double integrator alone"
                )
            nothing = np.zeros(4) if estimate.lag is None else estimate.lag
            spread = np.zeros((4, 4)) if estimate.covariance is None else estimate.covariance
            now = x[None], np.array([time])
            model = x if estimate.model is None else np.asarray(estimate.model)
            state = model[None], nothing[None], spread[None]
            margin, rate = derive_all(self.uncertainty, barriers, *now, *state)
            batch = barriers.rows(*now, self._row_settings, margin, rate)
            rows = CbfRows(*(field[0] for field in batch if field is not None))
            return rows, (margin[0], np.ones(rows.b.size))
        kept = self.uncertainty.distance + self.uncertainty.body
        margin = self._rows_of.prepare(barriers).margins(kept)
        return self._rows_of(barriers, x, time, margin), (margin, self._rows_of.conditioning)

    def _outside(self, rows: CbfRows, barriers: Any) -> bool:
        """Tell whether a strict h is below zero, for the whole body where that is known."""
        if isinstance(barriers, BarrierSet):
            now = barriers.kind[0], rows.priority, rows.a, rows.h
            return bool(is_unsafe(*now, self.uncertainty.body))
        return bool((rows.h[rows.priority == 1] < 0.0).any())


def _report(
    u_nominal: Array,
    result: programs.FilterResult,
    kept: tuple[Array, Array],
    model_error: float,
    stands: bool,
) -> dict[str, Any]:
    """Return what ``info["safety_filter"]`` says of one call; `kept` as `_rows` returns it."""
    margin, conditioning = kept
    return {
        "u_nominal": u_nominal.copy(),
        "u_safe": result.u.copy(),
        "slack": result.slack.copy(),
        "delta": result.delta.copy(),
        "margin": margin.copy(),
        "conditioning": conditioning.copy(),
        "intervention": np.sqrt((result.u - u_nominal) @ (result.u - u_nominal)),
        "status": np.float64(result.status),
        "fallbacks": np.float64(result.fallbacks),
        "model_error": np.float64(model_error),
        "reachable": np.float64(0.0),
        "deadlock": np.float64(stands),
    }
