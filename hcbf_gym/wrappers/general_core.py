"""The filter of one plant of any model, with any barriers, inputs and solver."""

import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import programs
from hcbf_gym.barriers.general import GeneralRows, check_barriers
from hcbf_gym.barriers.late_inputs import REMEDY, LateInputs
from hcbf_gym.barriers.margins import derive_all
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import UNREADABLE, InvalidInputError, SolverError, finite_array
from hcbf_gym.models.constants import ASKING, STANDING
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Estimate, Plant, Reason
from hcbf_gym.models.reduced_order import DoubleIntegrator
from hcbf_gym.programs import FilterResult, FilterStatus
from hcbf_gym.programs.program import check_rows
from hcbf_gym.wrappers import report
from hcbf_gym.wrappers.backup import Backup
from hcbf_gym.wrappers.belief import Belief, alarm_of, examine
from hcbf_gym.wrappers.filter_core import Array, FilterCore, FilterSettings, Integers, Mask
from hcbf_gym.wrappers.fused import is_unsafe
from hcbf_gym.wrappers.monitor import Monitor


class Conditions(NamedTuple):
    """What the rows of one state are made of.

    Attributes:
        rows: (m,) of them.
        margin: (m,) what each reserves between h and zero.
        conditioning: (m,) see `GeneralRows`.
        unsafe: whether a strict h is below zero, for the whole body where that is known.
        source: (m,) which condition each row stands for; None where each stands for itself.
    """

    rows: CbfRows
    margin: Array
    conditioning: Array
    unsafe: bool
    source: Integers | None = None


class GeneralCore(FilterCore):
    """The filter of one plant: its rows, and a program of any number of inputs.

    Plants of the planar double integrator have the rows that the compiled core gives them, held
    ones too; those of other models have usual rows from jets.

    Whatever is not finite, misshaped or too old on the way from the plant to the rows makes it
    brake, see `Backup`, for as long as that lasts; an alarm, if the plant or the user asks for
    that, until the next reset.

    Args:
        plant: of the environment.
        input_set: U.
        settings: what the user asked.

    Raises:
        UnknownNameError: if a name is not known; the message lists the choices.
        InvalidInputError: if an option is unknown or out of range, guidance is asked for, or the
            plant's barriers are no barriers, or leave an input to the policy that moves them later.
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
        self._planar = plant.model == DoubleIntegrator()
        self._rows_of = GeneralRows(plant.model, self.alpha1, self.alpha2)
        self._late = LateInputs(plant.model)
        self._allows_late, self._said_late = settings.allow_late_inputs, False
        self._monitor = Monitor(plant.model, plant.period, input_set)
        self._backup = Backup(plant, input_set)
        self._last_time, self._alarm = -np.inf, Reason.NONE
        self._m = 0
        if not callable(plant.barriers):
            late = self._check(self._scene(plant.barriers))
            if late:
                raise InvalidInputError(late)

    def restart(self, mask: Mask) -> None:
        """Forget what was known of the plant: a new episode has begun."""
        self._steps[:] = 0.0
        self._last_time, self._alarm = -np.inf, Reason.NONE
        self._monitor.forget()
        self._backup.forget()

    def begin(self, barriers: Any, estimate: Estimate, goal: Any, extent: Any) -> dict[str, Any]:
        """Look at the first state of a new episode, and return what the infos of a reset say.

        Raises:
            InvalidInputError: if a barrier leaves an input to the policy that moves it later.
        """
        reason, sensed = self._sense(estimate)
        found = None
        if sensed is not None:
            self._backup.know(sensed.model)
            found = self._conditions(barriers, sensed, beginning=True)
            if found is not None and self._planar:
                self._doubt(self.check_scene(self._scene(barriers)))
        zeros = np.zeros(self.input_set.n_u)
        if found is None:
            return self._brake(zeros, zeros, reason or Reason.BARRIERS)
        if self._alarm and self.brakes_on_alarm:
            return self._brake(zeros, zeros, self._alarm)
        status = FilterStatus.UNSAFE if found.unsafe else FilterStatus.NOMINAL
        slack = np.zeros(found.rows.b.size)
        result = FilterResult(zeros, slack, slack.copy(), status, 0)
        return self._report(zeros, result, found, self._alarm)

    def step(
        self, u_nominal: Array, barriers: Any, estimate: Estimate
    ) -> tuple[Array, dict[str, Any]]:
        """Filter u* (n_u,), and return u with the report of it.

        Raises:
            InvalidInputError: if u* is not made of n_u finite numbers.
        """
        wanted = finite_array("action", u_nominal, (self.input_set.n_u,))
        reason, sensed = self._sense(estimate)
        if sensed is None:
            self._backup.carry_on()
            self._monitor.skip()
        else:
            self._last_time = self._last_time if sensed.time is None else sensed.time
            self._backup.know(sensed.model)
            self._raise(self._monitor.observe(sensed.body, sensed.model, sensed.covariance))
        told = self._filter(wanted, barriers, sensed, reason)
        self._steps += 1.0
        u = told["u_safe"].copy()
        self._backup.apply(u)
        if sensed is not None:
            self._monitor.expect(sensed.body, sensed.model, u)
        return u, told

    def _filter(
        self, wanted: Array, barriers: Any, sensed: Belief | None, reason: Reason
    ) -> dict[str, Any]:
        """Return the report of one step: the program's answer, or the brake."""
        if sensed is None:
            return self._brake(wanted, self._backup.input(), reason)
        found = self._conditions(barriers, sensed, beginning=False)
        if found is None:
            return self._brake(wanted, self._backup.input(), Reason.BARRIERS)
        if self._alarm and self.brakes_on_alarm:
            return self._stop(wanted, found)
        result = self._solve(wanted, found.rows)
        if result is None:
            return self._brake(wanted, self._backup.input(), Reason.SOLVER)
        if found.unsafe:
            result = result._replace(status=FilterStatus.UNSAFE)
        return self._report(wanted, result, found, self._alarm, self._stands(sensed.x, wanted))

    def _stop(self, wanted: Array, found: Conditions) -> dict[str, Any]:
        """Return the report of a step after an alarm: the plant is brought to rest.

        The state is believed, but the plant no longer: what it does by itself may bring it to a
        region, and the program's answer to the braking input keeps it away. Where the position
        itself is in doubt, or the user says how the plant brakes, that input is applied as it is.
        """
        braking = self._backup.input()
        result = None
        if self._alarm != Reason.MOTION and self.plant.brake is None:
            result = self._solve(braking, found.rows)
        if result is None:
            return self._brake(wanted, braking, self._alarm)
        result = result._replace(status=FilterStatus.BACKUP)
        return self._report(wanted, result, found, self._alarm)

    def _sense(self, estimate: Estimate) -> tuple[Reason, Belief | None]:
        """Return what can be believed of an estimate, or the reason why nothing can."""
        alarm = alarm_of(estimate)
        if alarm is None:
            return Reason.STATE, None
        self._raise(alarm)
        known = examine(estimate, self.plant.model.n, self._last_time, self.plant.max_age)
        return (known, None) if isinstance(known, Reason) else (Reason.NONE, known)

    def _raise(self, alarm: Reason) -> None:
        """Latch the first alarm of an episode."""
        if alarm and not self._alarm:
            self._alarm = alarm
            self._announcer.say(alarm)

    def _conditions(self, barriers: Any, sensed: Belief, beginning: bool) -> Conditions | None:
        """Return the rows of the present state; None where there are none to rely on.

        Raises:
            InvalidInputError: at the beginning of an episode, if a barrier leaves an input to the
                policy that moves it later.
        """
        try:
            with np.errstate(all="ignore"):
                scene = self._scene(barriers)
                late = self._check(scene)
                found = self._rows(scene, sensed)
            check_rows(_without_gaps(found.rows), self.input_set.n_u)
        except UNREADABLE:
            return None
        if late and beginning:
            raise InvalidInputError(late)
        if late:
            self._say_once(late)
            return None
        return found

    def _solve(self, u_nominal: Array, rows: CbfRows) -> FilterResult | None:
        """Return the program's answer; None where no solver has one that is finite."""
        try:
            result = self.program(u_nominal, _without_gaps(rows))
        except (SolverError, ArithmeticError, np.linalg.LinAlgError):
            return None
        failed = result.status == FilterStatus.BACKUP or not np.isfinite(result.u).all()
        m = rows.b.size
        return None if failed else result._replace(slack=result.slack[:m], delta=result.delta[:m])

    def _stands(self, x: Array, u_nominal: Array) -> bool:
        """Tell whether the plant stands though u* asks it to move, where the model knows v."""
        at = self.plant.model.velocity_at
        if at is None:
            return False
        return bool(
            np.linalg.norm(x[at : at + 2]) < STANDING and np.linalg.norm(u_nominal) > ASKING
        )

    def _scene(self, barriers: Any) -> Any:
        """Return barriers of the planar double integrator as a set of one scene; others as given.

        Raises:
            InvalidInputError: if they are no sequence of barriers.
        """
        if not self._planar or isinstance(barriers, BarrierSet):
            return barriers
        if not isinstance(barriers, Sequence) or isinstance(barriers, str):
            raise InvalidInputError(f"barriers: got {barriers!r}, expected a sequence of Barriers")
        return BarrierSet([tuple(barriers)])

    def _check(self, barriers: Any) -> str:
        """Refuse what is no list of barriers, and return what is late in it; "" for nothing.

        Raises:
            InvalidInputError: on other values, or if no input reaches a barrier.
        """
        if isinstance(barriers, BarrierSet):
            if not self._planar or len(barriers.kind) != 1:
                raise InvalidInputError(
                    f"plant: got a BarrierSet of {len(barriers.kind)} scenes with "
                    f"{self.plant.model}, expected a sequence of barriers: a set makes rows of the "
                    "planar double integrator alone, and a plant has one scene"
                )
            self._m, own = barriers.kind.shape[1], tuple(barriers.own.values())
        else:
            own = check_barriers(barriers)
            self._m = len(own)
        late = "; ".join(self._late.find(own, self._rows_of.prepare(own).reaches))
        if late and self._allows_late:
            self._say_once(f"{late}: allowed")
            return ""
        return f"{late}; {REMEDY}" if late else ""

    def _say_once(self, message: str) -> None:
        """Warn of inputs that come late, once for all of them."""
        if not self._said_late:
            self._said_late = True
            warnings.warn(f"safety filter: {message}", stacklevel=5)

    def _rows(self, barriers: Any, sensed: Belief) -> Conditions:
        """Return the rows (m,) of the present state, with their margins and conditioning."""
        x, time = sensed.x, sensed.time
        if time is None:
            time = float(self._steps[0]) * (self.plant.period or 0.0)
        if isinstance(barriers, BarrierSet):
            lag = np.zeros(4) if sensed.lag is None else sensed.lag
            spread = np.zeros((4, 4)) if sensed.covariance is None else sensed.covariance
            source = None
            if barriers.atlas:
                barriers, source = barriers.at_hand(
                    self.row_settings, self.uncertainty, self.input_set.radius, x, sensed.model,
                    lag, spread,
                )  # fmt: skip
            now = x[None], np.array([time])
            margin, rate = derive_all(
                self.uncertainty, barriers, *now, sensed.model[None], lag[None], spread[None]
            )
            batch = barriers.rows(*now, self.row_settings, margin, rate)
            rows = CbfRows(*(field[0] for field in batch if field is not None))
            seen = barriers.kind[0], rows.priority, rows.a, rows.h
            unsafe = bool(is_unsafe(*seen, self.uncertainty.body))
            return Conditions(rows, margin[0], np.ones(rows.b.size), unsafe, source)
        distance = self.uncertainty.distance + self.uncertainty.body
        margin = self._rows_of.prepare(barriers).margins(distance)
        rows = self._rows_of(barriers, x, time, margin)
        unsafe = bool((rows.h[rows.priority == 1] < 0.0).any())
        return Conditions(rows, margin, self._rows_of.conditioning, unsafe)

    def _brake(self, u_nominal: Array, u: Array, reason: Reason) -> dict[str, Any]:
        """Return the report of a step in which the filter brakes, and say so once."""
        self._announcer.say(reason)
        nothing = np.zeros(self._m)
        rows = CbfRows(np.zeros((self._m, u.size)), nothing, nothing, nothing.astype(np.int64))
        result = FilterResult(u, nothing, nothing, FilterStatus.BACKUP, 0)
        return self._report(u_nominal, result, Conditions(rows, nothing, nothing, False), reason)

    def _report(
        self,
        u_nominal: Array,
        result: FilterResult,
        found: Conditions,
        reason: Reason,
        stands: bool = False,
    ) -> dict[str, Any]:
        """Return what ``info["safety_filter"]`` says of one call."""
        change = result.u - u_nominal
        rows = {"slack": result.slack, "delta": result.delta, "margin": found.margin}
        rows |= {"conditioning": found.conditioning}
        if found.source is not None:
            rows = {name: self._by_class(values, found.source) for name, values in rows.items()}
        told = {
            "intervention": np.sqrt(change @ change),
            "fallbacks": result.fallbacks,
            "model_error": self._monitor.error,
            "deadlock": stands,
            "alpha1_scale": self.alpha1_scale,
            "status": result.status,
            "reason": reason,
            "covered": self._coverage[0],
        }
        inputs = {"u_nominal": u_nominal, "u_safe": result.u}
        return report.of_one(inputs, rows, told)

    def _by_class(self, values: Array, source: Integers) -> Array:
        """Return (m,) the greatest of what is said of the rows of each condition, 0 for none."""
        most = np.zeros(self._m)
        np.maximum.at(most, source, values)
        return most


def _without_gaps(rows: CbfRows) -> CbfRows:
    """Return rows whose ranks are 1, 2, …: what is not in sight leaves gaps in a list of barriers.

    Where nothing strict is in sight, a last row of rank 1 asks for nothing.
    """
    ranks = np.unique(rows.priority)
    if np.array_equal(ranks, np.arange(1, ranks.size + 1)):
        return rows
    lower = ranks[ranks > 1]
    priority = np.where(rows.priority == 1, 1, 2 + np.searchsorted(lower, rows.priority))
    rows = rows._replace(priority=priority)
    if ranks[0] == 1:
        return rows
    psi = None if rows.alpha2_psi is None else np.append(rows.alpha2_psi, 0.0)
    return CbfRows(
        np.vstack([rows.a, np.zeros(rows.a.shape[1])]),
        np.append(rows.b, -1.0),
        np.append(rows.h, 1.0),
        np.append(priority, 1),
        psi,
    )
