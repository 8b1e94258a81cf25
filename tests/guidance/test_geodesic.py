"""The geodesic field and its row: the way it shows, what it can promise, and what it refuses."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from hcbf_gym import _core, guidance, programs, scenarios
from hcbf_gym.barriers import BarrierSet, CbfRows, ConvexPolygon, Disc, HalfPlane, RowSettings
from hcbf_gym.barriers.planar_rows import planar_rows
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.guidance import field as fields

FAR = (Disc("far", 1, (50.0, 50.0), 1.0),)
OPEN = ((-2.0, -3.0), (6.0, 3.0))


def way_of(barriers, goal, extent=OPEN, clearance=0.05, **options):
    way = guidance.Geodesic(**options)
    way.reset(barriers, goal, extent, clearance)
    return way


def row(way, x, t=0.0):
    """a (2,) and b of one state."""
    a, b = way.rows(np.array(x)[None], np.array([t]))
    return a[0], b[0]


def value(way, point):
    """T at a point, by bilinear interpolation."""
    view, (x0, y0, cell, *_) = fields.grid(way.field[0], way.geometry[0]), way.geometry[0]
    column, line = (point[0] - x0) / cell, (point[1] - y0) / cell
    return float(map_coordinates(view.astype(np.float64), [[line], [column]], order=1)[0])


def descend(way, point, steps=400):
    """The points that the field's own descent passes, a cell apart, until it reaches the goal."""
    view, geometry, goal = fields.grid(way.field[0], way.geometry[0]), way.geometry[0], way.goal[0]
    points = [np.array(point)]
    while len(points) < steps and np.linalg.norm(points[-1] - goal) > 1e-9:
        points.append(np.array(_core.field_descent(view, geometry, goal, *points[-1], geometry[2])))
    return np.array(points)


def ring(priority, gap=0):
    """Overlapping discs around (3, 0), all but `gap` of them."""
    angles = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)[: 16 - gap]
    return [
        Disc(f"{k}", priority, (3.0 + 1.5 * np.cos(a), 1.5 * np.sin(a)), 0.4)
        for k, a in enumerate(angles)
    ]


def test_in_the_open_the_field_is_the_distance():
    way = way_of(FAR, (4.0, 0.0))
    for point in ((0.0, 0.0), (1.0, 2.0), (5.5, -2.5), (-1.9, -2.9)):
        distance = np.linalg.norm(np.array(point) - (4.0, 0.0))
        assert distance - 1e-4 <= value(way, point) <= 1.06 * distance + 0.1


@pytest.mark.parametrize("seed", range(20))
def test_the_path_descends_to_the_goal_through_no_region_that_it_need_not_enter(seed):
    scene = scenarios.make("random", np.random.default_rng(seed))
    way = way_of(scene.barriers, scene.goal, None)
    points = descend(way, scene.start)
    np.testing.assert_array_equal(points[-1], scene.goal)
    along = np.array([value(way, point) for point in points])
    assert (np.diff(along[:-1]) < 0.0).all()
    h = BarrierSet([scene.barriers]).along(np.hstack([points, 0.0 * points]), np.zeros(len(points)))
    assert (h[:, h[0] >= 0.0] > 0.0).all()
    left = np.argmax((h > 0.0).all(axis=1))
    assert (h[left:] > 0.0).all()  # what it begins in, it leaves for good
    view = fields.grid(way.field[0], way.geometry[0])
    around = np.pad(view, 1, constant_values=np.inf)
    lower = np.zeros(view.shape, dtype=np.bool_)
    for near in (around[:-2, 1:-1], around[2:, 1:-1], around[1:-1, :-2], around[1:-1, 2:]):
        lower |= near < view
    goal = _core.field_cell_of(*scene.goal, way.geometry[0])
    assert [tuple(cell) for cell in np.argwhere(~lower)] == [goal]  # no other has no lower one


@pytest.mark.parametrize(("priorities", "expected"), [((1, 2), 2), ((2, 3), 3), ((1, 3), 3)])
def test_of_two_walls_across_the_way_the_lower_rank_is_taken(priorities, expected):
    across = [
        ConvexPolygon(f"{k}", rank, ((2.0, y), (2.4, y), (2.4, y + 5.0), (2.0, y + 5.0)))
        for k, (rank, y) in enumerate(zip(priorities, (-5.0, 0.0), strict=True))
    ]
    way = way_of(across, (4.0, -1.0))
    assert way.reachable(np.zeros((1, 4))) == expected
    crossing = min(descend(way, (0.0, -1.0)), key=lambda p: abs(p[0] - 2.2))
    assert (crossing[1] > 0.0) == (expected == priorities[1])


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_a_closed_ring_is_found_unreachable_but_through_its_rank_and_one_with_a_gap_is_not(rank):
    outside, inside = np.zeros((1, 4)), np.array([[2.8, 0.1, 0.0, 0.0]])
    closed, open_ = way_of(ring(rank), (3.0, 0.0)), way_of(ring(rank, gap=3), (3.0, 0.0))
    assert closed.reachable(outside) == rank
    assert closed.reachable(inside) == 0
    assert open_.reachable(outside) == 0


def test_at_a_strict_edge_the_way_from_there_counts():
    way = way_of([Disc("one", 1, (2.0, 0.0), 1.0)], (4.0, 0.0))
    for distance in (0.98, 1.01, 1.04, 1.2):  # inside by a hair, and within the clearance
        assert way.reachable(np.array([[2.0 - distance, 0.0, 0.0, 0.0]])) == 0


def test_inside_a_strict_region_the_row_leads_out_by_the_nearest_side():
    way = way_of([Disc("one", 1, (2.0, 0.0), 1.0)], (4.0, 0.0))
    for angle in (1.0, 2.0, 3.0, 4.0):
        out = np.array([np.cos(angle), np.sin(angle)])
        a, _ = row(way, np.concatenate([np.array([2.0, 0.0]) + 0.9 * out, [0.0, 0.0]]), 0.0)
        assert a @ out > 0.2


def test_the_row_requests_speed_along_the_way_and_nothing_at_the_goal():
    way = way_of(FAR, (4.0, 0.0))
    a, b = row(way, np.array([0.0, 0.0, 0.0, 0.0]), 0.0)
    np.testing.assert_allclose(a, [1.0, 0.0], atol=0.02)
    assert b == pytest.approx(way.pull.gain * way.pull.speed)
    fast = row(way, np.array([0.0, 0.0, 0.8, 0.0]), 0.0)
    assert fast[1] < 0.0  # u* may brake
    near = row(way, np.array([3.8, 0.0, 0.0, 0.0]), 0.0)
    assert 0.0 < near[1] < b
    a, b = row(way, np.array([4.0, 0.0, 0.3, 0.0]), 0.0)
    assert (a == 0.0).all()
    assert b < 0.0


@pytest.mark.parametrize("seed", range(5))
def test_no_safety_row_pays_for_the_guidance_row(seed):
    rng = np.random.default_rng(seed)
    count = 100
    scenes = [scenarios.make("random-moving", rng) for _ in range(count)]
    barriers = BarrierSet([scene.barriers for scene in scenes])
    x = rng.uniform([-0.5, -1.5, -1.0, -1.0], [10.0, 1.5, 1.0, 1.0], (count, 4))
    x[: count // 2] = rng.uniform(-0.05, 0.05, (count // 2, 4))  # where conflicts are
    way = guidance.Geodesic(count)
    way.reset(barriers, np.array([scene.goal for scene in scenes]))
    a, b = way.rows(x, np.zeros(count))
    rows = planar_rows(barriers, x, np.zeros(count), RowSettings())
    guided = CbfRows(
        np.concatenate([rows.a, a[:, None]], axis=1),
        np.concatenate([rows.b, b[:, None]], axis=1),
        np.concatenate([rows.h, np.ones((count, 1))], axis=1),
        np.concatenate([rows.priority, np.full((count, 1), 4)], axis=1),
    )
    program, u = programs.make_batch("lex-cbf-qp"), rng.uniform(-5.0, 5.0, (count, 2))
    without, with_row = program(u, rows), program(u, guided)
    assert (np.linalg.norm(without.u - with_row.u, axis=1) > 1e-3).sum() > 10
    assert (without.slack > 0.0).any(axis=1).sum() > 10
    for rank in (1, 2, 3):
        paid = [np.sum(np.where(rows.priority == rank, slack, 0.0) ** 2, axis=1)
                for slack in (without.slack, with_row.slack[:, :-1])]  # fmt: skip
        np.testing.assert_allclose(paid[1], paid[0], atol=1e-6)


def test_a_reset_of_one_scene_leaves_the_others_alone():
    scenes = [scenarios.make("random", np.random.default_rng(seed)) for seed in range(3)]
    barriers = BarrierSet([scene.barriers for scene in scenes])
    way, goals = guidance.Geodesic(3), np.array([scene.goal for scene in scenes])
    way.reset(barriers, goals)
    before, cells = way.field.copy(), way.field.shape[1]
    other = scenarios.make("random", np.random.default_rng(9))
    barriers.set_scene(1, other.barriers)
    goals[1] = other.goal
    way.reset(barriers, goals, mask=np.array([False, True, False]))
    np.testing.assert_array_equal(way.field[[0, 2], :cells], before[[0, 2]])
    alone = way_of(other.barriers, other.goal, None, 0.0)
    np.testing.assert_array_equal(alone.field[0], way.field[1, : alone.field.shape[1]])


def test_equal_scenes_are_solved_once_and_one_that_comes_back_not_again(monkeypatch):
    solved = []
    solve = _core.solve_field
    monkeypatch.setattr(_core, "solve_field", lambda *given: (solved.append(1), solve(*given)))
    scene, other = (scenarios.make("random", np.random.default_rng(n)) for n in (3, 4))
    walls = BarrierSet([scene.barriers, other.barriers, scene.barriers])
    goals = np.array([scene.goal, other.goal, scene.goal])
    way = guidance.Geodesic(3)
    way.reset(walls, goals)
    assert len(solved) == 2
    np.testing.assert_array_equal(way.field[0], way.field[2])
    assert (way.field[0] != way.field[1]).any()
    way.reset(walls, goals, mask=np.array([True, False, True]))
    assert len(solved) == 2
    before = way.field.copy()
    way.reset(walls, goals, clearance=0.2, mask=np.array([False, False, True]))
    assert len(solved) == 3
    np.testing.assert_array_equal(way.field[:2], before[:2])
    assert (way.field[2] != before[2]).any()


def test_the_field_of_a_moving_region_is_renewed_after_every_period():
    barriers = [Disc("mover", 2, (2.0, -0.6), 1.0, (0.0, 0.2))]
    way = way_of(barriers, (4.0, 0.0))
    x = np.zeros(4)
    first, _ = row(way, x, 0.0)
    field = way.field.copy()
    row(way, x, 0.48)
    np.testing.assert_array_equal(way.field, field)
    row(way, x, 0.5)
    assert not np.array_equal(way.field, field)
    last, _ = row(way, x, 6.0)
    assert first[1] > 0.0 > last[1]  # the region has passed to the other side of the line


def test_the_guidance_row_comes_last_unless_a_rank_may_be_crossed():
    priority = np.array([1, 3, 2, 2, 1])
    out = np.empty(6, dtype=np.int64)

    def ranks(way, through, zone=0):
        _core.guidance_insert(priority, way, zone, through, out)
        return out.tolist()

    last = [1, 3, 2, 2, 1, 4]
    assert ranks(2, 0) == ranks(0, 2) == ranks(1, 2) == ranks(2, 3) == last
    assert ranks(2, 2) == [1, 4, 3, 3, 1, 2]
    assert ranks(3, 2) == ranks(3, 3) == [1, 4, 2, 2, 1, 3]
    assert ranks(3, 0, zone=3) == [1, 4, 2, 2, 1, 3]  # out of a zone of a map
    assert ranks(2, 2, zone=3) == ranks(2, 0, zone=2) == [1, 4, 3, 3, 1, 2]


def test_a_shaped_input_meets_the_row_and_one_that_meets_it_stays():
    rng = np.random.default_rng(0)
    for _ in range(100):
        u, angle, b = rng.uniform(-5.0, 5.0, 2), rng.uniform(0.0, 6.3), rng.uniform(-2.0, 2.0)
        a = np.array([np.cos(angle), np.sin(angle)])
        shaped = np.array(_core.guidance_shape(*u, *a, b))
        assert a @ shaped >= b - 1e-12
        if a @ u >= b:
            np.testing.assert_array_equal(shaped, u)
        else:
            np.testing.assert_allclose(a @ shaped, b, atol=1e-12)


@pytest.mark.parametrize(
    ("wrong", "match"),
    [
        ({"goal": None}, "goal: got None"),
        ({"goal": (3.0, 0.1)}, "inside the strict region number 1"),
        ({"goal": (9.0, 0.0)}, "goal: got .* expected a point within the extent"),
        ({"goal": (np.nan, 0.0)}, "finite"),
        ({"start": (0.0, 4.0)}, "start: got .* expected a point within the extent"),
        ({"extent": ((0.0, 0.0), (-1.0, 1.0))}, "extent"),
        ({"extent": ((0.0, 0.0), (1e9, 1e-3))}, "extent"),
        ({"extent": ((-1e308, 0.0), (1e308, 1.0))}, "extent"),
        ({"clearance": -0.1}, "clearance"),
        ({"clearance": [[0.1, 0.1]]}, "clearance: got shape"),
        ({"clearance": [[-0.1]]}, "clearance: got -0.1, expected >= 0"),
        ({"clearance": np.array(object())}, "clearance"),
        ({"clearance": np.array("0.1")}, "clearance"),
    ],
)
def test_a_scene_without_a_way_is_refused_and_the_old_one_kept(wrong, match):
    way = guidance.Geodesic()
    right = {"barriers": [Disc("one", 1, (3.0, 0.0), 1.0)], "goal": (5.0, 0.0), "extent": OPEN}
    way.reset(**right)
    before = way.field.copy()
    with pytest.raises(InvalidInputError, match=match):
        way.reset(**(right | wrong))
    np.testing.assert_array_equal(way.field, before)
    np.testing.assert_array_equal(way.goal, [[5.0, 0.0]])


def test_before_a_reset_there_is_no_row():
    with pytest.raises(InvalidInputError, match="reset"):
        guidance.Geodesic().rows(np.zeros((1, 4)), np.zeros(1))
    for wrong in ({"count": 0}, {"cell": 0.0}):
        with pytest.raises(InvalidInputError, match="got"):
            guidance.Geodesic(**wrong)


def test_the_grid_ends_behind_strict_walls_and_grows_coarser_with_the_scene():
    walls = [HalfPlane("left", 1, (0.0, -1.0), -2.0), HalfPlane("right", 1, (0.0, 1.0), -2.0)]
    way = way_of(walls, (8.0, 0.0), None)
    _, y0, cell, *_ = way.geometry[0]
    assert cell == pytest.approx(0.1)
    assert y0 == pytest.approx(-1.5)  # PAD below start and goal comes before the wall
    large = way_of([*walls, Disc("far", 2, (300.0, 0.0), 1.0)], (8.0, 0.0), None)
    assert large.geometry[0, 2] > cell
    assert large.geometry[0, 3] * large.geometry[0, 4] < 11_000


def test_where_two_strict_edges_touch_there_is_no_way_between():
    walls = (
        HalfPlane("south", 1, (0.0, 1.0), 0.0),
        Disc("touching", 1, (2.0, 1.5), 1.5),
        HalfPlane("north", 1, (0.0, -1.0), -3.0),
    )
    way = way_of(walls, (5.0, 1.5), clearance=0.0)
    assert way.reachable(np.array([[-1.0, 1.5, 0.0, 0.0]])).tolist() == [1]
    apart = (walls[0], Disc("apart", 1, (2.0, 1.5), 1.3), walls[2])
    way = way_of(apart, (5.0, 1.5), clearance=0.0)
    assert way.reachable(np.array([[-1.0, 1.5, 0.0, 0.0]])).tolist() == [0]


def test_a_strip_has_no_more_cells_than_any_other_ground():
    way = guidance.Geodesic(cell=1e-4)
    way.reset([Disc("d", 1, (50.0, 0.0), 0.5)], (1.0, 0.0), ((-1e4, -0.01), (1e4, 0.01)))
    assert way.geometry[0, 3] * way.geometry[0, 4] <= 2.0 * _core.FIELD_MAX_CELLS


POCKET = [
    HalfPlane("left", 1, (0.0, -1.0), -2.37),
    HalfPlane("right", 1, (0.0, 1.0), -2.37),
    Disc("upper", 2, (-0.114, 0.646), 0.504),
    Disc("lower", 3, (0.06, -0.338), 0.725),
]
"""Two discs that overlap, and a robot in the corner between them."""


def pocket():
    way = guidance.Geodesic()
    way.reset(BarrierSet([POCKET]), (9.7, -0.35), start=(0.0, 0.0), clearance=0.054)
    return way


def led(way, x, out):
    _core.guidance_rows(way.field, way.geometry, way.goal, x[None], way.pull, out)
    return out[0, :2].copy()


def test_on_the_ridge_between_two_ways_a_robot_stays_on_the_side_that_it_was_led_to():
    way, ridges = pocket(), 0
    for x in np.linspace(-1.2, -0.5, 36):
        places = [np.array([x, y, 0.0, 0.0]) for y in np.arange(0.0, 0.5, 0.004)]
        rows = [led(way, place, np.zeros((1, 3))) for place in places]
        for k in range(1, len(rows)):
            if rows[k] @ rows[k - 1] >= 0.0:
                continue
            ridges += 1  # a hair decides
            for first in (k - 1, k):
                out = np.zeros((1, 3))
                begun = led(way, places[first], out)
                for step in range(6):
                    assert led(way, places[k - step % 2], out) @ begun > 0.0
    assert ridges > 10


def test_elsewhere_what_came_before_makes_no_difference():
    way, rng = pocket(), np.random.default_rng(4)
    places = np.column_stack([rng.uniform(-2.0, 9.0, 400), rng.uniform(-2.0, 2.0, 400)])
    turned = 0
    for place in places:
        x = np.concatenate([place, np.zeros(2)])
        fresh = led(way, x, np.zeros((1, 3)))
        angle = rng.uniform(-1.5, 1.5)  # a row before that points less than a quarter turn away
        cos, sin = np.cos(angle), np.sin(angle)
        last = np.array([[cos * fresh[0] - sin * fresh[1], sin * fresh[0] + cos * fresh[1], 0.0]])
        np.testing.assert_array_equal(led(way, x, last), fresh)
        turned += abs(angle) > 1.0
    assert turned > 50
