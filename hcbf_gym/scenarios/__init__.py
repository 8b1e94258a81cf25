"""Scenes by name, from a plain dict, or from a JSON file."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym import loading, plugins, records
from hcbf_gym.errors import (
    InvalidInputError,
    UnknownNameError,
    count,
    finite_float,
    instance,
    shown,
    text,
)
from hcbf_gym.scenarios import clutter, crossing, hall, paper, random_scenes, rooms, traps, trolley
from hcbf_gym.scenarios.family import V_MAX, Draw, DrawMany, Family, Redraw
from hcbf_gym.scenarios.floor import Floor, floors, name_of, register_floors
from hcbf_gym.scenarios.hooks import NO_HOOKS, Hooks, Moment
from hcbf_gym.scenarios.scenario import BoxObstacle, Scenario, ScenarioLike, from_dict, load
from hcbf_gym.scenarios.scene import BOX, DISC, ELLIPSE, HALF_PLANE, Scene

__all__ = [
    "BOX",
    "DISC",
    "ELLIPSE",
    "HALF_PLANE",
    "BoxObstacle",
    "Family",
    "Floor",
    "Hooks",
    "Moment",
    "Scenario",
    "ScenarioLike",
    "Scene",
    "families",
    "family_of",
    "from_dict",
    "is_random",
    "load",
    "make",
    "names",
    "on_map",
    "register",
    "register_floors",
]

_FIXED: dict[str, Callable[[], Scenario]] = {
    "paper-simulation": paper.simulation,
    "paper-simulation-as-printed": paper.simulation_as_printed,
    "paper-four-levels": paper.four_levels,
    "paper-experiment": paper.experiment,
    "paper-experiment-straight": paper.experiment_straight,
    "trolley": trolley.scenario,
}

_FAMILIES: dict[str, Family] = {}


def register(
    name: str,
    draw: Draw,
    *,
    shapes: int,
    v_max: float | None = V_MAX,
    draw_many: DrawMany | None = None,
    floor: Callable[[], Floor] | None = None,
    hooks: Hooks = NO_HOOKS,
    redraw: Redraw | None = None,
) -> None:
    """Name a family of random scenes, of which environments draw one for each episode.

    The task is "reach": to arrive at the scene's goal. A family that a file registers also has the
    name ``file.py:name`` or ``module:name``, under which other processes find it.

    Args:
        name: the scenario's name for `gym.make`, `make_vec`, `evaluate` and `certify`.
        draw: (generator, scene) fills the arrays of a `Scene` at the beginning of an episode.
        shapes: m, the number of shapes of each scene, walls included.
        v_max: strict cap on the speed [m/s]; None for none.
        draw_many: (N generators, the N scenes' arrays) does the same for many at once, equal bit
            for bit; registration compares them on some seeds.
        floor: returns the map on which the shapes are; None for none.
        hooks: observation, reward and costs of the family.
        redraw: (generator, velocities (m, 2) [m/s]) overwrites the velocities after each control
            step of environments with ``intentions="hidden"``; None where they never change.

    Raises:
        InvalidInputError: if the name is taken or no name, a number is out of range, or
            `draw_many` fills other scenes than `draw`.
    """
    name = text("family", name)
    if not name or set(name) & set(":/ "):
        raise InvalidInputError(
            f"family: got {name!r}, expected a name without colon, slash, space"
        )
    instance(f"family {name!r}: hooks", hooks, Hooks)
    functions = {"draw": draw, "draw_many": draw_many, "floor": floor, "redraw": redraw}
    for argument, value in functions.items():
        is_left_out = value is None and argument != "draw"
        if not (is_left_out or callable(value)):
            raise InvalidInputError(
                f"family {name!r}: {argument}: got {shown(value)}, expected a function"
            )
    count(f"family {name!r}: shapes", shapes, minimum=0 if floor else 1)
    if v_max is not None:
        v_max = finite_float(f"family {name!r}: v_max", v_max, minimum=0.0, exclusive=True)
    family = Family(name, draw, shapes, v_max, draw_many, floor, hooks, redraw)
    registered = _FAMILIES.get(name)
    if name in _FIXED or (registered is not None and not family.is_redefinition_of(registered)):
        raise InvalidInputError(
            f"family: got {name!r}, expected a name that is not taken: {names()}"
        )
    if draw_many is not None:
        family.check_draw_many()
    _FAMILIES[name] = family


def families() -> list[str]:
    """Return the names of families of random scenes."""
    return list(_FAMILIES)


def names() -> list[str]:
    """Return the names that `make` knows."""
    return sorted([*_FIXED, *_FAMILIES])


def family_of(scenario: ScenarioLike) -> Family | None:
    """Return the family of a scenario's random scenes; None where the scenario is one scene.

    A family has a name, or consists of random paths through a map's dict.

    Raises:
        UnknownNameError: if a file or module does not register a family of that name.
        InvalidInputError: if it cannot be imported.
    """
    if isinstance(scenario, Mapping):
        return _paths_through(scenario["map"]) if set(scenario) == {"map"} else None
    if not isinstance(scenario, str):
        return None
    module, _, name = scenario.rpartition(":")
    if module:
        loading.module("scenario", module)
        if name not in _FAMILIES:
            raise UnknownNameError(
                f"unknown scenario: got {scenario!r}, expected one of {families()}, or that "
                f"{module} calls hcbf_gym.scenarios.register({name!r}, draw, shapes=…)"
            )
    if name not in {*_FIXED, *_FAMILIES} and not name.endswith(".json"):
        plugins.load()  # a plugin may register it
    return _FAMILIES.get(name)


def _paths_through(map_data: Mapping[str, Any]) -> Family:
    """Return the family of random paths through the map of a plain dict."""
    reader = floors()
    floor = reader.read(map_data)

    def draw(generator: np.random.Generator, scene: Scene) -> None:
        reader.draw(floor, generator, scene.start, scene.goal)

    return Family(name_of(map_data), draw, 0, floor=lambda: floor)


def is_random(scenario: ScenarioLike) -> bool:
    """Return whether `make` draws another scene at every call: it names a family, or is a map."""
    return family_of(scenario) is not None


def on_map(
    file: Path | None, masks: Mapping[str, int], slow: Mapping[str, float], otherwise: str
) -> str | dict[str, object]:
    """Return a command line's scene: random paths through a map, or one by name.

    Args:
        file: the map's file, YAML beside a PGM or PNG; None for none.
        masks: file of a mask, in the current folder or beside the map → rank of the covered cells.
        slow: file of a zone's mask → speed limit in the zone [m/s], as rank 2.
        otherwise: the scene where there is no map.

    Raises:
        InvalidInputError: if there are masks and no map, or a mask is named twice.
    """
    records.check_mapping("masks", masks)
    records.check_mapping("slow", slow)
    zones = {name: {"rank": 2, "kind": "speed", "limit": limit} for name, limit in slow.items()}
    entries: dict[str, object] = {**masks, **zones}
    if file is None:
        if entries:
            raise InvalidInputError("masks: got some without a map, expected --map, too")
        return text("otherwise", otherwise)
    by_path: dict[str, object] = {}
    for name, entry in entries.items():
        path = Path(name)
        by_path[str(path.resolve()) if path.exists() else name] = entry
    if len(by_path) < len(masks) + len(slow):
        raise InvalidInputError(
            f"masks: got {[*masks, *slow]}, expected each mask once, in --masks or in --slow"
        )
    return {"map": {"file": text("map", file), "masks": by_path}}


def make(scenario: ScenarioLike, rng: np.random.Generator | None = None) -> Scenario:
    """Return a scenario.

    Args:
        scenario: a name, a path to a JSON file, a plain dict, or a `Scenario`. A dict of a map
            alone, {"map": {"file": …, "masks": …}}, means random paths through it.
        rng: draws a random scene; None is a generator of seed 0.

    Raises:
        UnknownNameError: if the name is not registered; the message lists those that are.
        InvalidInputError: if the file or dict is no scenario.
    """
    if isinstance(scenario, Scenario):
        return scenario
    family = family_of(scenario)
    if family is not None:
        rng = np.random.default_rng(0) if rng is None else rng
        return family.scenario(
            family.draw_scenes([instance("rng", rng, np.random.Generator)]).one(0)
        )
    if isinstance(scenario, Mapping):
        return from_dict(scenario)
    if not isinstance(scenario, str | Path):
        raise InvalidInputError(
            f"scenario: got {shown(scenario)}, expected a name, a dict, a JSON file or a Scenario"
        )
    if str(scenario) in _FIXED:
        return _FIXED[str(scenario)]()
    if str(scenario).endswith(".json"):
        return load(scenario)
    raise UnknownNameError(
        f"unknown scenario: got {str(scenario)!r}, expected one of {names()} or a .json file"
    )


_IN_A_HALL = hall.WALLS + random_scenes.REGIONS
register("random", random_scenes.draw, shapes=_IN_A_HALL)
register("random-moving", partial(random_scenes.draw, moving=True), shapes=_IN_A_HALL)
register("random-wide", partial(random_scenes.draw, gap=random_scenes.WIDE_GAP), shapes=_IN_A_HALL)
register("random-clutter", clutter.draw, shapes=hall.WALLS + clutter.MAX_REGIONS)
register("random-traps", traps.draw, shapes=hall.WALLS + len(traps.RANKS))
register(
    "random-crossing",
    crossing.draw,
    shapes=hall.WALLS + len(crossing.LANES) * crossing.DISCS,
    redraw=crossing.redraw,
)
register("random-map", rooms.draw, shapes=hall.WALLS + len(rooms.RANKS))
