"""Scenes by name, from a plain dict, or from a JSON file."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from hcbf_gym import records
from hcbf_gym.errors import InvalidInputError, UnknownNameError, instance, shown, text
from hcbf_gym.scenarios import clutter, floor_plans, paper, random_scenes, rooms, traps, trolley
from hcbf_gym.scenarios.floor_plans import Route
from hcbf_gym.scenarios.hall import Layout
from hcbf_gym.scenarios.scenario import BoxObstacle, Scenario, ScenarioLike, from_dict, load

__all__ = [
    "PLANS",
    "RANDOM",
    "BoxObstacle",
    "Layout",
    "Route",
    "Scenario",
    "ScenarioLike",
    "draw",
    "from_dict",
    "is_random",
    "load",
    "make",
    "names",
    "on_map",
]

_NAMED: dict[str, Callable[[], Scenario]] = {
    "paper-simulation": paper.simulation,
    "paper-simulation-as-printed": paper.simulation_as_printed,
    "paper-four-levels": paper.four_levels,
    "paper-experiment": paper.experiment,
    "paper-experiment-straight": paper.experiment_straight,
    "trolley": trolley.scenario,
}

RANDOM: dict[str, Callable[[np.random.Generator], Layout]] = {
    "random": random_scenes.draw,
    "random-moving": partial(random_scenes.draw, moving=True),
    "random-wide": partial(random_scenes.draw, gap=random_scenes.WIDE_GAP),
    "random-clutter": clutter.draw,
    "random-traps": traps.draw,
    "random-map": rooms.draw,
}
"""The names that stand for another scene at every reset, and what draws it."""

PLANS: dict[str, Callable[[np.random.Generator], Route]] = {
    f"map-{plan}": partial(floor_plans.draw, plan) for plan in floor_plans.NAMES
}
"""The floor plans, in which every reset draws another start and another goal."""


def names() -> list[str]:
    """Return the names that `make` knows."""
    return sorted([*_NAMED, *RANDOM, *PLANS])


def is_random(scenario: ScenarioLike) -> bool:
    """Return whether `make` draws another scene at every call: it has such a name, or is a map."""
    if isinstance(scenario, Mapping):
        return set(scenario) == {"map"}
    return isinstance(scenario, str) and (scenario in RANDOM or scenario in PLANS)


def on_map(
    file: Path | None, masks: Mapping[str, int], slow: Mapping[str, float], otherwise: str
) -> str | dict[str, object]:
    """Return the scene that a command line asks for: random ways through a map, or one by name.

    Args:
        file: of the map, YAML beside a PGM or PNG; None for none.
        masks: mask → rank of what it covers. It is looked for in the current folder, then beside
            the map.
        slow: mask of a zone → speed limit there [m/s], as rank 2; likewise.
        otherwise: the scene where there is no map.

    Raises:
        InvalidInputError: if there are masks and no map.
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
    return {"map": {"file": text("map", file), "masks": found}}


def draw(scenario: ScenarioLike, rng: np.random.Generator) -> Layout | Route:
    """Return what the generator decides of a scene that is random."""
    if not is_random(scenario):
        raise InvalidInputError(
            f"scenario: got {shown(scenario)}, expected one of {sorted(RANDOM | PLANS)}, or a map"
        )
    instance("rng", rng, np.random.Generator)
    if isinstance(scenario, Mapping):
        return floor_plans.through(floor_plans.described(scenario["map"]), rng)
    drawers: dict[str, Callable[[np.random.Generator], Layout | Route]] = {**RANDOM, **PLANS}
    return drawers[str(scenario)](rng)


def make(scenario: ScenarioLike, rng: np.random.Generator | None = None) -> Scenario:
    """Return a scenario.

    Args:
        scenario: a name, a path to a JSON file, a plain dict, or a `Scenario`. A dict of a map
            alone, {"map": {"file": …, "masks": …}}, stands for random ways through it.
        rng: what decides a random scene; a generator of seed 0 unless given.

    Raises:
        UnknownNameError: if the name is not registered; the message lists those that are.
        InvalidInputError: if the file or dict is no scenario.
    """
    if isinstance(scenario, Scenario):
        return scenario
    if isinstance(scenario, str | Mapping) and is_random(scenario):
        name = floor_plans.name_of(scenario["map"]) if isinstance(scenario, Mapping) else scenario
        rng = np.random.default_rng(0) if rng is None else rng
        return draw(scenario, rng).scenario(name)
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
