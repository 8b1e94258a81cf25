"""The settings of a gatekeeper, and the manoeuvres that users register.

A gatekeeper satisfies strict conditions by manoeuvres that bring the robot to rest. Its law is in
`core/include/hcbf/gatekeeper.hpp`, and `docs/gatekeeper.md` proves its promise.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import (
    InvalidInputError,
    SafetyWarning,
    check_options,
    choose,
    count,
    in_words,
    listed,
    reals,
    shown,
    text,
    warn_caller,
)
from hcbf_gym.filter.settings import FilterSettings
from hcbf_gym.models.plant import Plant
from hcbf_gym.models.reduced_order import DoubleIntegrator

Manoeuvre = Callable[[Array, int], ArrayLike]
"""A feedback law of the state x (4,) at a sample, and of the number of samples since the manoeuvre
began. It returns u (2,), and the filter takes the nearest input of U."""

_OWN: dict[str, Manoeuvre] = {}


def register(name: str, manoeuvre: Manoeuvre) -> None:
    """Name a manoeuvre of one's own for ``strict={"kind": "gatekeeper", "manoeuvres": [name]}``.

    It has to bring the robot to rest within 1000 samples. It is called for every sample of every
    path that is verified, some 100 a step, so that a step takes milliseconds. The lemma of
    `docs/gatekeeper.md` holds for it if two of its paths get no farther apart in velocity.

    Args:
        name: a name that is not taken.
        manoeuvre: the function of x (4,) and the samples since it began, which returns u (2,)
            [m/s²].

    Raises:
        InvalidInputError: if the name is taken or empty, or `manoeuvre` is no function.
    """
    name = text("manoeuvre", name)
    if not name or name in _OWN:
        raise InvalidInputError(f"manoeuvre: got {name!r}, expected a name not in {sorted(_OWN)}")
    if not callable(manoeuvre):
        raise InvalidInputError(
            f"manoeuvre {name!r}: got {shown(manoeuvre)}, expected a function (x, begun) → u"
        )
    _OWN[name] = manoeuvre


class Gate(NamedTuple):
    """The manoeuvres of a gatekeeper.

    Attributes:
        directions: k, the number of directions into which its manoeuvres accelerate.
        names: the names of registered manoeuvres, which are tried after braking.
    """

    directions: int
    names: tuple[str, ...]

    def input(self, index: int, x: tuple[float, ...], begun: int) -> tuple[float, float]:
        """Return u of a registered manoeuvre, which the core calls; NaN ends its path."""
        name = self.names[index]
        try:
            u = reals("u", _OWN[name](np.array(x), begun))
            return float(u[0]), float(u[1])
        except Exception as error:  # a user's own code may raise anything
            message = f"safety filter: the manoeuvre {name!r} raised {in_words(error)}"
            warn_caller(message, SafetyWarning)
            return math.nan, math.nan


def read(strict: object) -> Gate | None:
    """Return the gatekeeper that `FilterSettings.strict` requests; None if it requests rows.

    Raises:
        UnknownNameError: if a name is not known; the message lists the choices.
        InvalidInputError: if an option is unknown or out of range.
    """
    options: dict[str, Any] = dict(strict) if isinstance(strict, Mapping) else {"kind": strict}
    kind = options.get("kind", "gatekeeper")
    is_gatekeeper = choose("strict", kind, {"rows": False, "gatekeeper": True})
    if not is_gatekeeper:
        check_options("strict 'rows'", options, ("kind",))
        return None
    check_options("strict 'gatekeeper'", options, ("kind", "directions", "manoeuvres"))
    directions = count("directions", options.get("directions", 16), maximum=64)
    names = listed("manoeuvres", options.get("manoeuvres", ()), str)
    for name in names:
        choose("manoeuvre", name, _OWN)
    return Gate(directions, names)


def check_plant(plant: Plant, settings: FilterSettings) -> None:
    """Refuse plants and settings for which no manoeuvre is verified."""
    wrong = ""
    if plant.model != DoubleIntegrator():
        wrong = f"{type(plant.model).__name__}, expected the planar DoubleIntegrator()"
    elif plant.axle is not None:
        wrong = "a differential drive, expected a point that accelerates in every direction"
    elif plant.period is None:
        wrong = "a plant of unknown period, expected Plant(period=…) [s]"
    elif settings.solver is not None:
        wrong = f"solver={settings.solver!r}, expected solver=None, the compiled program"
    if wrong:
        raise InvalidInputError(f"strict 'gatekeeper': got {wrong}; or strict=\"rows\"")


def check_scene(scene: BarrierSet) -> None:
    """Refuse conditions against which no manoeuvre is verified."""
    is_own_strict = (scene.kind == layout.CUSTOM) & (scene.priority == 1)
    is_mapped = np.isin(scene.kind, (layout.MAPPED, layout.ZONES))
    refused = {"a strict condition of your own": is_own_strict, "a class of a map": is_mapped}
    for description, mask in refused.items():
        if mask.any():
            i, k = np.argwhere(mask)[0].tolist()
            name = scene.conditions(i)[k].name
            raise InvalidInputError(
                f"strict 'gatekeeper': got {name!r}, {description}, whose bound between samples is "
                "not known, expected built-in shapes and speed limits: "
                'SafetyFilter(env, strict="rows")'
            )


def constants(gate: Gate | None, plant: Plant, margin: float | None) -> dict[str, object]:
    """Return the constants of a gatekeeper by their names in `plants.CONSTANTS`; none for rows.

    The errors of states are those that the plant declares. A `margin` by hand [m] bounds no error.
    """
    if gate is None:
        return {}
    declared = plant.uncertainty
    return {
        "gates": True,
        "directions": gate.directions,
        "laws": len(gate.names),
        "position_error": declared.distance if margin is None else 0.0,
        "velocity_error": declared.speed if margin is None else 0.0,
        "longest": math.inf if plant.max_age is None else plant.max_age,
    }
