"""The record of one scene: ranked barriers, a reference, an input set, boxes."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

from hcbf_gym import barriers, records
from hcbf_gym.arrays import Array, Pair
from hcbf_gym.barriers import Barrier
from hcbf_gym.errors import InvalidInputError, choose, finite_array, finite_float, listed, shown
from hcbf_gym.models import input_sets
from hcbf_gym.models.constants import FARTHEST
from hcbf_gym.models.input_sets import Box, InputSet
from hcbf_gym.scenarios import references
from hcbf_gym.scenarios.floor import Floor, floors
from hcbf_gym.scenarios.references import Reference

TASKS = ("track", "reach")

LARGEST_INPUT = 1e3
"""Of a scene's input set [m/s²]."""


@dataclass(frozen=True)
class BoxObstacle:
    """A box on the floor of the full-physics scene.

    Args:
        name: of its reports of contacts, not empty.
        center: (2,) [m].
        size: (3,) full length, width and height [m], positive.
        yaw: [rad].
        mass: [kg], positive; None for a box too heavy to move.

    Raises:
        InvalidInputError: if there is no name, a size or the mass is not positive, or a number is
            not finite or beyond `FARTHEST`.
    """

    name: str
    center: Pair
    size: tuple[float, float, float]
    yaw: float = 0.0
    mass: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InvalidInputError(f"obstacle name: got {shown(self.name)}, expected text")
        center = finite_array(f"{self.name}: center", self.center, (2,), largest=FARTHEST)
        size = finite_array(f"{self.name}: size", self.size, (3,), largest=FARTHEST)
        for side in size:
            finite_float(f"{self.name}: size", side, minimum=0.0, exclusive=True)
        finite_float(f"{self.name}: yaw", self.yaw)
        if self.mass is not None:
            finite_float(f"{self.name}: mass", self.mass, minimum=0.0, exclusive=True)
        object.__setattr__(self, "center", tuple(center.tolist()))
        object.__setattr__(self, "size", tuple(size.tolist()))


@dataclass(frozen=True)
class Scenario:
    """A scene: dangerous regions and their ranks, the goal and the inputs.

    Args:
        name: in tables and figures.
        barriers: ranked safety conditions; with those of the map, the priorities are 1, 2, …
            without a gap.
        reference: of the nominal policy; the last point is the goal.
        start: (2,) [m].
        input_set: U of the reduced-order model.
        task: "track" follows the reference to its end, "reach" ends at the goal.
        goal_radius: within which the goal counts as reached [m].
        v_max: strict cap on the speed that the environments add [m/s]; None for none.
        obstacles: boxes of the full-physics scene.
        map: its classes are conditions after the barriers; None for none.

    Raises:
        InvalidInputError: if the barriers are none, share a name or skip a priority, if boxes share
            a name, or another field is out of range.
    """

    name: str
    barriers: tuple[Barrier, ...]
    reference: Reference
    start: Pair = (0.0, 0.0)
    input_set: InputSet = field(default_factory=lambda: Box.symmetric(5.0))
    task: str = "track"
    goal_radius: float = 0.25
    v_max: float | None = None
    obstacles: tuple[BoxObstacle, ...] = ()
    map: Floor | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InvalidInputError(f"scenario name: got {shown(self.name)}, expected text")
        if not (self.map is None or isinstance(self.map, Floor)):
            raise InvalidInputError(f"{self.name}: map: got {shown(self.map)}, expected a map")
        for part, kind in (("barriers", Barrier), ("obstacles", BoxObstacle)):
            entries = listed(f"{self.name}: {part}", getattr(self, part), kind)
            object.__setattr__(self, part, entries)
        if not callable(self.reference) or not hasattr(self.reference, "duration"):
            raise InvalidInputError(
                f"{self.name}: reference: got {shown(self.reference)}, expected a Reference"
            )
        names = [barrier.name for barrier in self.conditions]
        if not names or len(set(names)) != len(names):
            raise InvalidInputError(
                f"{self.name}: barriers: got the names {names}, expected one or more, all different"
            )
        ranks = sorted({barrier.priority for barrier in self.conditions})
        if ranks != list(range(1, len(ranks) + 1)):
            raise InvalidInputError(
                f"{self.name}: priorities: got {ranks}, expected 1, 2, … without a gap"
            )
        choose(f"task of {self.name}", self.task, dict.fromkeys(TASKS))
        boxes = [box.name for box in self.obstacles]
        if len(set(boxes)) != len(boxes):
            raise InvalidInputError(
                f"{self.name}: obstacles: got the names {boxes}, expected them all different"
            )
        start = finite_array(f"{self.name}: start", self.start, (2,), largest=FARTHEST)
        object.__setattr__(self, "start", tuple(start.tolist()))
        inputs = input_sets.read(f"{self.name}: input_set", self.input_set)
        object.__setattr__(self, "input_set", inputs)
        corners = inputs.vertices()
        finite_array(f"{self.name}: input_set", corners, (None, 2), largest=LARGEST_INPUT)
        finite_float(f"{self.name}: goal_radius", self.goal_radius, minimum=0.0, exclusive=True)
        if self.v_max is not None:
            finite_float(f"{self.name}: v_max", self.v_max, minimum=0.0, exclusive=True)

    @property
    def goal(self) -> Array:
        """(2,) where the reference ends [m]."""
        return self.reference(self.reference.duration)[0]

    @cached_property
    def conditions(self) -> tuple[Barrier, ...]:
        """The barriers, then one for each class of the map, in the order of infos."""
        return self.barriers + (() if self.map is None else self.map.conditions)

    def to_dict(self) -> dict[str, Any]:
        """Return the scene as a plain dict that `from_dict` reads and JSON can hold."""
        return {
            "name": self.name,
            "barriers": [barriers.to_dict(b) for b in self.barriers],
            "reference": records.to_dict(self.reference, references.KINDS),
            "start": list(self.start),
            "input_set": self.input_set.to_dict(),
            "task": self.task,
            "goal_radius": self.goal_radius,
            "v_max": self.v_max,
            "obstacles": [
                {f.name: records.plain(getattr(o, f.name)) for f in fields(o)}
                for o in self.obstacles
            ],
        } | ({} if self.map is None else {"map": self.map.to_dict()})


ScenarioLike = str | Path | Mapping[str, Any] | Scenario
"""A name, a path to a JSON file, a plain dict, or a scenario."""


def from_dict(data: Mapping[str, Any]) -> Scenario:
    """Build a scenario from a plain dict.

    Args:
        data: as `Scenario.to_dict` makes it; fields with a default may be left out.

    Raises:
        InvalidInputError: if a field is missing, unknown or mistyped, with the fields listed.
    """
    records.check_mapping("scenario", data)
    values = dict(data)
    if "barriers" in values:
        values["barriers"] = tuple(
            barriers.from_dict(item) for item in _items("scenario: barriers", values["barriers"])
        )
    if values.get("map") is not None:
        values["map"] = floors().read(values["map"])
    if "reference" in values:
        values["reference"] = records.from_dict("reference", values["reference"], references.KINDS)
    if "input_set" in values:
        values["input_set"] = input_sets.from_dict(values["input_set"])
    if "obstacles" in values:
        values["obstacles"] = tuple(
            records.build("obstacle", BoxObstacle, item)
            for item in _items("scenario: obstacles", values["obstacles"])
        )
    return records.build("scenario", Scenario, values)


def load(path: str | Path) -> Scenario:
    """Read a scenario from a JSON file; its map is beside it unless its path is absolute.

    Raises:
        InvalidInputError: if the file cannot be read, is not JSON or is no scenario.
    """
    data = records.read_json("scenario file", path)
    if isinstance(data, Mapping) and isinstance(data.get("map"), Mapping) and "file" in data["map"]:
        file = records.expanded("scenario file: map", str(data["map"]["file"]))
        beside = Path(path).parent / file
        data = {**data, "map": {**data["map"], "file": str(beside)}}
    return from_dict(data)


def _items(what: str, value: object) -> list[Any]:
    if not isinstance(value, list | tuple):
        raise InvalidInputError(f"{what}: got {value!r}, expected a list")
    for item in value:
        records.check_mapping(what, item)
    return list(value)
