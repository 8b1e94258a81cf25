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

MAX_UNWARNED_CLEARANCE = 0.15
"""The distance from walls, besides its margin, at which a cart may stay without a warning [m]."""


class FilterConfig:
    """The configuration of a filter of N plants, which does not change after construction.

    Attributes:
        alpha1: α₁ of the rows, scaled down so that U can brake as the rows require.
        alpha2: α₂.
        alpha_speed: α of speed limits and zones.
        alpha1_scale: the factor of α₁; 1 if U can brake as hard without it.
        row_settings: how rows are made, for a held input or for one instant.
        uncertainty: the uncertainty for which rows reserve a margin.
        dtype: the type of the environment's actions.
        brakes_on_alarm: whether an alarm makes the filter brake.
        words: `constants` as numbers, for the core.
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
    def row_margins(self) -> Reserve:
        """Derives the margins of rows whose h is no built-in shape of the double integrator."""
        fixed = self.uncertainty.distance - self._derived_distance
        return Reserve(self.plant.model, self.input_set, self.uncertainty, fixed, self.plant.period)

    @property
    def _derived_distance(self) -> float:
        """The declared error of the position [m]; 0 if the user gives the margin by hand."""
        return self.plant.uncertainty.distance if self.settings.margin is None else 0.0

    @property
    def cell(self) -> float:
        """The side of a cell of guidance's field [m], finer for a body that has to pass gaps."""
        return FINE if self.uncertainty.body > 0.0 else CELL

    @cached_property
    def clearance(self) -> float:
        """The distance from strict edges at which guidance leads [m].

        It is the margin that rows reserve. For a body the distance that rows require close to an
        edge is added, so that guidance leads through no gap that rows close. Half a cell is
        then subtracted, because a cell is open if one place in it is.
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
        if self.plant.input_set is not None:
            name, required, available = "the braking", axle.braking, self.input_set.radius
        else:
            name = "the largest input, along and across the heading,"
            required, available = axle.hardest_of_point, braking.weakest(self.input_set)
        if required > available * (1.0 + 1e-6):  # limits of an action space have 32 bits
            raise InvalidInputError(
                f"axle: got {name} of {required:.4g} m/s² with {self.input_set}, which holds "
                f"{available:.4g} m/s², expected an Axle(braking=…) within U, or a larger U"
            )

    def _make_program(self, held: bool) -> None:
        """Make the program, and the constants of compiled code, which `plants.hpp` documents."""
        settings, input_set, plant = self.settings, self.input_set, self.plant
        options = {k: v for k, v in settings.options.items() if k not in ROW_OPTIONS}
        self.solver: programs.Program | None = None
        if settings.solver is not None or input_set.n_u != 2:
            self.solver = programs.make(
                settings.program, input_set=input_set, solver=settings.solver, **options
            )
        if input_set.n_u == 2:
            batch = programs.make_batch(settings.program, input_set=input_set, **options)
            constants = batch.settings_of(self.count)
            if plant.axle is not None and constants["by_level"]:
                # rows of regions that move have a strict rank of their own
                constants["weights"] = np.insert(constants["weights"], 1, np.inf, axis=1)
        else:  # the compiled program is not called
            constants = {"ranks": True, "radius": input_set.radius}
            constants |= {"vertices": np.zeros((1, 1, 2)), "weights": np.zeros((1, 1))}
        uncertainty = self.uncertainty
        is_its_model = uncertainty.cap <= 0.0
        constants |= {
            **uncertainty._asdict(),
            "rows": self.row_settings.packed,
            "period": plant.period or 0.0,
            "brakes": self.brakes_on_alarm,
            "made": not self.is_planar,
            "observed": True,
            **gatekeeper.constants(self.gate, plant, settings.margin),
            "dip": 0.0 if held else uncertainty.distance - self._derived_distance,
            "settles": 0.0 if is_its_model else uncertainty.per_velocity,
            "tracking": 0.0 if is_its_model else 0.5 * uncertainty.distance,
        }
        if plant.axle is not None:
            constants |= self._axle_constants(plant.axle, held)
        self.words, self.program = plants.constants(constants)

    def _axle_constants(self, axle: Axle, held: bool) -> dict[str, Any]:
        """Return the constants of a differential drive; warn if its rows forbid to near walls."""
        period, settings = self.plant.period or 0.0, self._axle_settings(held)
        clearance = axle_rows.wall_clearance(settings, axle.jerk(period))
        if clearance > MAX_UNWARNED_CLEARANCE:
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
        relative_error = 0.5 * np.finfo(np.float32).eps if self.dtype == np.float32 else 0.0
        self.constants["rounding"] = relative_error * self.input_set.radius

    @cached_property
    def gain(self) -> float:
        """The greatest acceleration of the planar velocity that an input causes [m/s²]."""
        if self.plant.axle is not None:
            return self.plant.axle.braking
        model = self.plant.model
        if self.is_planar or model.velocity_at is None:
            return self.input_set.radius
        velocity = slice(model.velocity_at, model.velocity_at + 2)
        gain = np.linalg.norm(model.g(np.zeros(model.n))[velocity], 2)
        return float(gain) * self.input_set.radius

    def _fit_alpha1(self) -> float:
        """Scale α₁ so that the robot can brake as its rows require; return the factor."""
        if not isinstance(self.plant.model, DoubleIntegrator):
            return 1.0
        deceleration = braking.weakest(self.input_set)
        if deceleration <= 0.0:
            raise InvalidInputError(
                f"input set: got {self.input_set}, which holds no braking input in some direction; "
                "expected 0 inside it, not on its edge"
            )
        if self.plant.braking is not None:
            deceleration = min(deceleration, self.plant.braking)
        alphas = self.alpha1, self.alpha2, self.alpha_speed
        steepest = max(alpha.derivative(0.0) for alpha in alphas)
        period = self.plant.period if self.settings.rows == "held" else None
        held = period is not None and steepest * period <= 1.0  # if not, it is refused later
        factor = braking.share(self._row_settings(held), deceleration)
        if factor < 1.0:
            self.alpha1 = self.alpha1.scaled(factor)
        if self.plant.axle is not None:
            stretch = axle_rows.share(self._axle_settings(held), self.plant.axle)
            self.alpha1 = self.alpha1.stretched(stretch)
            factor *= stretch
        return factor

    def _axle_settings(self, held: bool) -> RowSettings:
        """Return the settings of rows on a differential drive's axle, see `_row_settings`."""
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
        return self._settings(period, self.input_set.radius, input_limits(self.input_set))

    def _settings(self, *hold_and_limits: Any) -> RowSettings:
        alphas = self.alpha1, self.alpha2
        return RowSettings(*alphas, *hold_and_limits, alpha_speed=self.alpha_speed)
