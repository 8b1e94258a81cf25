"""Scenes by name, from a plain dict, or from a JSON file."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from hcbf_gym import loading, plugins, records
from hcbf_gym.arrays import Array
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
from hcbf_gym.scenarios.family import V_MAX, Draw, DrawMany, Family
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

_NAMED: dict[str, Callable[[], Scenario]] = {
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
    redraw: Callable[[np.random.Generator, Array], None] | None = None,
) -> None:
    """Name a family of random scenes, of which environments draw one for each episode.

    The task is "reach": to arrive at the scene's goal. Written in a file, a family is also called
    ``file.py:name`` or ``module:name``, under which other processes find it.

    Args:
        name: for `gym.make`, `make_vec`, `evaluate` and `certify` as a scenario.
        draw: (generator, scene) fills the arrays of a `Scene`, for each environment that begins,
            with its generator.
        shapes: m, how many shapes each scene has, walls included.
        v_max: strict cap on the speed [m/s]; None for none.
        draw_many: (N generators, the N scenes' arrays) the same for many at once, equal bit for
            bit; registration compares them on some seeds.
        floor: returns the map on which the shapes are; None for none.
        hooks: observation, reward and costs of the family.
        redraw: (generator, velocities (m, 2) [m/s]) writes those after each control step of
            environments with ``intentions="hidden"``, unannounced; None where it has no such.

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
    for what, given in (
        ("draw", draw), ("draw_many", draw_many), ("floor", floor), ("redraw", redraw)
    ):  # fmt: skip
        if not (callable(given) or (given is None and what != "draw")):
            raise InvalidInputError(
                f"family {name!r}: {what}: got {shown(given)}, expected a function"
            )
    count(f"family {name!r}: shapes", shapes, minimum=0 if floor else 1)
    if v_max is not None:
        v_max = finite_float(f"family {name!r}: v_max", v_max, minimum=0.0, exclusive=True)
    made = Family(name, draw, shapes, v_max, draw_many, floor, hooks, redraw)
    before = _FAMILIES.get(name)
    if name in _NAMED or not (before is None or before.is_from_where(made)):
        raise InvalidInputError(
            f"family: got {name!r}, expected a name that is not taken: {names()}"
        )
    if draw_many is not None:
        made.check_many()
    _FAMILIES[name] = made


def families() -> list[str]:
    """Return the names of families of random scenes."""
    return list(_FAMILIES)


def names() -> list[str]:
    """Return the names that `make` knows."""
    return sorted([*_NAMED, *_FAMILIES])


def family_of(scenario: ScenarioLike) -> Family | None:
    """Return the family of random scenes with a name, or of paths through a map's dict; or None.

    Raises:
        UnknownNameError: if a file or module does not register a family of that name.
        InvalidInputError: if it cannot be imported.
    """
    if isinstance(scenario, Mapping):
        if set(scenario) != {"map"}:
            return None
        reader = floors()
        floor = reader.read(scenario["map"])

        def draw(generator: np.random.Generator, scene: Scene) -> None:
            reader.draw(floor, generator, scene.start, scene.goal)

        return Family(name_of(scenario["map"]), draw, 0, floor=lambda: floor)
    if not isinstance(scenario, str):
        return None
    where, _, name = scenario.rpartition(":")
    if where:
        loading.module("scenario", where)
        if name not in _FAMILIES:
            raise UnknownNameError(
                f"unknown scenario: got {scenario!r}, expected one of {families()}, or that "
                f"{where} calls hcbf_gym.scenarios.register({name!r}, draw, shapes=…)"
            )
    if name not in {*_NAMED, *_FAMILIES} and not name.endswith(".json"):
        plugins.load()  # which may register it
    return _FAMILIES.get(name)


def is_random(scenario: ScenarioLike) -> bool:
    """Return whether `make` draws another scene at every call: it names a family, or is a map."""
    return family_of(scenario) is not None


def on_map(
    file: Path | None, masks: Mapping[str, int], slow: Mapping[str, float], otherwise: str
) -> str | dict[str, object]:
    """Return a command line's scene: random paths through a map, or one by name.

    Args:
        file: of the map, YAML beside a PGM or PNG; None for none.
        masks: mask → rank of what it covers; a file in the current folder, or beside the map.
        slow: mask of a zone → speed limit there [m/s], as rank 2.
        otherwise: the scene where there is no map.

    Raises:
        InvalidInputError: if there are masks and no map, or a mask is named twice.
    """
    for what, given in (("masks", masks), ("slow", slow)):
        records.check_mapping(what, given)
    zones = {name: {"rank": 2, "kind": "speed", "limit": limit} for name, limit in slow.items()}
    entries: dict[str, object] = {**masks, **zones}
    if file is None:
        if entries:
            raise InvalidInputError("masks: got some without a map, expected --map, too")
        return text("otherwise", otherwise)
    here = {name: str(Path(name).resolve()) if Path(name).exists() else name for name in entries}
    found = {here[name]: entry for name, entry in entries.items()}
    if len(found) < len(masks) + len(slow):
        raise InvalidInputError(
            f"masks: got {[*masks, *slow]}, expected each mask once, in --masks or in --slow"
        )
    return {"map": {"file": text("map", file), "masks": found}}


def make(scenario: ScenarioLike, rng: np.random.Generator | None = None) -> Scenario:
    """Return a scenario.

    Args:
        scenario: a name, a path to a JSON file, a plain dict, or a `Scenario`. A dict of a map
            alone, {"map": {"file": …, "masks": …}}, means random paths through it.
        rng: decides a random scene; a generator of seed 0 unless given.

    Raises:
        UnknownNameError: if the name is not registered; the message lists those that are.
        InvalidInputError: if the file or dict is no scenario.
    """
    if isinstance(scenario, Scenario):
        return scenario
    family = family_of(scenario)
    if family is not None:
        rng = np.random.default_rng(0) if rng is None else rng
        return family.scenario(family.drawn([instance("rng", rng, np.random.Generator)]).one(0))
    if isinstance(scenario, Mapping):
        return from_dict(scenario)
    if not isinstance(scenario, str | Path):
        raise InvalidInputError(
            f"scenario: got {shown(scenario)}, expected a name, a dict, a JSON file or a Scenario"
        )
    if str(scenario) in _NAMED:
        return _NAMED[str(scenario)]()
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
