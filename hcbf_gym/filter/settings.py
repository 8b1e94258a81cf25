"""The settings of a filter, the checks of them, and how α and the margins of rows follow."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import programs
from hcbf_gym.arrays import Mask
from hcbf_gym.barriers import class_k
from hcbf_gym.barriers.class_k import ClassK, LogClassK
from hcbf_gym.barriers.relative_degree import samples
from hcbf_gym.errors import InvalidInputError, finite_float
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Plant, Uncertainty
from hcbf_gym.models.reduced_order import ReducedOrderModel

ROW_OPTIONS = ("alpha1", "alpha2", "alpha_speed")
"""The options that belong to rows; all others belong to the program."""

LEAST_DIP = 0.01
"""The least that rows of one instant reserve against the dip of h between samples [unit of h]."""

MAX_CORNERS = 64
"""The greatest number of corners of U from which the dip is derived."""


class FilterSettings(NamedTuple):
    """The arguments of `wrappers.SafetyFilter`, by their names, as a user gave them."""

    program: programs.Named
    rows: str
    guidance: str | Mapping[str, object] | None
    margin: float | None
    solver: str | None
    on_alarm: str | None
    allow_late_inputs: bool
    options: Mapping[str, Any]
    strict: str | Mapping[str, object] = "rows"


def alphas_of(options: Mapping[str, Any], plant: Plant) -> dict[str, ClassK]:
    """Return α₁, α₂ and the α of speeds by their names, in the order of `ROW_OPTIONS`.

    An α that is not among the options is the plant's default.
    """
    linear = class_k.unless_given(plant.period, plant.gain)
    defaults = {"alpha1": LogClassK(), "alpha2": linear, "alpha_speed": linear}
    return {name: class_k.make(options.get(name, alpha)) for name, alpha in defaults.items()}


def input_limits(input_set: InputSet) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the least (2,) and the greatest (2,) entries of the inputs of a planar U."""
    corners = input_set.vertices()
    low_x, low_y = corners.min(axis=0).tolist()
    high_x, high_y = corners.max(axis=0).tolist()
    return (low_x, low_y), (high_x, high_y)


def check_hold(period: float, **alphas: ClassK) -> None:
    """Refuse class-K functions whose rows pass ψ = 0 within one period: α'(0) T > 1."""
    for name, alpha in alphas.items():
        slope = alpha.derivative(0.0)
        if slope * period > 1.0:
            raise InvalidInputError(
                f"{name}: got a slope of {slope:g} 1/s at 0 with a period of {period:g} s, "
                f"expected at most {1.0 / period:g} 1/s: sample faster or take a flatter function"
            )


def dip_of(plant: Plant, input_set: InputSet) -> float:
    """Return the distance that rows of one instant reserve against dips of h: a_p T²/2 or more.

    a_p is the greatest acceleration of the position while an input is held, at sampled states of
    unit size and for the corners of U. A model that is driven by velocities has them in U.
    """
    if plant.period is None:
        return LEAST_DIP
    model, half_period = plant.model, 0.5 * plant.period
    position = slice(model.n_p)
    largest_difference = 0.0  # a_p (T/2)²
    for x in samples(model)[0]:
        for u in input_set.vertices()[:MAX_CORNERS]:
            middle = model.step(x, u, half_period)
            end = model.step(middle, u, half_period)
            difference = end[position] - 2.0 * middle[position] + x[position]
            largest_difference = max(largest_difference, float(np.linalg.norm(difference)))
    return max(LEAST_DIP, 2.0 * largest_difference)


def row_uncertainty(plant: Plant, margin: float | None, dip: float) -> Uncertainty:
    """Return the uncertainty for which rows reserve a margin.

    Its body, and the margin of the speed limit, are the plant's in any case.

    Args:
        plant: a plant with its declared uncertainty.
        margin: the margin of rows on the position [m], given by hand; None derives it.
        dip: what rows of one instant reserve besides [m]; 0 for rows for a held input.
    """
    declared = plant.uncertainty
    if margin is not None:
        distance = finite_float("margin", margin, minimum=0.0)
        return declared._replace(
            distance=distance, per_velocity=0.0, per_lead=0.0, cap=0.0, confidence=0.0
        )
    return declared._replace(distance=declared.distance + dip)


def check_uncertainty(plant: Plant) -> None:
    """Refuse an uncertainty that has no meaning for the plant's model."""
    model, declared = plant.model, plant.uncertainty
    meaningless: dict[str, str] = {}  # field of `Uncertainty` → why
    if model.velocity_at != 2:
        no_velocity = "it has no velocity in x[2:4] that a speed limit reads"
        meaningless = {"speed": no_velocity, "speed_per_velocity": no_velocity}
    if declared.per_velocity > 0.0 and not has_drift(model):
        meaningless["per_velocity"] = "its velocity is the input, so that no body lags behind it"
    for name, reason in meaningless.items():
        value = getattr(declared, name)
        if value > 0.0:
            raise InvalidInputError(
                f"plant: uncertainty: {name}: got {value:g} with {model}, expected 0: {reason}"
            )


def has_drift(model: ReducedOrderModel) -> bool:
    """Return whether the velocity under one input differs between sampled states."""
    terms = model.terms_of(samples(model)[0])
    return any(np.ptp(term[:, : model.n_p], axis=0).any() for term in terms)


def input_states(model: ReducedOrderModel) -> Mask:
    """Return (n,) from which entries of x the monitor infers the input that acted.

    An entry belongs to the motion instead, if an input drives it directly and f neither moves nor
    depends on it.
    """
    states, _ = samples(model)
    is_driven = np.zeros(model.n, dtype=np.bool_)
    is_in_drift = np.zeros(model.n, dtype=np.bool_)
    for x in states:
        f = model.f(x)
        is_driven |= (model.g(x) != 0.0).any(axis=1)
        is_in_drift |= f != 0.0
        for k in range(model.n):
            shifted = x + 0.1 * (np.arange(model.n) == k)
            is_in_drift[k] |= bool((model.f(shifted) != f).any())
    return is_in_drift | ~is_driven
