"""The settings of a filter, and what follows from them for its rows."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import programs
from hcbf_gym.barriers import class_k
from hcbf_gym.barriers.class_k import ClassK, LogClassK
from hcbf_gym.barriers.relative_degree import samples
from hcbf_gym.errors import InvalidInputError, finite_float
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Plant, Uncertainty

ROW_OPTIONS = ("alpha1", "alpha2", "alpha_speed")
"""The options that belong to rows; all others belong to the program."""

USUAL_ROWS_MARGIN = 0.01
"""The least that rows of one instant reserve against the dip of h between samples [unit of h]."""

MOST_CORNERS = 64
"""The number of corners of U from which the dip is derived, at most."""


class FilterSettings(NamedTuple):
    """The arguments of `wrappers.SafetyFilter` that a user gave, by their names."""

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
    """Return α₁, α₂ and the α of speeds by their names, from the options or for the plant."""
    linear = class_k.unless_given(plant.period, plant.gain)
    own = LogClassK(), linear, linear
    known = zip(ROW_OPTIONS, own, strict=True)
    return {name: class_k.make(options.get(name, alpha)) for name, alpha in known}


def input_limits(input_set: InputSet) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the least (2,) and the greatest (2,) entries of the inputs of a planar U."""
    corners = input_set.vertices()
    (low_x, low_y), (high_x, high_y) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    return (low_x, low_y), (high_x, high_y)


def check_hold(period: float, **alphas: ClassK) -> None:
    """Refuse class-K functions whose rows pass ψ = 0 within one period: α'(0) T > 1."""
    for name, alpha in alphas.items():
        steep = alpha.derivative(0.0)
        if steep * period > 1.0:
            raise InvalidInputError(
                f"{name}: got a slope of {steep:g} 1/s at 0 with a period of {period:g} s, "
                f"expected at most {1.0 / period:g} 1/s: sample faster or take a flatter function"
            )


def dip_of(plant: Plant, input_set: InputSet) -> float:
    """Return what rows of one instant reserve against dips of h between samples: a_p T²/2 or more.

    a_p is the greatest acceleration of the position while an input is held, at sampled states of
    unit size and for the corners of U. A model that is driven by velocities has them in U.

    Args:
        plant: gives the model and the period T.
        input_set: U.
    """
    if plant.period is None:
        return USUAL_ROWS_MARGIN
    model, half = plant.model, 0.5 * plant.period
    placed = slice(model.n_p)
    hardest = 0.0
    for x in samples(model)[0]:
        for u in input_set.vertices()[:MOST_CORNERS]:
            middle = model.step(x, u, half)
            turned = model.step(middle, u, half)[placed] - 2.0 * middle[placed] + x[placed]
            hardest = max(hardest, float(np.linalg.norm(turned)))
    return max(USUAL_ROWS_MARGIN, 2.0 * hardest)  # turned = a_p (T/2)²


def row_uncertainty(plant: Plant, margin: float | None, dip: float) -> Uncertainty:
    """Return the uncertainty for which rows reserve a margin.

    Args:
        plant: gives it, and in any case its body and the margin of its speed limit.
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
