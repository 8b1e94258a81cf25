"""The filter of one plant of any model, with any barriers, inputs and solver."""

import operator
import warnings
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym import programs
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.barrier import Barrier, reads_time
from hcbf_gym.barriers.convexity import warn_of_concave
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.general import GeneralRows, check_barriers
from hcbf_gym.barriers.late_inputs import REMEDY, LateInputs
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.barriers.set import BarrierSet, Condition
from hcbf_gym.barriers.speed_limit import SpeedLimit
from hcbf_gym.errors import UNREADABLE, InvalidInputError, finite_array
from hcbf_gym.filtering import report, solvers, verdict
from hcbf_gym.filtering.belief import Belief, alarm_of, examine, real_number, real_numbers
from hcbf_gym.filtering.brake import Brake
from hcbf_gym.filtering.core import FilterCore, FilterSettings, check_hold
from hcbf_gym.filtering.monitor import Monitor
from hcbf_gym.models.constants import ASKING, STANDING
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Estimate, Plant, Reason
from hcbf_gym.programs import FilterResult, FilterStatus
from hcbf_gym.programs.program import are_finite

_MEMORY = np.dtype((np.record, verdict.MEMORY))


class Conditions(NamedTuple):
    """What the rows of one state are made of.

    Attributes:
        rows: (m,) of them.
        margin: (m,) what each reserves between h and zero.
        conditioning: (m,) see `GeneralRows`.
        strict: (m,) which are of rank 1 and on the position.
    """

    rows: CbfRows
    margin: Array
    conditioning: Array
    strict: NDArray[np.bool_]


class GeneralCore(FilterCore):
    """The filter of one plant of a model that is not compiled: usual rows from jets, any inputs.

    Whatever is not finite, misshaped or too old on the way from the plant to the rows makes it
    brake, see `Brake`, for as long as that lasts; an alarm, if the plant or the user asks for
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
                f"guidance: got {settings.guidance!r} with {type(plant.model).__name__}, expected "
                "None: only the planar double integrator is guided"
            )
        solver = {} if settings.solver is None else {"solver": settings.solver}
        self.program = programs.make(
            settings.program, input_set=input_set, **solver, **self.program_options
        )
        self._rows_of = GeneralRows(plant.model, self.alpha1, self.alpha2, input_set.support)
        self._late = LateInputs(plant.model)
        self._allows_late, self._said_late = settings.allow_late_inputs, False
        self._said_concave = False
        self._monitor = Monitor(plant.model, plant.period, input_set)
        self._braking = Brake(plant, input_set)
        self._rules = verdict.Rules(
            self.alpha1.parameters(),
            self.alpha2.parameters(),
            self.dip,
            self.sway,
            plant.period or 0.0,
            self.settles,
            self.uncertainty.body,
            input_set.radius,
        )
        self._last_time, self._alarm = -np.inf, Reason.NONE
        self._memory: Any = np.zeros(1, dtype=_MEMORY)
        self._follows = False  # whether the last state was believed
        self._barriers: tuple[Barrier, ...] = ()
        self._needs_time, self._late_inputs, self._checked = False, "", False
        self._margin, self._strict = np.zeros(0), np.zeros(0, dtype=np.bool_)
        if not callable(plant.barriers):
            late = self._check(plant.barriers)
            if late:
                raise InvalidInputError(late)

    @property
    def conditions(self) -> list[Condition]:
        """Name and rank of the conditions, in the order of the report's rows."""
        return [Condition(barrier.name, barrier.priority) for barrier in self._barriers]

    def restart(self, mask: Mask) -> None:
        """Forget what was known of the plant: a new episode has begun."""
        self._steps[:] = 0.0
        self._last_time, self._alarm = -np.inf, Reason.NONE
        self._memory[:] = 0
        self._follows = False
        self._monitor.forget()
        self._braking.forget()

    def begin(self, barriers: Any, estimate: Estimate, goal: Any, extent: Any) -> dict[str, Any]:
        """Look at the first state of a new episode, and return what the infos of a reset say.

        Raises:
            InvalidInputError: if a barrier leaves an input to the policy that moves it later.
        """
        reason, sensed = self._sense(estimate)
        found = None
        if sensed is not None:
            self._braking.know(sensed.model)
            with np.errstate(all="ignore"):
                found = self._conditions(barriers, sensed, self._terms(sensed), beginning=True)
        self._fresh[:] = False
        zeros = np.zeros(self.input_set.n_u)
        if found is None:
            return self._brake(zeros, zeros, reason or Reason.BARRIERS)
        if self._alarm and self.brakes_on_alarm:
            return self._brake(zeros, zeros, self._alarm)
        slack = np.zeros(found.rows.b.size)
        result = FilterResult(zeros, slack, slack.copy(), FilterStatus.NOMINAL, 0)
        remembered = self._memory.copy()
        told = self._report(zeros, result, found, self._alarm)
        self._memory[:] = remembered
        if told["status"] < FilterStatus.UNSAFE:
            told["status"] = np.int64(FilterStatus.NOMINAL)
        return told

    def step(
        self, u_nominal: Array, barriers: Any, estimate: Estimate
    ) -> tuple[Array, dict[str, Any]]:
        """Filter u* (n_u,), and return u with the report of it.

        Raises:
            InvalidInputError: if u* is not made of n_u finite numbers.
        """
        wanted = real_numbers(u_nominal, (self.input_set.n_u,))
        if wanted is None:
            wanted = finite_array("action", u_nominal, (self.input_set.n_u,))
        reason, sensed = self._sense(estimate)
        if estimate.elapsed is not None and real_number(estimate.elapsed) != self.plant.period:
            self._monitor.skip()
        with np.errstate(all="ignore"):
            if sensed is None:
                self._braking.carry_on()
                self._monitor.skip()
                self._follows = False
                told = self._brake(wanted, self._braking.input(), reason)
            else:
                told = self._filter(wanted, barriers, sensed)
        self._steps += 1.0
        u = told["u_safe"].copy()
        self._braking.apply(u)
        if sensed is not None:
            self._monitor.expect(sensed.body, sensed.model, u)
        return u, told

    def _filter(self, wanted: Array, barriers: Any, sensed: Belief) -> dict[str, Any]:
        """Return the report of a step whose state is believed: the program's answer, or the brake.

        What the plant's own model or barriers raise makes it brake.
        """
        if not self._follows:
            self._memory["news"] = 1
            self._follows = True
        self._last_time = self._last_time if sensed.time is None else sensed.time
        self._braking.know(sensed.model)
        terms = self._terms(sensed)
        if terms is None:
            self._monitor.skip()
        else:
            body = sensed.body
            known = terms if body is sensed.x else None
            self._raise(self._monitor.observe(body, sensed.model, sensed.covariance, known))
        found = self._conditions(barriers, sensed, terms, beginning=False)
        if found is None:
            return self._brake(wanted, self._braking.input(), Reason.BARRIERS)
        if self._alarm and self.brakes_on_alarm:
            return self._stop(wanted, found)
        result = solvers.solve(self.program, wanted, found.rows)
        if result is None:
            return self._brake(wanted, self._braking.input(), Reason.SOLVER)
        return self._report(wanted, result, found, self._alarm, self._stands(sensed.x, wanted))

    def _terms(self, sensed: Belief) -> tuple[Array, Array] | None:
        """Return f and g at the state, None where the model returns none."""
        try:
            return self.plant.model.terms(sensed.x)
        except UNREADABLE:
            return None

    def _stop(self, wanted: Array, found: Conditions) -> dict[str, Any]:
        """Return the report of a step after an alarm: the plant is brought to rest.

        The state is believed, but the plant no longer: what it does by itself may bring it to a
        region, and the program's answer to the braking input keeps it away. Where the position
        itself is in doubt, or the user says how the plant brakes, that input is applied as it is.
        """
        braking = self._braking.input()
        result = None
        if self._alarm not in (Reason.MOTION, Reason.RESPONSE) and self.plant.brake is None:
            result = solvers.solve(self.program, braking, found.rows)
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
            self._warnings.warn(alarm)

    def _conditions(
        self,
        barriers: Any,
        sensed: Belief,
        terms: tuple[Array, Array] | None,
        beginning: bool,
    ) -> Conditions | None:
        """Return the rows of the present state; None where there are none to rely on.

        Raises:
            InvalidInputError: at the beginning of an episode, if a barrier leaves an input to the
                policy that moves it later.
        """
        try:
            late = self._check(barriers)
            found = None if terms is None else self._rows(sensed, terms)
        except UNREADABLE:
            return None
        if found is None or not are_finite(found.rows.a, found.rows.b, found.rows.h):
            return None
        if late and beginning:
            raise InvalidInputError(late)
        if late:
            self._say_once(late)
            return None
        return found

    def _stands(self, x: Array, u_nominal: Array) -> bool:
        """Tell whether the plant stands though u* asks it to move, where the model knows v."""
        at = self.plant.model.velocity_at
        if at is None:
            return False
        return bool(
            np.linalg.norm(x[at : at + 2]) < STANDING and np.linalg.norm(u_nominal) > ASKING
        )

    def _check(self, barriers: Any) -> str:
        """Refuse what is no list of barriers, and return what is late in it; "" for nothing.

        Raises:
            InvalidInputError: on other values, if no input reaches a barrier, or a speed limit
                cannot be satisfied.
        """
        if isinstance(barriers, BarrierSet):
            raise InvalidInputError(
                f"plant: got a BarrierSet with {self.plant.model}, expected a sequence of "
                "barriers: a set makes rows of the planar double integrator alone"
            )
        if _same(barriers, self._barriers) and self._checked:
            return self._late_inputs
        own = check_barriers(barriers)
        self._checked = False
        if not _same(own, self._barriers):
            self._memory["news"], self._barriers = 1, ()
            self._check_limits(own)
            self._needs_time = self.plant.period is None and any(
                reads_time(barrier, self.plant.model.n) for barrier in own
            )
            self._barriers = own
            if not self._said_concave:
                self._said_concave = True
                warn_of_concave([b for b in own if isinstance(b, Function)], self.plant.model)
        prepared = self._rows_of.prepare(own)
        self._margin = prepared.margins(self.uncertainty.distance + self.uncertainty.body)
        self._strict = prepared.share > 0.0
        reaches = prepared.reaches
        if self.plant.period is not None and any(reach.degree > 1 for reach in reaches):
            check_hold(self.plant.period, alpha1=self.alpha1)
        late = "; ".join(self._late.find(own, reaches))
        if late and self._allows_late:
            self._say_once(f"{late}: allowed")
            late = ""
        self._late_inputs, self._checked = f"{late}; {REMEDY}" if late else "", True
        return self._late_inputs

    def _check_limits(self, barriers: tuple[Barrier, ...]) -> None:
        """Refuse speed limits that an input passes within one period.

        Raises:
            InvalidInputError: if there is one.
        """
        limits = [barrier for barrier in barriers if isinstance(barrier, SpeedLimit)]
        at = self.plant.model.velocity_at
        if limits and at is not None:
            gain = np.linalg.norm(self.plant.model.g(np.zeros(self.plant.model.n))[at : at + 2], 2)
            period, radius = self._hold
            BarrierSet([limits]).check((period, float(gain) * radius), self.uncertainty.speed)

    def _say_once(self, message: str) -> None:
        """Warn of inputs that come late, once for all of them."""
        if not self._said_late:
            self._said_late = True
            warnings.warn(f"safety filter: {message}", stacklevel=5)

    def _rows(self, sensed: Belief, terms: tuple[Array, Array]) -> Conditions:
        """Return the rows (m,) of the present state, with their margins and conditioning.

        Raises:
            InvalidInputError: if the time is not known and barriers depend on it.
        """
        barriers, time = self._barriers, sensed.time
        if time is None:
            if self._needs_time:
                raise InvalidInputError("barriers: they move, and neither period nor time is known")
            time = float(self._steps[0]) * (self.plant.period or 0.0)
        rows = self._rows_of(barriers, sensed.x, time, self._margin, terms=terms)
        return Conditions(rows, self._margin, self._rows_of.conditioning, self._strict)

    def _brake(self, u_nominal: Array, u: Array, reason: Reason) -> dict[str, Any]:
        """Return the report of a step in which the filter brakes, and say so once."""
        self._warnings.warn(reason)
        nothing = np.zeros(len(self._barriers))
        result = FilterResult(u, nothing, nothing, FilterStatus.BACKUP, 0)
        told = {"status": FilterStatus.BACKUP}
        unknown = np.full(nothing.size, np.nan)
        rows = {"margin": nothing, "h": unknown, "psi": unknown, "conditioning": nothing}
        return self._told(u_nominal, result, reason, told, rows)

    def _report(
        self,
        u_nominal: Array,
        result: FilterResult,
        found: Conditions,
        reason: Reason,
        stands: bool = False,
    ) -> dict[str, Any]:
        """Return what ``info["safety_filter"]`` says of a step whose state is believed."""
        rows = found.rows
        assert rows.alpha2_psi is not None
        of_rows = rows.priority, rows.h, rows.alpha2_psi
        answer = int(result.status), result.u, result.slack
        status, proved, psi = verdict.judge(
            self._rules, self._memory, of_rows, found.margin, found.strict, u_nominal, answer
        )
        told = {"status": status, "deadlock": stands, "proved": proved}
        kept = {"margin": found.margin, "h": rows.h, "psi": psi}
        kept["conditioning"] = found.conditioning
        return self._told(u_nominal, result, reason, told, kept)

    def _told(
        self,
        u_nominal: Array,
        result: FilterResult,
        reason: Reason,
        told: dict[str, Any],
        rows: dict[str, Array],
    ) -> dict[str, Any]:
        """Return the fields of `filtering.report`: those of any step, and those that were told."""
        if self.told_as != np.float64:
            result = result._replace(u=result.u.astype(self.told_as).astype(np.float64))
        change = result.u - u_nominal
        rows = {"slack": result.slack, "delta": result.delta} | rows
        told |= {
            "intervention": np.sqrt(change @ change),
            "fallbacks": result.fallbacks,
            "model_error": self._monitor.error,
            "alpha1_scale": self.alpha1_scale,
            "reason": reason,
            "covered": self._coverage[0],
            "covered_by": self._covered_by[0],
        }
        return report.of_one({"u_nominal": u_nominal, "u_safe": result.u}, rows, told)


def _same(barriers: Any, others: tuple[Barrier, ...]) -> bool:
    """Return whether a list holds the very same barriers; they never change."""
    if type(barriers) not in (list, tuple) or len(barriers) != len(others):
        return False
    return all(map(operator.is_, barriers, others))
