"""Scenario: ranked barriers, a reference, inputs and boxes, which dicts and JSON files describe."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
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

LARGEST_INPUT = 1e3  # greatest component of an input set's corners [m/s²]


@dataclass(frozen=True)
class BoxObstacle:
    """A box on the floor of the full-physics scene.

    Args:
        name: under which its contacts are reported, not empty.
        center: (2,) on the floor [m].
        size: (3,) full length, width and height [m], positive.
        yaw: angle of its length to the x axis [rad].
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
        _check_name("obstacle name", self.name)
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
        name: the scene's name in tables and figures.
        barriers: ranked safety conditions; with those of the map, the priorities are 1, 2, …
            without a gap.
        reference: the motion of the nominal policy; its last point is the goal.
        start: (2,) position at which an episode starts [m].
        input_set: U of the reduced-order model.
        task: "track" follows the reference to its end, "reach" ends at the goal.
        goal_radius: distance within which the goal counts as reached [m].
        v_max: strict cap on the speed that the environments add [m/s]; None for none.
        obstacles: boxes of the full-physics scene.
        map: a map whose classes are conditions after the barriers; None for none.

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
        _check_name("scenario name", self.name)
        if not (self.map is None or isinstance(self.map, Floor)):
            raise InvalidInputError(f"{self.name}: map: got {shown(self.map)}, expected a map")
        barriers = listed(f"{self.name}: barriers", self.barriers, Barrier)
        obstacles = listed(f"{self.name}: obstacles", self.obstacles, BoxObstacle)
        object.__setattr__(self, "barriers", barriers)
        object.__setattr__(self, "obstacles", obstacles)
        if not callable(self.reference) or not hasattr(self.reference, "duration"):
            raise InvalidInputError(
                f"{self.name}: reference: got {shown(self.reference)}, expected a Reference"
            )
        self._check_names_and_ranks()
        choose(f"task of {self.name}", self.task, dict.fromkeys(TASKS))
        start = finite_array(f"{self.name}: start", self.start, (2,), largest=FARTHEST)
        object.__setattr__(self, "start", tuple(start.tolist()))
        inputs = input_sets.read(f"{self.name}: input_set", self.input_set)
        object.__setattr__(self, "input_set", inputs)
        corners = inputs.vertices()
        finite_array(f"{self.name}: input_set", corners, (None, 2), largest=LARGEST_INPUT)
        finite_float(f"{self.name}: goal_radius", self.goal_radius, minimum=0.0, exclusive=True)
        if self.v_max is not None:
            finite_float(f"{self.name}: v_max", self.v_max, minimum=0.0, exclusive=True)

    def _check_names_and_ranks(self) -> None:
        """Refuse names that conditions or boxes share, and priorities with a gap."""
        names = [barrier.name for barrier in self.conditions]
        if not names or len(set(names)) != len(names):
            raise InvalidInputError(
                f"{self.name}: barriers: got the names {names}, expected one or more, all different"
            )
        boxes = [box.name for box in self.obstacles]
        if len(set(boxes)) != len(boxes):
            raise InvalidInputError(
                f"{self.name}: obstacles: got the names {boxes}, expected them all different"
            )
        ranks = sorted({barrier.priority for barrier in self.conditions})
        if ranks != list(range(1, len(ranks) + 1)):
            raise InvalidInputError(
                f"{self.name}: priorities: got {ranks}, expected 1, 2, … without a gap"
            )

    @property
    def goal(self) -> Array:
        """(2,) the point where the reference ends [m]."""
        return self.reference(self.reference.duration)[0]

    @cached_property
    def conditions(self) -> tuple[Barrier, ...]:
        """The barriers, then one for each class of the map, in the order of infos."""
        return self.barriers + (() if self.map is None else self.map.conditions)

    def to_dict(self) -> dict[str, Any]:
        """Return the scene as a plain dict that `from_dict` reads and JSON can hold."""
        data = {
            "name": self.name,
            "barriers": [barriers.to_dict(barrier) for barrier in self.barriers],
            "reference": records.to_dict(self.reference, references.KINDS),
            "start": list(self.start),
            "input_set": self.input_set.to_dict(),
            "task": self.task,
            "goal_radius": self.goal_radius,
            "v_max": self.v_max,
            "obstacles": [records.plain(asdict(box)) for box in self.obstacles],
        }
        return data if self.map is None else data | {"map": self.map.to_dict()}


ScenarioLike = str | Path | Mapping[str, Any] | Scenario
"""A name, a path to a JSON file, a plain dict, or a scenario."""


def from_dict(data: Mapping[str, Any]) -> Scenario:
    """Return the scenario of a plain dict.

    Args:
        data: a dict as `Scenario.to_dict` returns it; fields with a default may be left out.

    Raises:
        InvalidInputError: if a field is missing, unknown or mistyped, with the fields listed.
    """
    records.check_mapping("scenario", data)
    values = dict(data)
    for name, read in _FIELD_READERS.items():
        if name in values:
            values[name] = read(values[name])
    return records.build("scenario", Scenario, values)


_FIELD_READERS: dict[str, Callable[[Any], object]] = {
    "barriers": lambda data: tuple(map(barriers.from_dict, _mappings("scenario: barriers", data))),
    "map": lambda data: None if data is None else floors().read(data),
    "reference": lambda data: records.from_dict("reference", data, references.KINDS),
    "input_set": input_sets.from_dict,
    "obstacles": lambda data: tuple(
        records.build("obstacle", BoxObstacle, box)
        for box in _mappings("scenario: obstacles", data)
    ),
}
"""The fields that are no plain values, and the functions that read them."""


def load(path: str | Path) -> Scenario:
    """Read a scenario from a JSON file, to which a relative path of its map refers.

    Raises:
        InvalidInputError: if the file cannot be read, is not JSON or is no scenario.
    """
    data = records.read_json("scenario file", path)
    if isinstance(data, Mapping) and isinstance(data.get("map"), Mapping) and "file" in data["map"]:
        file = records.expanded("scenario file: map", str(data["map"]["file"]))
        beside = Path(path).parent / file
        data = {**data, "map": {**data["map"], "file": str(beside)}}
    return from_dict(data)


def _mappings(name: str, value: object) -> list[Any]:
    """Return a list of mappings; refuse anything else."""
    if not isinstance(value, list | tuple):
        raise InvalidInputError(f"{name}: got {value!r}, expected a list")
    for item in value:
        records.check_mapping(name, item)
    return list(value)


def _check_name(name: str, value: object) -> None:
    """Refuse anything but a text that is not empty."""
    if not isinstance(value, str) or not value:
        raise InvalidInputError(f"{name}: got {shown(value)}, expected text")
