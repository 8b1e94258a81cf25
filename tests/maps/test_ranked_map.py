import itertools
import json
import logging
import warnings

import numpy as np
import pytest
from PIL import Image

from hcbf_gym import _core
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.programs import FilterStatus
from hcbf_robots import VelocityFilter
from hcbf_robots.maps import Grid, MapClass, RankedMap
from hcbf_robots.maps.nav2 import FREE, OCCUPIED, UNKNOWN, read
from tests.maps.floors import MAPS, ORIGINS, WITHOUT_MAPS, cells, room, true_distance

PIXELS = np.array([[0, 254, 205], [254, 100, 254], [150, 254, 254]], dtype=np.uint8)


def write(folder, name="map", pixels=PIXELS, suffix="pgm", **keys):
    Image.fromarray(pixels).save(folder / f"{name}.{suffix}")
    keys = {"image": f"{name}.{suffix}", "resolution": 0.1, "origin": "[0, 0, 0]"} | keys
    text = "\n".join(f"{key}: {value}" for key, value in keys.items())
    (folder / f"{name}.yaml").write_text(text)
    return folder / f"{name}.yaml"


def test_trinary_maps_read_as_the_map_server_reads_them(tmp_path):
    raster = read(write(tmp_path, free_thresh=0.196, occupied_thresh=0.65, negate=0))
    shares = 1.0 - PIXELS[::-1] / 255.0  # the image's last row is the lowest
    assert (raster.occupancy == OCCUPIED).tolist() == (shares > 0.65).tolist()
    assert (raster.occupancy == FREE).tolist() == (shares < 0.196).tolist()
    assert ((raster.occupancy == UNKNOWN) == ((shares >= 0.196) & (shares <= 0.65))).all()
    turned = read(write(tmp_path, suffix="png", negate="true", free_thresh=0.2))
    assert (turned.occupancy[2] == [FREE, OCCUPIED, OCCUPIED]).all()


def test_scale_and_raw_maps_read_as_the_map_server_reads_them(tmp_path):
    scaled = read(write(tmp_path, mode="scale", free_thresh=0.0, occupied_thresh=1.0))
    assert scaled.occupancy[::-1].tolist() == np.rint(100 - PIXELS / 2.55).tolist()
    raw = read(write(tmp_path, mode="raw"))
    np.testing.assert_array_equal(
        raw.occupancy[::-1], np.where(PIXELS > 100, UNKNOWN, PIXELS.astype(int))
    )


THRESHOLDS = itertools.product((0.05, 0.19, 0.196, 0.25, 0.5, 0.9), (0.1, 0.3, 0.65, 0.95))


@pytest.mark.parametrize(("free", "occupied"), [pair for pair in THRESHOLDS if pair[0] < pair[1]])
@pytest.mark.parametrize("negate", [0, 1])
def test_what_was_never_seen_is_unknown_whatever_the_thresholds(tmp_path, free, occupied, negate):
    pixels = 255 - PIXELS if negate else PIXELS
    file = write(tmp_path, pixels=pixels, free_thresh=free, occupied_thresh=occupied, negate=negate)
    assert read(file).occupancy[2, 2] == UNKNOWN
    for unknown in (1, 2, None):
        ranked = RankedMap.load(file, unknown=unknown)
        cells = {one.name: one.cells for one in ranked.classes}
        assert not cells["occupied"][2, 2]
        assert unknown is None or cells["unknown"][2, 2]


def test_a_load_logs_how_many_cells_are_free_occupied_and_unknown(tmp_path, caplog):
    file = write(tmp_path, free_thresh=0.25, occupied_thresh=0.65)
    with caplog.at_level(logging.INFO, logger="hcbf_robots.maps"):
        RankedMap.load(file, unknown=None)  # the greys 100, 150 and 205 are unknown
    assert f"map {file}: 5 cells free, 1 occupied, 3 unknown" in caplog.text


def test_a_grey_of_a_mask_is_what_its_thresholds_make_of_it(tmp_path):
    file = write(tmp_path, pixels=np.full((3, 3), 254, dtype=np.uint8))
    grey = np.full((3, 3), 254, dtype=np.uint8)
    grey[0, 0] = 205
    write(tmp_path, "mask", pixels=grey, free_thresh=0.05, occupied_thresh=0.1)
    ranked = RankedMap.load(file, {"mask.yaml": 2})
    assert ranked.classes[-1].cells[2, 0]


@pytest.mark.filterwarnings("ignore:map .* are not read")
@pytest.mark.parametrize("depth", [2_000, 30_000])
@pytest.mark.parametrize("key", ["origin", "image", "resolution", "other"])
def test_brackets_in_brackets_are_refused(tmp_path, depth, key):
    keys = {"resolution": "["} if key == "other" else {}
    file = write(tmp_path, **({key: "[" * depth + "]" * depth} | keys))
    with pytest.raises(InvalidInputError, match="got"):
        RankedMap.load(file)


def test_a_map_with_masks_travels_through_json(tmp_path):
    file = write(tmp_path)
    write(tmp_path, "zone", 255 - PIXELS)
    masks = {"zone.yaml": {"rank": 2, "kind": "speed", "limit": 0.4}}
    ranked = RankedMap.load(file, masks, unknown=3)
    again = RankedMap.from_dict(json.loads(json.dumps(ranked.to_dict())))
    assert again == ranked
    assert [(c.name, c.rank, c.kind, c.limit) for c in again.classes] == [
        ("occupied", 1, "keepout", None),
        ("unknown", 3, "unknown", None),
        ("zone", 2, "speed", 0.4),
    ]
    zone = MapClass("zone", 2, "speed", cells(5), limit=0.5, margin=0.1)
    ranked = room(0, (1.0, 2.0, 0.3), zone=zone)  # of arrays
    again = RankedMap.from_dict(json.loads(json.dumps(ranked.to_dict())))
    assert again == ranked
    for one, other in zip(again.classes, ranked.classes, strict=True):
        np.testing.assert_array_equal(one.cells, other.cells)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"pixels": np.zeros((3, 3), dtype=np.uint8)}, "no cell that a robot may be in"),
        ({"resolution": 0}, "resolution"),
        ({"resolution": "nan"}, "resolution"),
        ({"resolution": ".inf"}, "resolution"),
        ({"origin": "[0, 0]"}, "origin"),
        ({"origin": "[0, 0, nan]"}, "origin"),
        ({"mode": "colour"}, "raw"),
        ({"negate": 2}, "negate"),
        ({"free_thresh": 0.9}, "occupied_thresh"),
        ({"image": "nothing.pgm"}, "PGM"),
        ({"image": "[1, 2]"}, "PGM"),
    ],
)
def test_a_malformed_map_is_refused_with_the_cause(tmp_path, keys, message):
    with pytest.raises(InvalidInputError, match=message):
        RankedMap.load(write(tmp_path, **keys))


@pytest.mark.parametrize(
    "content", [b"", b"no image", b"P5 3 3 255\n\0", b"P5 3 3 65535\n" + bytes(18)]
)
def test_a_damaged_image_is_refused(tmp_path, content):
    file = write(tmp_path)
    (tmp_path / "map.pgm").write_bytes(content)
    with pytest.raises(InvalidInputError, match="got"):
        RankedMap.load(file)


@pytest.mark.parametrize("text", ["", "- x", "a: b: c", "&a *a", "\t", "image: map.pgm"])
def test_a_malformed_description_is_refused(tmp_path, text):
    file = write(tmp_path)
    file.write_text(text)
    with pytest.raises(InvalidInputError, match=r"got|missing"):
        RankedMap.load(file)


@pytest.mark.parametrize("key", ["resolution", "origin", "shape", "classes"])
@pytest.mark.parametrize("value", [None, "x", [], [1], {}, [np.nan] * 3])
def test_a_malformed_record_is_refused(key, value):
    data = room(0, zone=MapClass("zone", 2, "keepout", cells(5))).to_dict()
    assert key in data
    if (key, value) != ("classes", []):
        with pytest.raises(InvalidInputError, match=r"got|missing"):
            RankedMap.from_dict(data | {key: value})
    one = data["classes"][-1] | {"cells": "eJwDAAAAAAE="}
    with pytest.raises(InvalidInputError, match="got"):
        RankedMap.from_dict(data | {"classes": [one]})


def of(cells, grid, points):
    """Return whether points (N, 2) lie in cells of a grid."""
    column, row = np.floor(grid.to_cells(points)).astype(int).T
    inside = (row >= 0) & (row < cells.shape[0]) & (column >= 0) & (column < cells.shape[1])
    return inside & cells[row * inside, column * inside]


def test_a_mask_over_other_cells_is_looked_up_by_position(tmp_path):
    rng = np.random.default_rng(0)
    free = np.full((40, 50), 254, dtype=np.uint8)
    file = write(tmp_path, pixels=free, resolution=0.05, origin=[-1.0, 2.0, 0.0])
    for origin, side in (
        ((-1.0, 2.0, 0.0), 0.05),
        ((-1.2, 1.75, 0.0), 0.05),  # whole cells away
        ((-1.013, 2.02, 0.0), 0.05),
        ((-0.9, 2.1, 0.4), 0.03),
        ((-1.5, 1.5, -0.2), 0.13),
    ):
        grey = np.where(rng.random((30, 33)) < 0.1, 0, 254).astype(np.uint8)
        write(tmp_path, "zone", grey, resolution=side, origin=list(origin))
        ranked = RankedMap.load(file, {"zone.yaml": 2})
        zone = next(one for one in ranked.classes if one.name == "zone")
        mask, grid = Grid(side, origin, grey.shape), ranked.grid
        marked = grey[::-1] == 0

        points = grid.to_world(rng.uniform((0, 0), (50, 40), (20_000, 2)))
        inner = mask.to_cells(points) % 1.0
        clear = ((inner > 0.01) & (inner < 0.99)).all(axis=1)  # of a cell's edge
        assert of(zone.cells, grid, points[of(marked, mask, points) & clear]).all()
        centres = grid.to_world(np.argwhere(np.ones(grid.shape))[:, ::-1] + 0.5)
        nav2 = of(marked, mask, centres).reshape(grid.shape)
        assert nav2.any()
        assert zone.cells[nav2].all()
        aligned = side == 0.05 and abs((origin[0] + 1.0) / 0.05 % 1.0) < 1e-6
        if aligned:
            np.testing.assert_array_equal(zone.cells, nav2)
        within = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 40)] * 2), axis=-1).reshape(-1, 2)
        for row, column in np.argwhere(zone.cells & ~nav2)[:100]:
            assert of(marked, mask, grid.to_world(np.array([column, row]) + within)).any()


def test_cells_of_a_mask_beyond_a_map_are_warned_of_where_that_is_free(tmp_path):
    file = write(tmp_path, pixels=np.full((5, 5), 254, dtype=np.uint8))
    write(tmp_path, "zone", np.zeros((8, 5), dtype=np.uint8))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        RankedMap.load(file, {"zone.yaml": 2})
    with pytest.warns(UserWarning, match="beyond the map"):
        RankedMap.load(file, {"zone.yaml": 2}, unknown=None)


def test_keys_that_are_not_known_are_named(tmp_path):
    with pytest.warns(UserWarning, match=r"\['colour'\] are not read"):
        RankedMap.load(write(tmp_path, colour="red"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        RankedMap.load(write(tmp_path, map_type="occupancy"))


@pytest.mark.parametrize("origin", ORIGINS)
def test_what_lies_outside_the_grid_belongs_to_the_unknown(origin):
    unknown = MapClass("unknown", 1, "unknown", cells(3))
    ranked = room(0, origin, unknown=unknown)
    rows, columns = ranked.grid.shape
    at = np.random.default_rng(0).uniform(-200.0, 300.0, (2000, 2))
    at[0] = 1e5
    points = ranked.grid.to_world(at)
    inside = np.minimum(at, (columns, rows) - at).min(axis=1) * ranked.grid.resolution
    walls, beyond = ranked.conditions
    h = np.array([beyond.nearest(point)[0] for point in points])
    truth = true_distance(ranked, unknown.cells, points)
    free = (inside > 0.0) & (h > 0.0)
    assert min(free.sum(), (inside > 0.0).sum(), (inside <= 0.0).sum()) > 30
    assert (h[inside <= 0.0] <= 0.0).all()
    assert (h[free] <= np.minimum(truth, inside)[free] + 1e-9).all()
    assert (h >= np.minimum(ranked.distance(points), inside) - 1e-9)[inside > 0.0].all()
    assert walls.nearest(points[0])[0] > 1e3  # without such a class it is free
    assert len(ranked.polygons("unknown")) == len(beyond.pieces) - 4


def test_a_filter_stops_at_the_edge_of_a_map_and_is_unsafe_beyond():
    free = np.zeros((60, 60), dtype=np.bool_)
    ranked = RankedMap(
        Grid(0.1, (0.0, 0.0, 0.0), free.shape), (MapClass("unknown", 1, "unknown", free),)
    )
    safe = VelocityFilter("cart", [ranked], radius=0.0)
    _, report = safe.step((1.0, 0.0), (7.0, 3.0, 0.0), (0.0, 0.0, 0.0), 0.0)
    assert report["status"] == FilterStatus.UNSAFE
    safe.reset()
    x, speed = 3.0, 0.0
    for k in range(200):
        (speed, _), report = safe.step((1.0, 0.0), (x, 3.0, 0.0), (speed, 0.0, 0.0), 0.05 * k)
        x += 0.05 * speed
    assert 5.0 < x < 6.0  # of the axle
    assert report["status"] == FilterStatus.SAFE


def test_a_path_may_name_an_environment_variable(tmp_path, monkeypatch):
    write(tmp_path)
    monkeypatch.setenv("HERE", str(tmp_path))
    assert RankedMap.load("$HERE/map.yaml").grid.shape == (3, 3)
    with pytest.raises(InvalidInputError, match="variables"):
        RankedMap.load("$NOWHERE_AT_ALL/map.yaml")


@pytest.mark.parametrize("size", [10_000, 100_000])
def test_a_huge_image_is_refused_before_it_is_decoded(tmp_path, size):
    file = write(tmp_path)
    (tmp_path / "map.pgm").write_bytes(b"P5 %d %d 255\n" % (size, size))
    with pytest.raises(InvalidInputError, match=r"cells|pixels"):
        RankedMap.load(file)


@pytest.mark.parametrize(
    ("corner", "window", "message"),
    [
        ((55, 0), {"walls": np.ones((10, 2), dtype=np.bool_)}, "window"),
        ((0, 0), {"doors": np.ones((1, 1), dtype=np.bool_)}, "walls"),
        ((0, 0), None, "map update"),
        ((0, 0), {"walls": [[True], [True, False]]}, "map update"),
        ((0, 0), {"walls": None}, "map update"),
    ],
)
def test_a_malformed_window_is_refused(corner, window, message):
    with pytest.raises(InvalidInputError, match=message):
        room().update(corner, window)


ONE = MapClass("a", 1, "keepout", cells(0))


@pytest.mark.parametrize(
    ("classes", "message"),
    [
        *((classes, "classes") for classes in (None, 3, "walls", (3,), ONE)),
        ((ONE, ONE), "different"),
        ((MapClass("b", 1, "keepout", np.zeros((3, 3), dtype=np.bool_)),), "shape"),
    ],
)
def test_classes_that_are_none_or_do_not_fit_are_refused(classes, message):
    with pytest.raises(InvalidInputError, match=message):
        RankedMap(room().grid, classes)


def test_a_limit_of_a_keepout_is_refused():
    with pytest.raises(InvalidInputError, match="speed"):
        MapClass("z", 1, "keepout", cells(0), limit=1.0)


@pytest.mark.skipif(not MAPS.is_dir(), reason=WITHOUT_MAPS)
def test_the_maps_of_nav2_are_read_unchanged():
    depot = RankedMap.load(
        MAPS / "depot.yaml",
        {
            "depot_keepout.yaml": 2,
            "depot_speed.yaml": {"rank": 3, "kind": "speed", "base": 1.0, "multiplier": -0.01},
        },
    )
    assert depot.grid.shape == (307, 604)
    assert [c.limit for c in depot.classes if c.kind == "speed"] == [0.8, 0.75, 0.5]
    assert len(depot.polygons("occupied")) < 400


@pytest.mark.parametrize("x", [np.nan, np.inf, -np.inf, 1e300])
def test_no_index_leaves_the_atlas_whatever_the_place(x):
    """The process does not crash: numbers behind the atlas would lead far out of memory."""
    atlas = room().conditions[0].pieces.packed
    memory = np.concatenate([atlas, 1e15 * np.arange(1.0, atlas.size + 1.0)])
    found = np.full(64, -1)
    count = _core.pieces_near(memory[: atlas.size], 0, x, np.nan, 1.0, found)
    assert (found[:count] < atlas.size).all()
