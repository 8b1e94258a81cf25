"""Maps bent at random: YAML, images, masks and arrays are refused in words, or read right.

``python -m tests.maps.bent --count 1000`` bends so many, each from its number.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from hcbf_gym.errors import InvalidInputError
from hcbf_robots.maps import Grid, MapClass, RankedMap, Scan

NUMBERS = (
    0,
    -1,
    1e-9,
    1e300,
    "nan",
    ".inf",
    "-.inf",
    "",
    "one",
    "[1]",
    "true",
    "0x10",
    "1e3",
    10**40,
)
ORIGINS = ("[0, 0]", "[0, 0, nan]", "[a, b, c]", "[]", "3", "[1e9, 0, 0]", "{x: 1}", "[0, 0, 0, 0]")
TEXTS = ("nothing.pgm", "", "/", "..", "[1]", "\x00", "map.yaml", "a" * 5000)
SHAPES = ((1, 1), (1, 40), (40, 1), (23, 17))
RANKS = (0, -3, 65, 1.5, "1", None, True, np.nan, {}, [1])
FIELDS = ({}, {"rank": 2, "kind": "sped"}, {"rank": 2, "limit": 1.0}, {"rank": 2, "kind": "speed"},
          {"rank": 2, "base": 1.0}, {"rank": 1, "margin": -1}, {"rank": 1, "colour": "red"},
          {"rank": 2, "kind": "speed", "base": np.nan, "multiplier": 1.0},
          {"rank": 2, "kind": "speed", "base": 0.1, "multiplier": 0.001})  # fmt: skip


def pick(rng, choices):
    return choices[rng.integers(len(choices))]


def pixels(rng):
    """Return an image: of two greys, of all greys, of one, or all occupied."""
    shape = pick(rng, SHAPES)
    greys = pick(rng, ((0, 254), (0, 100, 205, 254), (254,), (0,), tuple(range(256))))
    return rng.choice(greys, shape).astype(np.uint8)


def image(rng, path):
    """Write an image, a damaged one, or none."""
    form = pick(rng, ("L", "L", "L", "RGBA", "I;16", "cut", "text", "none", "huge"))
    grey = Image.fromarray(pixels(rng))
    if form == "huge":
        path.write_bytes(b"P5 %d %d 255\n" % (rng.integers(6_000, 10**7), 10**7))
    elif form == "text":
        path.write_text("no image")
    elif form == "I;16":
        Image.fromarray(np.full((5, 5), 3000, dtype=np.uint16)).save(path, "PPM")
    elif form != "none":
        grey.convert("RGBA" if form == "RGBA" else "L").save(
            path, "PNG" if form == "RGBA" else "PPM"
        )
    if form == "cut":
        path.write_bytes(path.read_bytes()[: rng.integers(1, 20)])


def description(rng):
    """Return the text of a YAML file of which a line or two are bent."""
    keys = {"image": "map.pgm", "resolution": 0.05, "origin": "[1, 2, 0.3]", "mode": "trinary",
            "negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.25}  # fmt: skip
    for _ in range(rng.integers(0, 3)):
        key = pick(rng, list(keys) or ["image"])
        how = rng.integers(4)
        if how == 0:
            del keys[key]
        elif how == 1:
            keys[f"{key}_"] = keys.pop(key)
        else:
            texts = {"image": TEXTS, "origin": ORIGINS}
            keys[key] = pick(rng, texts.get(key, NUMBERS))
        keys = keys or {"image": "map.pgm"}
    lines = [f"{key}: {value}" for key, value in keys.items()]
    if rng.random() < 0.1:
        lines.insert(
            int(rng.integers(len(lines) + 1)), pick(rng, ("- x", "a: b: c", "&a *a", "\t"))
        )
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


def or_bent(rng, good, bent):
    """Return what is good in four cases of five."""
    return good if rng.random() < 0.8 else pick(rng, bent)


def of_arrays(rng, folder):
    cells = rng.random(pick(rng, SHAPES)) < rng.random()
    bent = or_bent(rng, cells, (cells.astype(float), cells[0], cells.tolist(), None, "cells"))
    kind = or_bent(rng, "keepout", ("unknown", "speed", "wall", 3))
    limit = or_bent(rng, 0.5 if kind == "speed" else None, (0.0, -1.0, np.nan, np.inf, "fast"))
    grid = Grid(
        or_bent(rng, 0.05, (0.0, np.nan, -1, "x", 1e9)),
        or_bent(rng, (1, 2, 3), ((0, 0), (np.inf, 0, 0), "abc", (1e9, 0, 0))),
        or_bent(rng, cells.shape, ((0, 3), (2.5, 1), (10**9, 10**9), None)),
    )
    rank, margin = or_bent(rng, 1, RANKS), or_bent(rng, 0.0, (-1, "x"))
    return RankedMap(grid, (MapClass("a", rank, kind, bent, limit, margin),))


def of_dict(rng, folder):
    grid = Grid(0.05, (0.0, 0.0, 0.0), (7, 9))
    told = RankedMap(grid, (MapClass("a", 1, "keepout", rng.random((7, 9)) < 0.5),)).to_dict()
    key = pick(rng, list(told))
    told[key] = or_bent(rng, told[key], (None, 3, "x", [], [1], {}, (np.nan,) * 3))
    cells = or_bent(rng, told["classes"], (["eJwDAAAAAAE="], [None], [3], ["x"]))
    if cells is not told["classes"] and isinstance(told["classes"], list):
        told["classes"] = [{"name": "a", "rank": 1, "kind": "keepout", "cells": cells[0]}]
    return RankedMap.from_dict(told)


def of_scan(rng, folder):
    points = ([[1.0, np.nan]], [[1, 2, 3]], "x", [[1e300, 0]], None, [[0, 0]], [])
    poses = ((0, 0), (np.nan, 0, 0), None, (1e9, 0, 0))
    scan = Scan(
        "laser",
        or_bent(rng, rng.normal(size=(9, 2)), points),
        or_bent(rng, (1, 2, 3), poses),
        or_bent(rng, 0.1, (-1, np.nan, "x")),
        or_bent(rng, 0.0, (1e300, -1)),
    )
    return scan.conditions[0]


def bend(number, folder):
    """Bend one map; whether it was read. What comes through must hold together.

    Raises:
        AssertionError: if it holds not.
    """
    rng = np.random.default_rng(number)
    kind = pick(rng, (of_files, of_files, of_arrays, of_dict, of_scan))
    try:
        found = kind(rng, folder)
    except InvalidInputError as error:
        if "got" not in str(error) and "missing" not in str(error):
            raise AssertionError(f"{error}: what was got?") from error
        return False
    if isinstance(found, RankedMap):
        middle = found.grid.to_world(rng.uniform(0.0, 1.0, (5, 2)) * found.grid.shape[::-1])
        assert not np.isnan(found.distance(middle)).any()
        for one in found.classes:
            assert bool(found.polygons(one.name)) == bool(one.cells.any())
    return True


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=1000)
    count = parser.parse_args().count
    read = 0
    for number in range(count):
        with tempfile.TemporaryDirectory() as folder:
            try:
                read += bend(number, Path(folder))
            except Exception:
                print(f"number {number}")
                raise
    print(f"{count} bent: {count - read} refused in words, {read} read right")


if __name__ == "__main__":
    main()
