import json

import numpy as np
import pytest
from PIL import Image

from hcbf_gym.errors import InvalidInputError
from hcbf_gym.maps import Grid, MapClass, RankedMap
from hcbf_gym.maps.nav2 import FREE, OCCUPIED, UNKNOWN, read
from hcbf_gym.online import VelocityFilter
from hcbf_gym.programs import FilterStatus
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
    assert (
        raw.occupancy[::-1].tolist() == np.where(PIXELS > 100, UNKNOWN, PIXELS.astype(int)).tolist()
    )


def test_a_map_with_masks_travels_through_json(tmp_path):
    file = write(tmp_path)
    write(tmp_path, "zone", 255 - PIXELS)
    masks = {"zone.yaml": {"rank": 2, "kind": "speed", "limit": 0.4}}
    ranked = RankedMap.load(file, masks, unknown=3)
    again = RankedMap.from_dict(json.loads(json.dumps(ranked.to_dict())))
    assert again == ranked
    names = [(c.name, c.rank, c.kind, c.limit) for c in again.classes]
    assert names == [
        ("occupied", 1, "keepout", None),
        ("unknown", 3, "unknown", None),
        ("zone", 2, "speed", 0.4),
    ]


def test_a_map_of_arrays_travels_through_json():
    zone = MapClass("zone", 2, "speed", cells(5), limit=0.5, margin=0.1)
    ranked = room(0, (1.0, 2.0, 0.3), zone=zone)
    again = RankedMap.from_dict(json.loads(json.dumps(ranked.to_dict())))
    assert again == ranked
    assert all(
        (a.cells == b.cells).all() for a, b in zip(again.classes, ranked.classes, strict=True)
    )


@pytest.mark.parametrize(
    ("keys", "says"),
    [
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
        ({"imagee": "map.pgm"}, "imagee"),
    ],
)
def test_a_bent_description_is_refused_with_what_is_wrong(tmp_path, keys, says):
    with pytest.raises(InvalidInputError, match=says):
        RankedMap.load(write(tmp_path, **keys))


def test_a_map_without_a_free_cell_is_refused(tmp_path):
    with pytest.raises(InvalidInputError, match="no cell that a robot may be in"):
        RankedMap.load(write(tmp_path, pixels=np.zeros((3, 3), dtype=np.uint8)))


def test_a_mask_over_other_cells_is_refused(tmp_path):
    file = write(tmp_path)
    write(tmp_path, "zone", PIXELS[:2])
    with pytest.raises(InvalidInputError, match="expected the map's"):
        RankedMap.load(file, {"zone.yaml": 2})


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


def test_a_filter_stops_at_the_edge_of_a_map_and_says_where_it_may_not_be():
    free = np.zeros((60, 60), dtype=np.bool_)
    ranked = RankedMap(
        Grid(0.1, (0.0, 0.0, 0.0), free.shape), (MapClass("unknown", 1, "unknown", free),)
    )
    door = VelocityFilter("cart", [ranked], radius=0.0)
    _, report = door.step((1.0, 0.0), (7.0, 3.0, 0.0), (0.0, 0.0, 0.0), 0.0)
    assert report["status"] == FilterStatus.UNSAFE
    door.reset()
    x, speed = 3.0, 0.0
    for k in range(200):
        (speed, _), report = door.step((1.0, 0.0), (x, 3.0, 0.0), (speed, 0.0, 0.0), 0.05 * k)
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


def test_a_window_that_leaves_the_grid_is_refused():
    with pytest.raises(InvalidInputError, match="window"):
        room().update((55, 0), {"walls": np.ones((10, 2), dtype=np.bool_)})
    with pytest.raises(InvalidInputError, match="walls"):
        room().update((0, 0), {"doors": np.ones((1, 1), dtype=np.bool_)})


@pytest.mark.parametrize("window", [None, {"walls": [[True], [True, False]]}, {"walls": None}])
def test_a_window_that_is_none_is_refused(window):
    with pytest.raises(InvalidInputError, match="map update"):
        room().update((0, 0), window)


@pytest.mark.parametrize("classes", [None, 3, "walls", (3,), MapClass("a", 1, "keepout", cells(0))])
def test_classes_that_are_none_are_refused(classes):
    with pytest.raises(InvalidInputError, match="classes"):
        RankedMap(room().grid, classes)


def test_classes_that_share_a_name_or_do_not_fit_are_refused():
    one = MapClass("a", 1, "keepout", cells(0))
    grid = Grid(0.05, (0, 0, 0), one.cells.shape)
    with pytest.raises(InvalidInputError, match="different"):
        RankedMap(grid, (one, one))
    with pytest.raises(InvalidInputError, match="shape"):
        RankedMap(Grid(0.05, (0, 0, 0), (3, 3)), (one,))
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
