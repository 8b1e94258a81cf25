"""The record of all that a safety filter has to know of an environment."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array, Info
from hcbf_gym.errors import (
    InvalidInputError,
    choose,
    finite_array,
    finite_float,
    instance,
    reals,
    shown,
)
from hcbf_gym.models import input_sets
from hcbf_gym.models.axle import Axle
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.reduced_order import DoubleIntegrator, ReducedOrderModel

Reader = Callable[[Any, Any, Info], Any]
"""A function of the unwrapped environment, the latest observation and the latest info."""


class Coverage(IntEnum):
    """Whether the promise was tested for a plant and a scene; see ``docs/guarantees.md``.

    OUTSIDE: an argument of the plant or the filter is outside of the tested ranges. COVERED: all
    arguments are within, and the family of the scene was tested. SCENE: all arguments are within,
    but the family of the scene was not tested.
    """

    OUTSIDE = 0
    COVERED = 1
    SCENE = 2


class CoveredBy(IntEnum):
    """Why `covered` is not 1; 0 where it is.

    UNKNOWN: the plant has no certificate. ARGUMENT: an argument of the environment is outside of
    the tested ranges. VERSION: this is a development version, or one that was not tested.
    CERTIFICATE: the filter's certificate is of another plant. PLANT: the filter's plant is not the
    environment's. FILTER: an argument of the filter is outside of the tested ranges. INPUTS: U
    lacks inputs that rows, regions and the speed limit require. SCENE: the family of the scene was
    not tested. CHANGED: the scene changed within the episode.
    """

    NONE = 0
    UNKNOWN = 1
    ARGUMENT = 2
    VERSION = 3
    CERTIFICATE = 4
    PLANT = 5
    FILTER = 6
    INPUTS = 7
    SCENE = 8
    CHANGED = 9


class Estimate(NamedTuple):
    """The estimate of a plant's state at one instant. Estimates of N plants have a leading axis.

    Attributes:
        x: (n,) state of the reduced-order model, as the rows read it.
        time: the time since the reset [s]; None lets the filter count its own steps.
        covariance: (n, n) the covariance of x; None where x is the true state.
        model: (n,) the state of the reduced-order model itself; None where x is that state.
        lag: (n,) the body's state minus the reduced-order model's; None where they are the same.
        heading: the heading of the body [rad]; None where it has none.
        age: the age of the measurement [s]; None where it is new, infinite where it is missing.
        elapsed: the time since the sample before [s]; None takes the plant's period. For models
            other than the planar double integrator, a sample after a time that is not the period is
            not compared with the one before.
        fault: an alarm that the plant itself raises, a `Reason` from `INPUT` on; None or 0 if none.
    """

    x: Array
    time: Any = None
    covariance: Array | None = None
    model: Array | None = None
    lag: Array | None = None
    heading: ArrayLike | None = None
    age: ArrayLike | None = None
    fault: ArrayLike | None = None
    elapsed: ArrayLike | None = None


class Uncertainty(NamedTuple):
    """The deviations of a plant from its reduced-order model, from which margins are derived.

    `docs/guarantees.md` has the formula for every model. A filter refuses `per_velocity` of a model
    whose velocity is the input, and the reserves of a speed limit of a model without velocity.

    Attributes:
        distance: the constant reserve of rows on the position [m].
        per_velocity: the reserve for each m/s that the body approaches a region faster than the
            model [s].
        per_lead: the reserve for each metre that the model is ahead of the body [-].
        cap: the greatest sum of the two reserves before [m].
        confidence: the number of standard deviations of the estimate that are reserved [-].
        body: the radius of the body around its centre [m].
        speed: the constant reserve of a speed limit [m/s].
        speed_per_velocity: its reserve for each m/s between the body and the model [-].
    """

    distance: float = 0.0
    per_velocity: float = 0.0
    per_lead: float = 0.0
    cap: float = 0.0
    confidence: float = 3.0
    body: float = 0.0
    speed: float = 0.0
    speed_per_velocity: float = 0.0


CAUTIOUS = 2.0
"""The gain for a plant that may lag behind its model or be pushed [1/s]."""
EXACT = Uncertainty()
"""The uncertainty of a plant that moves exactly as its model."""

ON_ALARM = {"warn": False, "brake": True}
"""Reaction to an alarm → whether the plant brakes."""


@dataclass(frozen=True, eq=False)
class Plant:
    """The reduced-order model behind an environment, and how to read and drive it.

    A field may be a `Reader`. Readers are called at every step; those of goal and extent only with
    guidance, and that of `declared` only if a certificate is compared. An error of a reader at the
    first reset is raised; at a later step the plant brakes. Positions may be those of a survey,
    such as UTM's: if a plant starts far from the origin, they count from its start. Entries that a
    vector's infos do not have are NaN for its readers.

    Args:
        model: ẋ = f(x) + g(x)u.
        barriers: the ranked conditions: a sequence, or a reader that returns one at every step, for
            obstacles that move or are sensed; for N plants one sequence for all, or N. The time of
            a moving shape begins when its object is first returned since the reset.
        state: a reader that returns x (n,), or an `Estimate`.
        input_set: U; None means the environment's action space, which must then be a bounded Box.
        to_action: u (n_u,) → the environment's action; None where they are the same. If it raises,
            a step raises an InvalidInputError before it steps the environment.
        from_action: the environment's action → u (n_u,), as `to_action`.
        period: the time for which an action is held [s]; None where it is not known, which excludes
            rows for a held input.
        goal: (2,) the point to which guidance leads [m], or a reader of it; None where none is
            known. When it has moved by more than a cell, its field is computed anew. Where no path
            leads there, the plant brakes with the reason GOAL.
        extent: ((x_min, y_min), (x_max, y_max)) of the world [m], or a reader of it; None lets
            guidance take it from barriers, state and goal.
        uncertainty: how far the plant may deviate from its model; the default is an exact model.
        gain: slope of α₂ and of α of speed limits unless the filter is given them, at most 0.5/T
            [1/s]. 10 changes the input less, and suits a plant that moves as its model. 2 gives a
            plant that lags or is pushed the time to brake. `docs/rows.md` has the table.
        brake: u (n_u,) that brings the plant to rest, or a function of its state x (n,) that
            returns it; None takes the model's own, `ReducedOrderModel.brake`. The filter applies
            it where no state is valid, and after an alarm that makes it brake.
        max_age: the greatest age of a state that is accepted [s]; None accepts any.
        on_alarm: "warn" warns once, "brake" brings the plant to rest until the next reset.
        covered: a `Coverage`, a `certificates.Judged` with its reasons, or a reader of either.
            Within an episode it may end, and not begin.
        axle: the limits of a differential drive, whose x is that of the point ahead of its axle,
            with ``model=DoubleIntegrator()``; its estimates have a `heading`. None for all others.
        braking: deceleration with which the body stops from its greatest speed, its delay behind
            the model included [m/s²]; None takes the deceleration that U allows.
        fastest: the greatest speed that the plant can reach without a speed limit [m/s]; None where
            it is not known.
        declared: name → value of all that identifies this plant besides its fields, or a reader of
            it; certificates compare both. None compares the fields alone.

    Raises:
        InvalidInputError: if only one of `to_action` and `from_action` is given, `state` cannot be
            called, the period or the age is not positive, an uncertainty is negative, or the
            braking input is not made of n_u finite numbers.
        UnknownNameError: if `on_alarm` is neither "warn" nor "brake".
    """

    model: ReducedOrderModel
    barriers: object
    state: Reader
    input_set: InputSet | None = None
    to_action: Callable[[Array], object] | None = None
    from_action: Callable[[Any], Any] | None = None
    period: float | None = None
    goal: ArrayLike | Reader | None = None
    extent: ArrayLike | Reader | None = None
    uncertainty: Uncertainty = EXACT
    gain: float = CAUTIOUS
    brake: ArrayLike | Callable[[Array], ArrayLike] | None = None
    max_age: float | None = None
    on_alarm: str = "warn"
    covered: object = Coverage.OUTSIDE
    axle: Axle | None = None
    braking: float | None = None
    fastest: float | None = None
    declared: Mapping[str, object] | Reader | None = None

    def __post_init__(self) -> None:
        instance("plant: model", self.model, ReducedOrderModel)
        if self.input_set is not None:
            inputs = input_sets.read("plant: input_set", self.input_set)
            object.__setattr__(self, "input_set", inputs)
        if not callable(self.state):
            raise InvalidInputError(
                f"plant: got state {shown(self.state)}, expected a function (env, observation, "
                "info)"
            )
        if (self.to_action is None) != (self.from_action is None):
            raise InvalidInputError(
                "plant: one of to_action and from_action is missing, expected both or none"
            )
        finite_float("plant: gain", self.gain, minimum=0.0, exclusive=True)
        for name in ("period", "max_age", "braking", "fastest"):
            given = getattr(self, name)
            if given is not None:
                finite_float(f"plant: {name}", given, minimum=0.0, exclusive=name != "max_age")
        if self.brake is not None and not callable(self.brake):
            finite_array("plant: brake", self.brake, (self.model.n_u,))
        for name, shape in (("goal", (2,)), ("extent", (2, 2))):
            given = getattr(self, name)
            if given is not None and not callable(given):
                is_of_one = reals(f"plant: {name}", given).ndim <= len(shape)
                finite_array(f"plant: {name}", given, shape if is_of_one else (None, *shape))
        choose("on_alarm", self.on_alarm, ON_ALARM)
        if self.axle is not None:
            instance("plant: axle", self.axle, Axle).checked()
            if self.period is None:
                raise InvalidInputError(
                    "plant: got an axle without a period, expected Plant(period=…) [s]: its U "
                    "depends on it"
                )
            if self.model != DoubleIntegrator():
                raise InvalidInputError(
                    f"plant: got an axle with {self.model}, expected DoubleIntegrator(): the point "
                    "before the axle is one"
                )
        instance("plant: uncertainty", self.uncertainty, Uncertainty)
        for name, value in self.uncertainty._asdict().items():
            finite_float(f"plant: uncertainty: {name}", value, minimum=0.0)

    def __deepcopy__(self, memo: dict[int, object]) -> "Plant":
        """Return this record: it never changes, and its readers may hold a whole environment."""
        return self


def read(source: Any, env: Any, observation: Any, info: Info) -> Any:
    """Return the present value of a plant's field: the value itself, or its reader's result."""
    return source(env, observation, info) if callable(source) else source
