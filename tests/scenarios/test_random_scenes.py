"""Random scenes: what they promise, and that the compiled form is the readable one."""

from collections import deque

import gymnasium as gym
import numpy as np
import pytest
from scipy.optimize import linprog

from hcbf_gym import scenarios
from hcbf_gym.barriers import BarrierSet, RowSettings
from hcbf_gym.barriers.planar_rows import planar_rows
from hcbf_gym.envs.regions_batch import RegionsBatch
from hcbf_gym.envs.task import barriers_of
from hcbf_gym.scenarios import Hooks, clutter, hall, random_scenes, rooms, traps
from hcbf_gym.scenarios import scene as columns

NAMES = [name for name in scenarios.families() if not name.startswith("map-")]
HALLS = ("random", "random-moving", "random-wide")
SEEDS = range(200)
CELL = 0.1


def scene(seed, name="random"):
    return scenarios.make(name, np.random.default_rng(seed))


def drawn(seed, name="random"):
    return scenarios.family_of(name).draw_scenes([np.random.default_rng(seed)]).one(0)


def regions(seed, name="random"):
    return drawn(seed, name).shapes[hall.WALLS :]


def ranks(name="random"):
    return drawn(0, name).ranks[hall.WALLS :]


def rows_at_start(scenario):
    barriers = BarrierSet([barriers_of(scenario, scenario.v_max)])
    x = np.array([[*scenario.start, 0.0, 0.0]])
    return planar_rows(barriers, x, np.zeros(1), RowSettings(), margin=0.03)


@pytest.mark.parametrize("name", NAMES)
def test_a_seed_decides_the_scene(name):
    assert scene(3, name).to_dict() == scene(3, name).to_dict()
    assert scene(3, name).to_dict() != scene(4, name).to_dict()
    assert len({len(scene(seed, name).barriers) for seed in SEEDS}) == 1


@pytest.mark.parametrize("name", NAMES)
def test_the_compiled_scene_is_the_readable_one(name):
    batch = RegionsBatch([scene(0, name)], Hooks())
    for seed in SEEDS:
        filled = drawn(seed, name)
        batch.set_drawn(0, filled)
        batch.restart(np.ones(1, dtype=np.bool_))
        readable = RegionsBatch([scenarios.family_of(name).scenario(filled)], Hooks())
        np.testing.assert_array_equal(batch.barrier_set.kind, readable.barrier_set.kind)
        np.testing.assert_allclose(
            batch.barrier_set.parameters, readable.barrier_set.parameters, atol=1e-14
        )
        np.testing.assert_allclose(batch.look()[0], readable.look()[0], atol=1e-13)
        np.testing.assert_array_equal(batch.goal, readable.goal)


@pytest.mark.parametrize("name", NAMES)
def test_standing_still_at_the_start_meets_every_strict_row_with_the_stated_clearance(name):
    for seed in SEEDS:
        scenario = scene(seed, name)
        rows = rows_at_start(scenario)
        strict = rows.priority[0] == 1
        assert strict.sum() > 1  # the speed limit, and a region
        assert (rows.b[0, strict] <= 0.0).all()
        clearance = random_scenes.START_CLEARANCE if name in HALLS else clutter.CLEAR_ENDS
        assert rows.h[0, : len(scenario.barriers)][strict[:-1]].min() >= (
            0.5 * clearance  # an ellipse's h is below its distance
        )


def test_the_stated_share_of_scenes_starts_in_a_conflict_that_no_input_resolves():
    conflicts = 0
    for seed in SEEDS:
        rows = rows_at_start(scene(seed))
        met = linprog(np.zeros(2), -rows.a[0], -rows.b[0], bounds=[(-5.0, 5.0)] * 2)
        conflicts += met.status == 2
        assert met.status in (0, 2)
        if met.status == 2:
            # it lies between priorities 2 and 3 alone: inside the lower, outside the higher
            assert set(rows.priority[0].tolist()) == {1, 2, 3}
            assert (rows.h[0][rows.priority[0] < 3] > 0.0).all()
            assert (rows.h[0][rows.priority[0] == 3] < 0.0).all()
    expected = random_scenes.CONFLICT_SHARE * len(SEEDS)
    assert abs(conflicts - expected) < 4.0 * np.sqrt(len(SEEDS) / 4.0)


def test_several_regions_of_several_priorities_stand_in_the_hall():
    counts = set()
    for seed in SEEDS:
        scenario = scene(seed)
        half_width = -scenario.barriers[0].offset
        inside = np.abs(regions(seed)[:, columns.Y]) < half_width
        counts.add(int(inside.sum()))
        assert {1, 2} <= set(ranks()[inside].tolist())
    assert counts == {2, 3, 4, 5}


@pytest.mark.parametrize(
    "name", ["random", "random-wide", "random-clutter", "random-traps", "random-map"]
)
@pytest.mark.parametrize("seed", range(15))
def test_a_way_to_the_goal_exists_that_keeps_clear_of_every_region(seed, name):
    scenario = scene(seed, name)
    passage = {
        "random": random_scenes.GAP,
        "random-wide": random_scenes.WIDE_GAP,
        "random-clutter": 2.0 * clutter.CLEAR,
        "random-map": 2.0 * rooms.CLEAR,
    }
    clearance = 0.5 * passage.get(name, traps.PASSAGE) - CELL
    x, y = np.meshgrid(np.arange(-2.0, 14.0, CELL), np.arange(-4.8, 4.8, CELL), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros((x.size, 2))])
    strict = [b for b in scenario.barriers if b.priority == 1]
    relaxed = [b for b in scenario.barriers if b.priority > 1]

    def least(barriers):
        h = BarrierSet([barriers] * len(points)).values(points, np.zeros(len(points)))
        return h.min(axis=1).reshape(x.shape)

    start, goal = (
        np.unravel_index(np.argmin(((points[:, :2] - end) ** 2).sum(axis=1)), x.shape)
        for end in (scenario.start, scenario.goal)
    )
    free = least(strict) > 0.5 * clearance  # an ellipse's h is below its distance
    assert reachable(free, start, goal)
    # regions of lower priority are left by the shortest way, then avoided as well
    outside = least(relaxed) > 0.5 * clearance
    if outside[start]:
        assert reachable(free & outside, start, goal)


def reachable(free, start, goal):
    seen, queue = {start}, deque([start])
    while queue:
        i, j = queue.popleft()
        if (i, j) == goal:
            return True
        for step in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
            inside = 0 <= step[0] < free.shape[0] and 0 <= step[1] < free.shape[1]
            if inside and free[step] and step not in seen:
                seen.add(step)
                queue.append(step)
    return False


def test_only_relaxed_regions_move_and_only_where_asked():
    speeds = {
        name: np.linalg.norm([drawn(seed, name).velocities for seed in SEEDS], axis=2)[:, 2:]
        for name in HALLS
    }
    assert not speeds["random"].any()
    moving = speeds["random-moving"]
    strict = ranks() == 1
    assert min(strict.sum(), (~strict).sum()) > 1
    assert not moving[:, strict].any()
    assert (moving.max(axis=0)[~strict] > 0.5 * random_scenes.MAX_DRIFT).all()
    assert moving.max() <= random_scenes.MAX_DRIFT


def test_clutter_holds_15_to_25_regions_of_three_ranks_that_overlap():
    counts, overlaps = set(), 0
    for seed in SEEDS:
        filled = drawn(seed, "random-clutter")
        inside = np.abs(filled.shapes[2:, columns.Y]) < 1.0 - filled.shapes[0, columns.RADIUS]
        counts.add(int(inside.sum()))
        assert {1, 2, 3} == set(filled.ranks[2:][inside].tolist())
        discs = filled.shapes[2:][inside]
        at, radius = discs[:, [columns.X, columns.Y]], discs[:, columns.RADIUS]
        apart = np.linalg.norm(at[:, None] - at[None], axis=2)
        reach = radius[:, None] + radius
        overlaps += int(((apart < 0.7 * reach).sum() - len(discs)) // 2)
    assert counts == set(range(15, 26))
    assert overlaps > 5 * len(SEEDS)


@pytest.mark.parametrize("kind", ["disc", "ellipse", "polygon", "box"])
def test_every_shape_occurs_in_a_family(kind):
    code = {"disc": columns.DISC, "ellipse": columns.ELLIPSE, "box": columns.BOX}.get(kind)
    names = ("random-clutter", "random-traps")
    shapes = {float(s) for name in names for s in regions(0, name)[:, columns.SHAPE]}
    assert code in shapes if code is not None else max(shapes) >= 3.0


def test_a_trap_lies_on_the_straight_line_and_is_open_towards_the_start():
    for seed in SEEDS:
        scenario = scene(seed, "random-traps")
        line = np.linspace(0.0, 1.0, 400)[:, None] * scenario.goal
        h = BarrierSet([scenario.barriers]).along(np.hstack([line, 0.0 * line]), np.zeros(400))
        for rank, walls in ((1, slice(2, 5)), (2, slice(5, 8))):
            crossed = (h[:, walls] < 0.0).any(axis=0)
            assert crossed.any(), (seed, rank)
        first = line[np.argmax((h < 0.0).any(axis=1))]
        assert first[0] > 1.0


def test_wide_scenes_leave_the_robot_s_body_room_and_keep_the_regions_shapes():
    env = gym.make("HCBF-A1Regions-v0", scenario="random-wide", body="footprint").unwrapped
    assert 2.0 * env.plant.uncertainty.body + 0.2 < random_scenes.WIDE_GAP
    for seed in SEEDS:
        near, wide = regions(seed), regions(seed, "random-wide")
        near_half, half = (-drawn(seed, n).shapes[0, columns.RADIUS] for n in HALLS[::2])
        np.testing.assert_allclose(half - near_half, random_scenes.WIDE_GAP - 0.8)
        shape = [columns.SHAPE, columns.ANGLE, columns.ASPECT]
        np.testing.assert_array_equal(wide[:, shape], near[:, shape])
        within = np.abs(wide[:, columns.Y]) < half
        clear = half - random_scenes.WIDE_GAP + 1e-12
        strict = within & (ranks() == 1)
        reach = np.abs(wide[:, columns.Y]) + wide[:, columns.RADIUS]
        assert strict.any()
        assert (reach[strict] <= clear).all()


def test_a_floor_has_doorways_open_and_shut_and_differs_in_every_episode():
    shut, starts = set(), set()
    for seed in SEEDS:
        layout = drawn(seed, "random-map")
        walls = regions(seed, "random-map")[2 : 2 + rooms.INNER_WALLS]
        lengths = 2.0 * walls[: 2 * rooms.COLUMNS, columns.RADIUS].reshape(rooms.COLUMNS, 2)
        apart = np.diff(walls[: 2 * rooms.COLUMNS, columns.X].reshape(rooms.COLUMNS, 2))[:, 0]
        gaps = apart - lengths.mean(axis=1)
        assert ((np.abs(gaps) < 1e-9) | (gaps > 2.0 * rooms.CLEAR - 1e-9)).all()
        shut.add(int((gaps < 1e-9).sum()))
        starts.add(tuple(layout.start))
        assert np.linalg.norm(layout.goal - layout.start) > rooms.CLEAR
    assert {0, 1, 2} <= shut
    assert len(starts) == len(SEEDS)
