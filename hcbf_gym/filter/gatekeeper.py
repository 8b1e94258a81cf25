"""A gatekeeper's settings, and manoeuvres of one's own.

`core/include/hcbf/gatekeeper.hpp` has the law, and `docs/gatekeeper.md` what it promises.
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
    listed,
    shown,
    text,
    warn_caller,
)
from hcbf_gym.filter.settings import FilterSettings
from hcbf_gym.models.plant import Plant
from hcbf_gym.models.reduced_order import DoubleIntegrator

Manoeuvre = Callable[[Array, int], ArrayLike]
"""A feedback law: the state x (4,) at a sample, and how many samples ago the manoeuvre began → u
(2,), of which the filter takes the nearest input of U."""

_OWN: dict[str, Manoeuvre] = {}


def register(name: str, manoeuvre: Manoeuvre) -> None:
    """Name a manoeuvre of one's own for ``strict={"kind": "gatekeeper", "manoeuvres": [name]}``.

    It has to bring the robot to rest within 1000 samples. It is called for every sample of every
    path that is looked at, some 100 a step, so that a step takes milliseconds. The lemma of
    `docs/gatekeeper.md` holds for it if two of its paths get no farther apart in velocity.

    Args:
        name: that is not taken.
        manoeuvre: x (4,), samples since it began → u (2,) [m/s²].

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
    """What a user asked of a gatekeeper.

    Attributes:
        directions: k, into how many directions its manoeuvres accelerate.
        names: of manoeuvres of one's own, which come after braking.
    """

    directions: int
    names: tuple[str, ...]

    def input(self, which: int, x: tuple[float, ...], begun: int) -> tuple[float, float]:
        """Return u of a manoeuvre of one's own; NaN where it fails, so that none follows it."""
        name = self.names[which]
        try:
            u = np.asarray(_OWN[name](np.array(x), begun), dtype=np.float64)
            return float(u[0]), float(u[1])
        except Exception as error:  # whatever a user's own code raises
            warn_caller(f"safety filter: the manoeuvre {name!r} raised {error!r}", SafetyWarning)
            return math.nan, math.nan


def read(strict: object) -> Gate | None:
    """Return the gatekeeper of `FilterSettings.strict`; None for rows.

    Raises:
        UnknownNameError: if a name is not known; the message lists the choices.
        InvalidInputError: if an option is unknown or out of range.
    """
    options: dict[str, Any] = dict(strict) if isinstance(strict, Mapping) else {"kind": strict}
    kind = options.get("kind", "gatekeeper")
    if not choose("strict", kind, {"rows": False, "gatekeeper": True}):
        check_options("strict 'rows'", options, ("kind",))
        return None
    check_options("strict 'gatekeeper'", options, ("kind", "directions", "manoeuvres"))
    directions = count("directions", options.get("directions", 16), maximum=64)
    names = listed("manoeuvres", options.get("manoeuvres", ()), str)
    for name in names:
        choose("manoeuvre", name, _OWN)
    return Gate(directions, names)


def check_plant(plant: Plant, settings: FilterSettings) -> None:
    """Refuse what a gatekeeper is not made for.

    Raises:
        InvalidInputError: of another model or a differential drive, without a period, and with a
            solver by name.
    """
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
    """Refuse conditions that no manoeuvre is verified against.

    Raises:
        InvalidInputError: of a map, and of a strict condition of the user's own.
    """
    own = np.isin(scene.kind, (layout.CUSTOM,)) & (scene.priority == 1)
    mapped = np.isin(scene.kind, (layout.MAPPED, layout.ZONES))
    for wrong, what in ((own, "a strict condition of your own"), (mapped, "a class of a map")):
        if wrong.any():
            i, k = np.argwhere(wrong)[0].tolist()
            name = scene.conditions(i)[k].name
            raise InvalidInputError(
                f"strict 'gatekeeper': got {name!r}, {what}, whose bound between samples is not "
                'known, expected built-in shapes and speed limits: SafetyFilter(env, strict="rows")'
            )


def constants(gate: Gate | None, plant: Plant, margin: float | None) -> dict[str, object]:
    """Return what compiled code never changes, by its names in `plants.CONSTANTS`.

    Args:
        gate: None for rows.
        plant: what it is.
        margin: given by hand, which bounds no error [m]; None for none.
    """
    if gate is None:
        return {}
    known = plant.uncertainty
    return {
        "gates": True,
        "directions": gate.directions,
        "laws": len(gate.names),
        "position_error": known.distance if margin is None else 0.0,
        "velocity_error": known.speed if margin is None else 0.0,
        "longest": math.inf if plant.max_age is None else plant.max_age,
    }
