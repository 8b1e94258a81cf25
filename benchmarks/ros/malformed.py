"""Malformed parameter files: each is refused by the parameter's name before the node is active.

A valid file is drawn, and one of its parameters is replaced by an invalid value, after the table of
parameters. A file that is not refused must be the valid one in another form.
"""

import math
import re
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from hcbf_gym.errors import HcbfError
from hcbf_robots.ros.core import NodeCore
from hcbf_robots.ros.parameter import Numbers, Parameter, Texts
from hcbf_robots.ros.parameters import by_name, read
from hcbf_robots.ros.settings import GRIDS, Settings
from hcbf_robots.walkers.walker_response import Response

Rng = np.random.Generator
Given = dict[str, Any]
ROBOTS: tuple[Given, ...] = (
    {"max_forward": 1.0, "max_turn": 2.0, "look_ahead": 0.2, "reach": 0.3},
    {"max_forward": 0.5, "max_turn": 1.5, "max_sideways": 0.3, "reach": 0.25},
    {"max_forward": 1.0, "max_turn": 2.0, "look_ahead": 0.2, "response_file": "response.json"},
    {"robot": "cart"},
)
SOURCES: dict[str, Given] = {
    "laser": {"type": "scan", "topic": "scan", "mount": [0.1, 0.0, 0.0]},
    "walls": {"type": "map", "file": "room.yaml"},
    "lawn": {"type": "keepout", "topic": "lawn", "priority": 2},
    "slow": {"type": "speed", "file": "slow.yaml", "priority": 3},
    "zone": {"type": "polygon", "points": [2.0, -1.0, 3.0, -1.0, 3.0, 1.0, 2.0, 1.0]},
    "pillar": {"type": "circle", "center": [4.0, 1.0], "radius": 0.3, "margin": 0.1},
}
CONCAVE = [0.0, 0.0, 2.0, 0.0, 2.0, 2.0, 1.0, 0.5]
POLYGONS: tuple[list[Any], ...] = (
    CONCAVE,
    [0.0, 0.0, 1.0, 0.0, 2.0, 0.0],  # on a line
    [0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0],  # crosses itself
    [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0],  # twice a corner
    [0.0, 0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0, 0.0, 1.0],
    [math.cos(k // 2) if k % 2 else math.sin(k // 2) for k in range(24)],
    [0.0, 0.0, 1e300, 0.0, 1e300, 1e300],
    [1e12, 0.0, 1e12 + 1.0, 0.0, 1e12, 1.0],
)
"""None of them is strictly convex, of 8 corners at most, and somewhere on earth."""
TOPICS = ("", "a b", "1st", "a//b", "a/", "ä", "{a", "a-b", "~a", "/", "a\nb")
"""None of them is a topic's name."""


class Outcome(NamedTuple):
    """What came of a file."""

    name: str  # of the parameter
    value: Any
    refused: bool
    named: bool  # whether the message contains the name
    harmless: bool  # whether it is the valid file in another form
    message: str

    @property
    def is_well(self) -> bool:
        """Whether the file was refused by name, or is valid."""
        return self.named if self.refused else self.harmless


def write_files(folder: Path) -> None:
    """Write the files of valid parameters, and malformed ones."""
    white = np.full((40, 40), 254, dtype=np.uint8)
    white[:3] = 0
    for name, mode in (("room", "trinary"), ("slow", "scale")):
        Image.fromarray(white).save(folder / f"{name}.pgm")
        text = f"image: {name}.pgm\nresolution: 0.1\norigin: [-2.0, -2.0, 0.0]\nmode: {mode}\n"
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    (folder / "noimage.yaml").write_text(text.replace("slow.pgm", "none.pgm"), encoding="utf-8")
    (folder / "nan.yaml").write_text(text.replace("0.1", "nan"), encoding="utf-8")
    (folder / "empty.yaml").write_text("", encoding="utf-8")
    (folder / "binary.yaml").write_bytes(bytes(range(256)))
    (folder / "list.yaml").write_text("[1, 2]", encoding="utf-8")
    (folder / "folder.yaml").mkdir()
    Response(time_constant=0.1, delay=0.05).save(folder / "response.json")
    (folder / "malformed.json").write_text('{"time_constant": -1}', encoding="utf-8")


BAD_FILES = ("missing.yaml", "noimage.yaml", "nan.yaml", "empty.yaml", "binary.yaml", "list.yaml",
              "folder.yaml", "malformed.json", "\0")  # fmt: skip


def sound(rng: Rng, folder: Path) -> Given:
    """Return a valid file."""
    names = [name for name in SOURCES if rng.random() < 0.5]
    given: Given = {**ROBOTS[int(rng.integers(len(ROBOTS)))], "observation_sources": names}
    for name in names:
        given |= {f"{name}.{key}": value for key, value in SOURCES[name].items()}
    for key in list(given):
        if key.split(".")[-1] in ("file", "response_file"):
            given[key] = str(folder / given[key])
    return given


def invalid(given: Mapping[str, Any], folder: Path) -> Iterator[tuple[str, Any]]:
    """Yield the name of a parameter and an invalid value."""
    names = given["observation_sources"]
    for name, one in by_name(names).items():
        yield from ((name, value) for value in _of_kind(one))
        last = name.split(".")[-1]
        is_grid = "." in name and given.get(f"{name.split('.')[0]}.type") in GRIDS
        if last == "response_file" or (last == "file" and is_grid):
            yield from ((name, str(folder / file)) for file in BAD_FILES)
        if last == "points" and name.startswith("zone."):
            yield from ((name, points) for points in POLYGONS)
        if last.endswith("topic") and (last != "state_topic"):
            yield from ((name, topic) for topic in TOPICS if topic or given.get(name))
    yield from (
        ("robot", robot) for robot in ("warehouse", str(folder / "malformed.json"), "\0", "go9")
    )
    yield from (("footprint", text) for text in ("[[1, 2]]", "[[0,0],[nan,1],[1,0]]", "round", "["))
    for name in by_name(names):
        yield f"{name}s", 1.0
        yield f"x{name}", True
    for name in ("absent", "LASER"):
        yield f"{name}.type", "scan"
    yield "global_frame_id", "map"
    yield "observation_sources", [*names, *(names or ["a"])[:1], "a"]
    yield "cmd_vel_out_topic", given.get("cmd_vel_in_topic", "cmd_vel_smoothed")
    yield "v_max", 1e-3
    for name in names:
        if name != "lawn":  # it has no parameter of its type alone
            yield f"{name}.type", "polygon" if name != "zone" else "circle"


def _of_kind(one: Parameter) -> Iterator[Any]:
    """Yield values of other types, and numbers and texts out of range."""
    yield None
    yield {}
    numbers = [math.nan, math.inf, -math.inf, 10**400, -1e300]
    if one.kind is not bool:
        yield True
    if one.kind is str:
        yield from (3, 0.5, [], ["cart"], b"scan")
        yield from ("other", "SCAN") if one.choices else ()
    elif one.kind is bool:
        yield from (1, 0, "true", "yes", [True], 0.0)
    elif one.kind is Numbers:
        yield from ("0 0 0", 1.0, ["a", 0.0, 0.0], [True, 0.0, 0.0], [[0.0, 0.0, 0.0]], [0.0])
        yield from ([0.0, number, 0.0] for number in numbers)
    elif one.kind is Texts:
        yield from ("scan", [1], [""], ["a", "a"], ["a.b"], ["1st"], [None], ["period"])
    else:
        yield from ("fast", [1.0], "1.0", *numbers)
        yield from (one.low - 0.001, one.low - 1e6) if math.isfinite(one.low) else ()
        yield from (one.high + 0.001, one.high + 1e6) if math.isfinite(one.high) else ()
        yield from (1.5,) if one.kind is int else ()


def harmless(given: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the same values in another form."""
    for name, one in by_name(given["observation_sources"]).items():
        value = given.get(name, one.default)
        if one.kind is float and float(value).is_integer():
            yield name, int(value)
        elif one.kind is int:
            yield name, float(value)
        elif one.kind is Numbers:
            yield name, tuple(value)
    yield "use_sim_time", True
    yield "qos_overrides./clock.subscription.depth", 1


def try_file(whole: Given, name: str, value: Any) -> Outcome:
    """Read a file with another value, and configure the core with it."""
    try:
        settings = read({**whole, name: value})
        NodeCore(settings)
    except HcbfError as error:
        return Outcome(name, value, True, _names(error, name), False, str(error))
    same = Settings.__eq__(settings, read(whole)) is True
    return Outcome(name, value, False, False, same, "taken")


def _names(error: HcbfError, name: str) -> bool:
    """Return whether an error is about a parameter, and contains its whole name."""
    text = str(error)
    whole = re.search(rf"(?<![\w.]){re.escape(name)}(?![\w.])", text)
    return text.startswith("parameter") and whole is not None


def draw(seed: int, folder: Path) -> tuple[Given, str, Any]:
    """Return a valid file and another value for it; one of ten is the same in another form."""
    rng = np.random.default_rng([35, seed])
    given = sound(rng, folder)
    every = list(harmless(given) if rng.random() < 0.1 else invalid(given, folder))
    names = sorted({name for name, _ in every})
    chosen = names[int(rng.integers(len(names)))]
    values = [value for name, value in every if name == chosen]
    return given, chosen, values[int(rng.integers(len(values)))]


def run(count: int, folder: Path, first: int = 0) -> list[Outcome]:
    """Return the outcomes of so many files."""
    write_files(folder)
    return [try_file(*draw(seed, folder)) for seed in range(first, first + count)]


def lines(quick: bool) -> Iterator[str]:
    """Yield how many malformed files are refused."""
    count = 20 if quick else 200
    with tempfile.TemporaryDirectory() as folder:
        found = run(count, Path(folder))
    refused = sum(one.refused for one in found)
    named = sum(one.refused and one.named for one in found)
    same = sum(not one.refused and one.harmless for one in found)
    yield f"{count} files: {refused} refused, {named} of them by name; {count - refused} taken, "
    yield f"{same} of them the valid file in another form"
    for seed, one in enumerate(found):
        if not one.is_well:
            yield f"   MISS seed {seed}: {one.name} = {one.value!r}: {one.message[:200]}"
