"""Malformed maps: YAML, images, masks and arrays are refused in words, or read right."""

import numpy as np
import pytest
from PIL import Image

from hcbf_gym.errors import InvalidInputError
from hcbf_robots.maps import Grid, MapClass, RankedMap, Scan

NUMBERS = (0, -1, 1e-9, 1e300, "nan", ".inf", "-.inf", "", "one", "[1]", "true", "0x10", 10**40)
ORIGINS = ("[0, 0]", "[0, 0, nan]", "[a, b, c]", "[]", "3", "[1e9, 0, 0]", "{x: 1}", "[0, 0, 0, 0]")
TEXTS = ("nothing.pgm", "", "/", "..", "[1]", "\x00", "map.yaml", "a" * 5000)
SHAPES = ((1, 1), (1, 40), (40, 1), (23, 17))
GREYS = ((0, 254), (0, 100, 205, 254), (254,), (0,), tuple(range(256)))
RANKS = (0, -3, 65, 1.5, "1", None, True, np.nan, {}, [1])
SPEED = {"rank": 2, "kind": "speed"}
FIELDS = ({}, {"rank": 2, "kind": "sped"}, {"rank": 2, "limit": 1.0}, SPEED,
          {"rank": 2, "base": 1.0}, {"rank": 1, "margin": -1}, {"rank": 1, "colour": "red"},
          SPEED | {"base": np.nan, "multiplier": 1.0}, SPEED | {"base": 0.1, "multiplier": 0.001},
          )  # fmt: skip


def pick(rng, choices):
    return choices[rng.integers(len(choices))]


def image(rng, path):
    """Write an image, a damaged one, or none."""
    form = pick(rng, ("L", "L", "L", "RGBA", "I;16", "cut", "text", "none", "huge"))
    grey = Image.fromarray(rng.choice(pick(rng, GREYS), pick(rng, SHAPES)).astype(np.uint8))
    if form == "huge":
        path.write_bytes(b"P5 %d %d 255\n" % (rng.integers(6_000, 10**7), 10**7))
    elif form == "text":
        path.write_text("no image")
    elif form == "I;16":
        Image.fromarray(np.full((5, 5), 3000, dtype=np.uint16)).save(path, "PPM")
    elif form == "RGBA":
        grey.convert("RGBA").save(path, "PNG")
    elif form != "none":
        grey.save(path, "PPM")
    if form == "cut":
        path.write_bytes(path.read_bytes()[: rng.integers(1, 20)])


def description(rng):
    """Return the text of a YAML file of which a line or two are malformed."""
    keys = {"image": "map.pgm", "resolution": 0.05, "origin": "[1, 2, 0.3]", "mode": "trinary",
            "negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.25}  # fmt: skip
    for _ in range(rng.integers(0, 3)):
        key, how = pick(rng, list(keys)), rng.integers(4)
        if how == 0:
            del keys[key]
        elif how == 1:
            keys[f"{key}_"] = keys.pop(key)
        else:
            keys[key] = pick(rng, {"image": TEXTS, "origin": ORIGINS}.get(key, NUMBERS))
    lines = [f"{key}: {value}" for key, value in keys.items()]
    if rng.random() < 0.1:
        lines.insert(rng.integers(len(lines) + 1), pick(rng, ("- x", "a: b: c", "&a *a", "\t")))
    return "\n".join(lines)


def of_files(rng, folder):
    image(rng, folder / "map.pgm")
    (folder / "map.yaml").write_text(description(rng), encoding="utf-8")
    options = {}
    if rng.random() < 0.3:
        (folder / "mask.yaml").write_text(description(rng), encoding="utf-8")
        options["masks"] = {"mask.yaml": pick(rng, (*RANKS, 2, 2, *FIELDS))}
    if rng.random() < 0.2:
        options[pick(rng, ("rank", "unknown", "margin"))] = pick(rng, RANKS)
    return RankedMap.load(folder / "map.yaml", **options)


def fuzzed(rng, good, wrong):
    """Return a good value in four cases of five."""
    return good if rng.random() < 0.8 else pick(rng, wrong)


def of_arrays(rng, folder):
    cells = rng.random(pick(rng, SHAPES)) < rng.random()
    given = fuzzed(rng, cells, (cells.astype(float), cells[0], cells.tolist(), None, "cells"))
    kind = fuzzed(rng, "keepout", ("unknown", "speed", "wall", 3))
    limit = fuzzed(rng, 0.5 if kind == "speed" else None, (0.0, -1.0, np.nan, np.inf, "fast"))
    grid = Grid(
        fuzzed(rng, 0.05, (0.0, np.nan, -1, "x", 1e9)),
        fuzzed(rng, (1, 2, 3), ((0, 0), (np.inf, 0, 0), "abc", (1e9, 0, 0))),
        fuzzed(rng, cells.shape, ((0, 3), (2.5, 1), (10**9, 10**9), None)),
    )
    rank, margin = fuzzed(rng, 1, RANKS), fuzzed(rng, 0.0, (-1, "x"))
    return RankedMap(grid, (MapClass("a", rank, kind, given, limit, margin),))


def of_dict(rng, folder):
    grid = Grid(0.05, (0.0, 0.0, 0.0), (7, 9))
    data = RankedMap(grid, (MapClass("a", 1, "keepout", rng.random((7, 9)) < 0.5),)).to_dict()
    key = pick(rng, list(data))
    data[key] = fuzzed(rng, data[key], (None, 3, "x", [], [1], {}, (np.nan,) * 3))
    cells = fuzzed(rng, data["classes"], (["eJwDAAAAAAE="], [None], [3], ["x"]))
    if cells is not data["classes"] and isinstance(data["classes"], list):
        data["classes"] = [{"name": "a", "rank": 1, "kind": "keepout", "cells": cells[0]}]
    return RankedMap.from_dict(data)


def of_scan(rng, folder):
    points = ([[1.0, np.nan]], [[1, 2, 3]], "x", [[1e300, 0]], None, [[0, 0]], [])
    points = fuzzed(rng, rng.normal(size=(9, 2)), points)
    pose = fuzzed(rng, (1, 2, 3), ((0, 0), (np.nan, 0, 0), None, (1e9, 0, 0)))
    numbers = fuzzed(rng, 0.1, (-1, np.nan, "x")), fuzzed(rng, 0.0, (1e300, -1))
    return Scan("laser", points, pose, *numbers).conditions[0]


@pytest.mark.filterwarnings("ignore:map .* are not read", "ignore:.*beyond the map")
def test_a_malformed_map_is_refused_in_words_or_read_right(tmp_path):
    read, messages = 0, []
    for number in range(80):
        folder, rng = tmp_path / str(number), np.random.default_rng(number)
        folder.mkdir()
        try:
            found = pick(rng, (of_files, of_files, of_arrays, of_dict, of_scan))(rng, folder)
        except InvalidInputError as error:
            messages.append(str(error))
            continue
        read += 1
        if isinstance(found, RankedMap):
            middle = found.grid.to_world(rng.uniform(0.0, 1.0, (5, 2)) * found.grid.shape[::-1])
            assert not np.isnan(found.distance(middle)).any(), number
            for one in found.classes:
                assert bool(found.polygons(one.name)) == bool(one.cells.any()), number
    assert 0 < read < 80
    assert not [text for text in messages if "got" not in text and "missing" not in text]
