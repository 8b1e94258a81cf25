"""The immutable configuration of a filter of N plants: validated settings, rows and program."""

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from hcbf_gym import programs
from hcbf_gym.arrays import Records
from hcbf_gym.barriers import axle_rows, braking
from hcbf_gym.barriers.rows import RowSettings
from hcbf_gym.barriers.unknown import Reserve
from hcbf_gym.errors import (
    CoverageWarning,
    InvalidInputError,
    SafetyWarning,
    check_options,
    choose,
    flag,
    warn_caller,
)
from hcbf_gym.filter import gatekeeper, plants
from hcbf_gym.filter.settings import (
    ROW_OPTIONS,
    FilterSettings,
    alphas_of,
    check_hold,
    dip_of,
    input_limits,
    row_uncertainty,
)
from hcbf_gym.guidance.field import CELL, FINE
from hcbf_gym.models.axle import Axle
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import ON_ALARM, Plant
from hcbf_gym.models.reduced_order import DoubleIntegrator

FAR_OFF = 0.15
"""The distance from walls that rows may require of a cart without a warning [m]."""


class FilterConfig:
    """All that a filter of N plants never changes.

    Attributes:
        alpha1: α₁ of the rows, scaled down so that U can brake as they require.
        alpha2: α₂.
        alpha_speed: α of speed limits and zones.
        alpha1_scale: the factor of α₁; 1 if U can brake as hard without it.
        row_settings: how rows are made, for a held input or for one instant.
        uncertainty: what the rows reserve.
        dtype: of the environment's actions.
        words: the numbers of `constants`.
        program: corners of U and weights, see `plants.constants`.
        gate: how manoeuvres satisfy strict conditions; None if rows do.
        solver: the program with a solver by name; None for the compiled program.

    Raises: as `core.FilterCore`.
    """

    def __init__(self, plant: Plant, input_set: InputSet, settings: FilterSettings, count: int):
        choose("rows", settings.rows, dict.fromkeys(("held", "usual")))
        flag("allow_late_inputs", settings.allow_late_inputs)
        if input_set.n_u != plant.model.n_u:
            raise InvalidInputError(
                f"inputs: got a set of {input_set.n_u} entries with {plant.model}, expected "
                f"{plant.model.n_u}: give Plant(input_set=…), and to_action and from_action where "
                "the environment's actions are others"
            )
        allowed = (*ROW_OPTIONS, *programs.options(settings.program))
        check_options(f"safety filter {settings.program!r}", settings.options, allowed)
        if plant.axle is not None and settings.solver is not None:
            raise InvalidInputError(
                f"solver: got {settings.solver!r} with a differential drive, expected None: its U "
                "turns with its heading, which the compiled program follows"
            )
        self.plant, self.input_set, self.settings = plant, input_set, settings
        self.count = count
        self.gate = gatekeeper.read(settings.strict)
        if self.gate is not None:
            gatekeeper.check_plant(plant, settings)
        self._check_axle()
        alphas = alphas_of(settings.options, plant)
        self.alpha1, self.alpha2, self.alpha_speed = alphas.values()
        self.alpha1_scale = self._fit_alpha1()
        held = settings.rows == "held" and self.is_planar and plant.period is not None
        self.row_settings = self._row_settings(held)
        if not held and plant.period is not None:
            check_hold(plant.period, alpha2=self.alpha2, alpha_speed=self.alpha_speed)
        dip = 0.0 if held else dip_of(plant, input_set)
        if plant.axle is not None:
            dip += plant.axle.strays(plant.period or 0.0)
        self.uncertainty = row_uncertainty(plant, settings.margin, dip)
        if plant.period is None:
            warn_caller(
                "safety filter: the plant's period is not known, so that rows are those of one "
                "instant and promise nothing between samples; expected Plant(period=…) [s]",
                SafetyWarning,
            )
        self.dtype = np.dtype(np.float64)
        on_alarm = plant.on_alarm if settings.on_alarm is None else settings.on_alarm
        self.brakes_on_alarm = choose("on_alarm", on_alarm, ON_ALARM)
        self._make_program(held)

    @cached_property
    def reserve(self) -> Reserve:
        """Derives the margins of rows whose h is no built-in shape of the double integrator."""
        declared = self.plant.uncertainty.distance if self.settings.margin is None else 0.0
        reserved, period = self.uncertainty, self.plant.period
        fixed = reserved.distance - declared
        return Reserve(self.plant.model, self.input_set, reserved, fixed, period)

    @property
    def cell(self) -> float:
        """The side of a cell of guidance's field [m], finer for a body that has to pass gaps."""
        return FINE if self.uncertainty.body > 0.0 else CELL

    @cached_property
    def clearance(self) -> float:
        """The distance from strict edges at which guidance leads [m].

        It is what rows reserve. For a body it is also what rows require close to an edge, so that
        guidance leads through no gap that rows close. It is less by half a cell, because a cell is
        open if a place in it is.
        """
        reserved = self.uncertainty.distance + self.uncertainty.body
        if self.uncertainty.body == 0.0:
            return reserved
        axle, period = self.plant.axle, self.plant.period or 0.0
        u_max = self.input_set.radius if axle is None else axle.hardest
        near_edge = 0.5 * u_max * period**2
        if axle is not None:
            settings = self._axle_settings(self.row_settings.held)
            near_edge += axle_rows.wall_clearance(settings, axle.jerk(period))
        return reserved + near_edge - 0.5 * self.cell

    def _check_axle(self) -> None:
        """Refuse a differential drive whose braking is not in U."""
        axle = self.plant.axle
        if axle is None:
            return
        given = self.plant.input_set is not None
        most = self.input_set.radius if given else braking.weakest(self.input_set)
        hardest = axle.braking if given else axle.hardest_of_point
        if hardest > most * (1.0 + 1e-6):  # 32 bits of an action space
            what = "the braking" if given else "the largest input, along and across the heading,"
            raise InvalidInputError(
                f"axle: got {what} of {hardest:.4g} m/s² with {self.input_set}, which holds "
                f"{most:.4g} m/s², expected an Axle(braking=…) within U, or a larger U"
            )

    def _make_program(self, held: bool) -> None:
        """Make the program, and write the constants of compiled code."""
        settings, input_set, plant = self.settings, self.input_set, self.plant
        options = {k: v for k, v in settings.options.items() if k not in ROW_OPTIONS}
        self.solver: programs.Program | None = None
        if settings.solver is not None or input_set.n_u != 2:
            self.solver = programs.make(
                settings.program, input_set=input_set, solver=settings.solver, **options
            )
        numbers: dict[str, Any] = {"ranks": True, "radius": input_set.radius}
        numbers |= {"vertices": np.zeros((1, 1, 2)), "weights": np.zeros((1, 1))}
        if input_set.n_u == 2:
            batch = programs.make_batch(settings.program, input_set=input_set, **options)
            numbers = batch.settings_of(self.count)
            if plant.axle is not None and numbers["by_level"]:  # a strict rank for what moves
                numbers["weights"] = np.insert(numbers["weights"], 1, np.inf, axis=1)
        own = plant.uncertainty.distance if settings.margin is None else 0.0
        lags = self.uncertainty.cap > 0.0  # the robot is not its model
        numbers |= self.uncertainty._asdict()
        numbers |= {"rows": self.row_settings.packed, "period": plant.period or 0.0}
        numbers |= {"brakes": self.brakes_on_alarm, "made": not self.is_planar}
        numbers["observed"] = True
        numbers |= gatekeeper.constants(self.gate, plant, settings.margin)
        numbers["dip"] = 0.0 if held else self.uncertainty.distance - own
        numbers["settles"] = self.uncertainty.per_velocity if lags else 0.0
        numbers["tracking"] = 0.5 * self.uncertainty.distance if lags else 0.0
        if plant.axle is not None:
            numbers |= self._axle_numbers(plant.axle, held)
        self.words, self.program = plants.constants(numbers)

    def _axle_numbers(self, axle: Axle, held: bool) -> dict[str, Any]:
        """Return the constants of a differential drive; warn if rows keep it far off walls."""
        period, settings = self.plant.period or 0.0, self._axle_settings(held)
        clearance = axle_rows.wall_clearance(settings, axle.jerk(period))
        if clearance > FAR_OFF:
            warn_caller(
                f"safety filter: at a period of {period:g} s a cart that turns at "
                f"{axle.turn:g} rad/s stays {clearance:.2g} m off walls besides its margin; "
                "expected a shorter period, or a lower turn or forward speed",
                CoverageWarning,
            )
        corners = np.zeros((1, 4, 2))  # U turns with the heading, and is written at every step
        numbers = {"drives": True, "axle": axle, "jerk": axle.jerk(period), "vertices": corners}
        return numbers | {"axle_rows": settings.packed}

    @property
    def constants(self) -> Records:
        """(1,) record of `plants.CONSTANTS`, a view of `words`."""
        return self.words.view(plants.CONSTANTS)

    def applied_as(self, dtype: DTypeLike) -> None:
        """Set the type of the environment's actions; strict rows reserve the error of rounding."""
        self.dtype = np.dtype(dtype)
        rounds = self.dtype == np.float32
        rounding = 0.5 * np.finfo(np.float32).eps * self.input_set.radius
        self.constants["rounding"] = rounding if rounds else 0.0

    @cached_property
    def gain(self) -> float:
        """The greatest acceleration of the planar velocity that an input causes [m/s²]."""
        if self.plant.axle is not None:
            return self.plant.axle.braking
        model, at = self.plant.model, self.plant.model.velocity_at
        if self.is_planar or at is None:
            return self.input_set.radius
        gain = np.linalg.norm(model.g(np.zeros(model.n))[at : at + 2], 2)
        return float(gain) * self.input_set.radius

    def _fit_alpha1(self) -> float:
        """Scale α₁ so that the robot can brake as its rows require; return the factor."""
        if not isinstance(self.plant.model, DoubleIntegrator):
            return 1.0
        able = braking.weakest(self.input_set)
        if able <= 0.0:
            raise InvalidInputError(
                f"input set: got {self.input_set}, which holds no braking input in some direction; "
                "expected 0 inside it, not on its edge"
            )
        period = self.plant.period if self.settings.rows == "held" else None
        alphas = self.alpha1, self.alpha2, self.alpha_speed
        steepest = max(alpha.derivative(0.0) for alpha in alphas)
        held = period is not None and steepest * period <= 1.0
        brakes = able if self.plant.braking is None else min(able, self.plant.braking)
        factor = braking.share(self._row_settings(held), brakes)
        if factor < 1.0:
            self.alpha1 = self.alpha1.scaled(factor)
        if self.plant.axle is not None:
            stretch = axle_rows.share(self._axle_settings(held), self.plant.axle)
            self.alpha1 = self.alpha1.stretched(stretch)
            factor *= stretch
        return factor

    def _axle_settings(self, held: bool) -> RowSettings:
        """Return the settings of rows on a differential drive's axle."""
        assert self.plant.axle is not None
        period = self.plant.period if held else None
        return self._settings(period, self.plant.axle.hardest)

    @cached_property
    def is_planar(self) -> bool:
        """Whether the model is the planar double integrator, whose rows are compiled and held."""
        return self.plant.model == DoubleIntegrator()

    def _row_settings(self, held: bool) -> RowSettings:
        """Return the settings of rows, for a held input or for one instant."""
        period = self.plant.period if held else None
        if not self.is_planar:
            return self._settings()
        if self.plant.axle is not None:
            return self._settings(period, self.plant.axle.hardest_of_point)
        low, high = input_limits(self.input_set)
        return self._settings(period, self.input_set.radius, (low, high))

    def _settings(self, *limits: Any) -> RowSettings:
        return RowSettings(self.alpha1, self.alpha2, *limits, alpha_speed=self.alpha_speed)
