"""What stands between u* and u: the settings that both cores share, and their choice."""

import warnings
from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import programs, records
from hcbf_gym.arrays import Array, Integers, Mask, Records
from hcbf_gym.barriers import braking, class_k
from hcbf_gym.barriers.class_k import ClassK, LogClassK
from hcbf_gym.barriers.relative_degree import samples
from hcbf_gym.barriers.rows import RowSettings
from hcbf_gym.barriers.set import BarrierSet, Condition
from hcbf_gym.certificates import Judged
from hcbf_gym.errors import (
    CoverageWarning,
    InvalidInputError,
    SafetyWarning,
    as_array,
    check_options,
    choose,
    finite_float,
)
from hcbf_gym.filtering.alarms import ReasonWarnings
from hcbf_gym.filtering.certified import Earned
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import ON_ALARM, Coverage, CoveredBy, Estimate, Plant, Uncertainty
from hcbf_gym.models.reduced_order import DoubleIntegrator

ROW_OPTIONS = ("alpha1", "alpha2")

USUAL_ROWS_MARGIN = 0.01
"""What usual rows reserve at least, against the dip of h between two samples [unit of h]."""

MOST_CORNERS = 64
"""Of U, that are looked at for the dip."""

BY_ITSELF = np.array([CoveredBy.UNKNOWN, CoveredBy.NONE, CoveredBy.SCENE])
"""Why, of a `Coverage` that says no more."""


class FilterSettings(NamedTuple):
    """What the user asked of a filter.

    Attributes:
        program: its name, or a plan.
        rows: "held" or "usual".
        guidance: "geodesic", "local", a plain dict with more of it, or None.
        margin: [m]; None derives it.
        solver: its name; None is the compiled path where there is one.
        on_alarm: "warn" or "brake"; None takes the plant's.
        allow_late_inputs: whether a row may miss an input that helps later.
        options: α₁, α₂ and the program's own.
    """

    program: programs.Named
    rows: str
    guidance: Any
    margin: float | None
    solver: str | None
    on_alarm: str | None
    allow_late_inputs: bool
    options: dict[str, Any]


def plain_options(options: dict[str, Any]) -> dict[str, Any]:
    """Return options in JSON's terms, class-K functions as dicts, for a wrapper's spec."""
    kinds = class_k.KINDS
    return {
        key: records.to_dict(value, kinds) if type(value) in kinds.values() else value
        for key, value in options.items()
    }


class FilterCore(ABC):
    """A filter of N plants: its settings, read once at the door.

    Attributes:
        alpha1: α₁ as the rows have it, scaled down where U cannot brake what it asks for.
        alpha2: α₂.
        alpha1_scale: by which factor; 1 where U can.
        row_settings: how rows are made, for a held input where that was asked for.
        uncertainty: what they reserve.
        dip: what of it usual rows reserve against dips between samples [unit of h].
        sway: what of the constant part a robot may use that is not its model [m].
        told_as: the type of the environment's actions.
        settles: how long the robot takes to follow [s]; 0 for one that is its model.

    Args:
        plant: of the environment.
        input_set: U.
        settings: what the user asked.
        count: N.

    Raises:
        UnknownNameError: if a name is not known; the message lists the choices.
        InvalidInputError: if an option is unknown or out of range, or the hold is too long for α₁
            or α₂.
    """

    def __init__(self, plant: Plant, input_set: InputSet, settings: FilterSettings, count: int):
        choose("rows", settings.rows, dict.fromkeys(("held", "usual")))
        allowed = (*ROW_OPTIONS, *programs.options(settings.program))
        check_options(f"safety filter {settings.program!r}", settings.options, allowed)
        self.plant, self.input_set, self.count = plant, input_set, count
        self.settings = settings
        self.alpha1: ClassK = class_k.make(settings.options.get("alpha1", LogClassK()))
        self.alpha2: ClassK = class_k.make(settings.options.get("alpha2", 2.0))
        self.alpha1_scale = self._fit_alpha1()
        held = settings.rows == "held" and self._is_planar and plant.period is not None
        self.row_settings = self._row_settings(held)
        if not held and plant.period is not None:
            check_hold(plant.period, alpha2=self.alpha2)
        self.uncertainty = kept(plant, settings.margin, 0.0 if held else dip_of(plant, input_set))
        own = plant.uncertainty.distance if settings.margin is None else 0.0
        self.dip = 0.0 if held else self.uncertainty.distance - own
        leans = self.uncertainty.cap > 0.0
        self.settles = self.uncertainty.per_velocity if leans else 0.0
        self.sway = 0.5 * self.uncertainty.distance if leans else 0.0
        self._hold = plant.period, input_set.radius
        if plant.period is None:
            warnings.warn(
                "safety filter: the plant's period is not known, so that rows are those of one "
                "instant and promise nothing between samples; expected Plant(period=…) [s]",
                SafetyWarning,
                stacklevel=4,
            )
        self.told_as = np.dtype(np.float64)
        self._said: set[str] = set()
        self.program_options = {k: v for k, v in settings.options.items() if k not in ROW_OPTIONS}
        self._steps: Array = np.zeros(count)
        on_alarm = plant.on_alarm if settings.on_alarm is None else settings.on_alarm
        self.brakes_on_alarm = choose("on_alarm", on_alarm, ON_ALARM)
        self._warnings = ReasonWarnings(self.brakes_on_alarm)
        self._coverage: Integers = np.zeros(count, dtype=np.int64)
        self._covered_by: Integers = np.zeros(count, dtype=np.int64)
        self._fresh: Mask = np.ones(count, dtype=np.bool_)

    def applied_as(self, dtype: Any) -> None:
        """Note the type of the environment's actions: what the filter tells is what arrives."""
        self.told_as = np.dtype(dtype)

    def cover(self, said: Any) -> None:
        """Note whether the promise was tested for the episodes that begin.

        Args:
            said: a `Judged`, or a `Coverage` or (N,) of them by itself.

        Raises:
            InvalidInputError: if it is none.
        """
        given = as_array("covered", said.covered if isinstance(said, Judged) else said)
        known = given.dtype.kind in "iu" and np.isin(given, list(Coverage)).all()
        if not known or given.shape not in ((), (self.count,)):
            raise InvalidInputError(f"covered: got {said!r}, expected one of {list(Coverage)}")
        why = said.covered_by if isinstance(said, Judged) else BY_ITSELF[given]
        for kept, news in ((self._coverage, given), (self._covered_by, why)):
            kept[self._fresh] = np.broadcast_to(news, self.count)[self._fresh]

    def tell_coverage(self, plants: Records) -> None:
        """Write what is covered and why into (N,) reports."""
        plants["covered"], plants["covered_by"] = self._coverage, self._covered_by

    def _doubt(self, scenes: Integers) -> None:
        """Cover no episode that begins in a scene where rank 1 cannot be promised.

        What is promised is a sufficient condition: it does not overrule episodes that showed it.

        Args:
            scenes: a `Coverage` of each such episode's scene, as `check_scene` returns it.
        """
        known = self._coverage[self._fresh]
        shown = isinstance(self.plant.covered, Earned) & (known == Coverage.COVERED)
        doubted = (scenes == Coverage.OUTSIDE) & ~shown & (known != Coverage.OUTSIDE)
        self._coverage[self._fresh] = np.where(doubted, scenes, known)
        why = self._covered_by[self._fresh]
        self._covered_by[self._fresh] = np.where(doubted, CoveredBy.INPUTS, why)

    def _fit_alpha1(self) -> float:
        """Scale α₁ down to what U can brake, and return the factor, which reports repeat.

        Raises:
            InvalidInputError: if U cannot brake in some direction at all.
        """
        if not isinstance(self.plant.model, DoubleIntegrator):
            return 1.0
        able = braking.weakest(self.input_set)
        if able <= 0.0:
            raise InvalidInputError(
                f"input set: got {self.input_set}, which holds no braking input in some direction; "
                "expected 0 inside it, not on its edge"
            )
        period = self.plant.period if self.settings.rows == "held" else None
        steepest = max(self.alpha1.derivative(0.0), self.alpha2.derivative(0.0))
        held = period is not None and steepest * period <= 1.0
        factor = braking.share(self._row_settings(held), self.input_set)
        if factor < 1.0:
            self.alpha1 = self.alpha1.scaled(factor)
        return factor

    @property
    def _is_planar(self) -> bool:
        """Whether the model is the planar double integrator, whose rows are compiled and held."""
        return self.plant.model == DoubleIntegrator()

    def _row_settings(self, held: bool) -> RowSettings:
        """Return how rows are made, for a held input or for one instant."""
        period = self.plant.period if held else None
        if not self._is_planar:
            return RowSettings(self.alpha1, self.alpha2)
        low, high = input_limits(self.input_set)
        return RowSettings(self.alpha1, self.alpha2, period, self.input_set.radius, (low, high))

    def check_scene(self, scenes: BarrierSet) -> Integers:
        """Return (N,) a `Coverage` of each scene: OUTSIDE where rank 1 cannot be promised in it.

        Warns once of each thing that α₁, U and the speed limit cannot satisfy.

        Args:
            scenes: of the new episodes.

        Raises:
            InvalidInputError: if the margin leaves nothing of a speed limit, or a held input can
                pass it from rest within one period.
        """
        margin = self.plant.uncertainty.speed
        self.check_limits(scenes)
        covered = np.full(len(scenes.kind), Coverage.COVERED, dtype=np.int64)
        for one in braking.shortcomings(scenes, self.alpha1, self.input_set, margin):
            if not one.promised:
                covered[one.scenes] = Coverage.OUTSIDE
            if one.what not in self._said:
                self._said.add(one.what)
                warnings.warn(f"safety filter: {one.says}", CoverageWarning, stacklevel=5)
        return covered

    def check_limits(self, scenes: BarrierSet) -> None:
        """Refuse speed limits that no input can satisfy.

        Raises:
            InvalidInputError: if the margin leaves nothing of one, or a held input can pass it from
                rest within one period.
        """
        scenes.check(self._hold, self.plant.uncertainty.speed)

    @property
    @abstractmethod
    def conditions(self) -> list[Condition]:
        """Name and rank of the conditions in the order of the report's rows; of plant 0 of N."""

    @abstractmethod
    def restart(self, mask: Mask) -> None:
        """Forget what was known of the masked plants (N,): new episodes have begun there."""

    @abstractmethod
    def begin(self, barriers: Any, estimate: Estimate, goal: Any, extent: Any) -> dict[str, Any]:
        """Look at the first states of new episodes, and return what the infos of a reset say."""

    @abstractmethod
    def step(
        self, u_nominal: Array, barriers: Any, estimate: Estimate
    ) -> tuple[Array, dict[str, Any]]:
        """Filter u* (n_u,) or (N, n_u), and return u with the report of it."""

    def _time(self, estimate: Estimate) -> Any:
        """Return the time since the reset [s], counted here where the plant gives none."""
        if estimate.time is not None:
            return estimate.time
        return self._steps * (self.plant.period or 0.0)


def input_limits(input_set: InputSet) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the least and the greatest entries of the inputs of a planar U."""
    corners = input_set.vertices()
    (low_x, low_y), (high_x, high_y) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    return (low_x, low_y), (high_x, high_y)


def check_hold(period: float, **alphas: ClassK) -> None:
    """Refuse class-K functions whose rows pass ψ = 0 within one period: α'(0) T > 1.

    Raises:
        InvalidInputError: if one does.
    """
    for name, alpha in alphas.items():
        steep = alpha.derivative(0.0)
        if steep * period > 1.0:
            raise InvalidInputError(
                f"{name}: got a slope of {steep:g} 1/s at 0 with a period of {period:g} s, "
                f"expected at most {1.0 / period:g} 1/s: sample faster or take a flatter function"
            )


def dip_of(plant: Plant, input_set: InputSet) -> float:
    """Return what usual rows reserve against dips of h between samples, a_p T²/2 or more.

    a_p is the greatest acceleration of the position while an input is held, of the corners of U at
    sampled states of unit size; the velocity of a model that is driven by velocities is in U.

    Args:
        plant: of which model and period count.
        input_set: U.
    """
    if plant.period is None:
        return USUAL_ROWS_MARGIN
    model, half = plant.model, 0.5 * plant.period
    placed = slice(model.n_u) if isinstance(model, DoubleIntegrator) else slice(2)
    hardest = 0.0
    for x in samples(model)[0]:
        for u in input_set.vertices()[:MOST_CORNERS]:
            middle = model.step(x, u, half)
            bent = model.step(middle, u, half)[placed] - 2.0 * middle[placed] + x[placed]
            hardest = max(hardest, float(np.linalg.norm(bent)))
    return max(USUAL_ROWS_MARGIN, 2.0 * hardest)  # bent = a_p (T/2)²


def kept(plant: Plant, margin: float | None, dip: float) -> Uncertainty:
    """Return what the rows reserve: what the plant's uncertainty asks, or a margin given by hand.

    Args:
        plant: whose body and whose speed limit count in any case.
        margin: what rows on the position reserve [m]; None derives it.
        dip: what rows that are not made for a held input reserve besides [m].

    Raises:
        InvalidInputError: if the margin is negative or not finite.
    """
    known = plant.uncertainty
    if margin is not None:
        distance = finite_float("margin", margin, minimum=0.0)
        return known._replace(
            distance=distance, per_velocity=0.0, per_lead=0.0, cap=0.0, confidence=0.0
        )
    return known._replace(distance=known.distance + dip)
