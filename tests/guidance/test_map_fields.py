"""Fields on maps: exact distances, paths through gaps and zones, changes, and what is refused."""

import numpy as np
import pytest

from hcbf_gym import _core, guidance
from hcbf_gym.barriers import BarrierSet, Disc
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.guidance import field as fields
from hcbf_gym.guidance.map_ground import MapGround
from hcbf_robots.maps import Grid, MapClass, RankedMap

SIDE = 0.1
BODY = 0.3


def blank():
    return np.zeros((40, 80), dtype=np.bool_)


def walled(gap):
    """A hall of 8 x 4 m, with a wall across at x = 4 m and a gap of so many cells in it."""
    cells = blank()
    cells[[0, -1]], cells[:, [0, -1]] = True, True
    cells[:, 40:42] = True
    cells[20 : 20 + gap, 40:42] = False
    return cells


def map_of(walls, zone=None, origin=(0.0, 0.0, 0.0), rank=2):
    classes = [MapClass("walls", 1, "keepout", walls)]
    if zone is not None:
        classes.append(MapClass("zone", rank, "keepout", zone))
    return RankedMap(Grid(SIDE, origin, walls.shape), tuple(classes))


def way_on(ranked_map, start, goal, clearance=BODY, barriers=(), **options):
    way = guidance.Geodesic(**options)
    to_world = lambda p: ranked_map.grid.to_world([np.array(p) / SIDE])[0]  # noqa: E731
    scene = (*barriers, ranked_map)
    way.reset(scene, to_world(goal), None, clearance, start=to_world(start))
    return way


def at(x, y):
    return np.array([[x, y, 0.0, 0.0]])


def test_distances_are_those_of_the_cells_centres_from_the_occupied_squares():
    rng = np.random.default_rng(0)
    for _ in range(20):
        shape = tuple(rng.integers(1, 25, 2))
        cells = rng.random(shape) < rng.choice([0.01, 0.1])
        found = _core.cell_distances(cells, 30)
        occupied = np.argwhere(cells)
        for j, i in np.ndindex(*shape):
            apart = np.maximum(np.abs(occupied - (j, i)) - 0.5, 0.0) * (occupied != (j, i))
            nearest = np.linalg.norm(apart, axis=1).min(initial=np.inf)
            np.testing.assert_allclose(found[j, i], nearest, rtol=1e-6)


@pytest.mark.parametrize("turn", [0.0, np.pi / 6, np.pi / 4])
def test_a_gap_as_wide_as_the_body_is_passed_however_the_map_is_turned(turn):
    ranked_map = map_of(walled(gap=7), origin=(3.0, -2.0, turn))
    way = way_on(ranked_map, (1.0, 1.0), (7.0, 1.0))
    view, place, goal = fields.grid(way.field[0], way.geometry[0]), way.geometry[0], way.goal[0]
    point = np.array(ranked_map.grid.to_world([[10.0, 10.0]])[0])
    assert way.reachable(at(*point)) == 0
    passed = []
    while np.linalg.norm(point - goal) > 1e-9:
        point = np.array(_core.field_descent(view, place, goal, *point, SIDE))
        passed.append(point)
        assert len(passed) < 300
    cells = ranked_map.grid.to_cells(passed)
    gap = cells[(cells[:, 0] > 40) & (cells[:, 0] < 42)]
    np.testing.assert_allclose(gap[:, 1], 23.5, atol=0.6)  # its middle
    narrow = map_of(walled(gap=5), origin=(3.0, -2.0, turn))
    with pytest.raises(InvalidInputError, match=r"'walls', rank 1, at .* does not fit"):
        way_on(narrow, (1.0, 1.0), (7.0, 1.0))


def test_a_goal_behind_a_zone_is_refused_with_the_reason_and_reached_through_it():
    zone = blank()
    zone[:, 38:44] = True
    ranked_map = map_of(walled(gap=12), zone)
    with pytest.raises(InvalidInputError, match=r"'zone', rank 2, at .*through.: 2}"):
        way_on(ranked_map, (1.0, 1.0), (7.0, 1.0))
    way = way_on(ranked_map, (1.0, 1.0), (7.0, 1.0), through=2)
    assert way.reachable(at(1.0, 1.0)) == 2
    assert way.reachable(at(6.0, 3.0)) == 0


def test_no_zone_lies_on_the_way_where_one_without_it_exists_however_long():
    zone = blank()
    zone[1:-1, 20] = True
    zone[-9:-1, 20] = False  # open at the top alone
    ranked_map = map_of(walled(gap=12), zone)
    way = way_on(ranked_map, (1.0, 1.0), (3.2, 1.0))
    assert way.reachable(at(1.0, 1.0)) == 0
    (a,), _ = way.rows(at(1.0, 1.0), np.array([0.0]))
    assert a[1] > 0.7
    crossing = way_on(map_of(walled(gap=12), zone, rank=4), (1.0, 1.0), (3.2, 1.0), through=4)
    assert crossing.reachable(at(1.0, 1.0)) == 4  # a metre of rank 4 costs 10, the way round more


def test_out_of_a_zone_the_way_does_not_lead_to_the_nearest_edge_behind_a_wall():
    zone = blank()
    zone[:, 42:60] = True
    way = way_on(map_of(walled(gap=12), zone), (4.9, 1.0), (7.5, 1.0))
    assert _core.guidance_rank_at(way.zone[0], way.geometry[0], 4.9, 1.0) == 2
    assert _core.guidance_rank_at(way.zone[0], way.geometry[0], 7.5, 1.0) == 0
    (a,), (b,) = way.rows(at(4.9, 1.0), np.array([0.0]))
    assert a[0] > 0.9
    assert b > 0.0


def test_a_goal_is_refused_where_the_body_has_no_room_or_the_map_ends():
    ranked_map = map_of(walled(gap=12))
    with pytest.raises(InvalidInputError, match="too close to 'walls', rank 1"):
        way_on(ranked_map, (1.0, 1.0), (7.7, 1.0))
    with pytest.raises(InvalidInputError, match=r"goal: got .* within the extent"):
        way_on(ranked_map, (1.0, 1.0), (9.0, 1.0))


def changed(walls, rng):
    """The walls with a square more, or a square less."""
    other = walls.copy()
    j, i = rng.integers(1, 34), rng.integers(1, 74)
    other[j : j + 5, i : i + 5] = rng.random() < 0.6
    return other


def test_the_field_of_a_changed_map_is_that_of_a_new_one():
    rng = np.random.default_rng(0)
    walls, zone = walled(gap=12), blank()
    zone[5:30, 50:60] = True
    way = way_on(map_of(walls, zone), (1.0, 1.0), (7.0, 3.2))
    for _ in range(30):
        walls = changed(walls, rng)
        way.follow(BarrierSet([[map_of(walls, zone)]]), np.zeros(1))
        new = MapGround(map_of(walls, zone).conditions, BODY, 0)
        field, through = np.empty_like(way.field[0]), np.empty_like(way.through[0])
        _core.solve_field(*new.ground, new.geometry, way.goal[0], 0, field, through)
        np.testing.assert_array_equal(way.field[0], field)
        np.testing.assert_array_equal(way.through[0], through)


def test_where_other_ranks_close_the_way_after_a_change_the_field_is_a_new_one():
    cells = walled(gap=0)
    way = way_on(map_of(cells, blank()), (1.0, 1.0), (2.0, 3.0))
    as_zone = map_of(blank(), cells)
    way.follow(BarrierSet([[as_zone]]), np.zeros(1))
    new = way_on(as_zone, (1.0, 1.0), (2.0, 3.0))
    np.testing.assert_array_equal(way.field, new.field)
    np.testing.assert_array_equal(way.through, new.through)


def test_a_disc_that_moves_beside_a_map_is_walked_around():
    disc = Disc("mover", 1, (2.0, 1.2), 0.3, (0.0, 0.8))
    way = way_on(map_of(walled(gap=12)), (1.0, 2.0), (3.2, 2.0), barriers=(disc,))
    first, _ = way.rows(at(1.0, 2.0), np.array([0.0]))
    later, _ = way.rows(at(1.0, 2.0), np.array([1.5]))
    assert first[0, 1] > 0.0 > later[0, 1]  # over it while it is below, under it when it has passed


def test_where_the_outside_is_unknown_the_way_keeps_from_the_edge_of_the_grid():
    def ground_of(unknown):
        ranked = RankedMap(
            Grid(SIDE, (1.0, 2.0, 0.7), unknown.shape), (MapClass("fog", 1, "unknown", unknown),)
        )
        return ranked, MapGround(ranked.conditions, BODY, 0)

    ranked, base = ground_of(blank())
    framed = np.ones((42, 82), dtype=np.bool_)
    framed[1:-1, 1:-1] = False  # the same as if the cells around it were of the class
    around = RankedMap(
        Grid(SIDE, (0.0, 0.0, 0.0), framed.shape), (MapClass("f", 1, "keepout", framed),)
    )
    wanted = MapGround(around.conditions, BODY, 0).ground
    for name in ("cost", "rank"):
        np.testing.assert_allclose(
            getattr(base.ground, name)[1:-1, 1:-1], getattr(wanted, name)[2:-2, 2:-2], rtol=1e-5
        )
    changed = blank()
    changed[1:5, 60:65] = True
    later, new = ground_of(changed)
    np.testing.assert_array_equal(base.with_regions(later.conditions).ground.cost, new.ground.cost)
    with pytest.raises(InvalidInputError, match="too close to 'fog'"):
        way_on(ranked, (4.0, 2.0), (7.9, 2.0))
