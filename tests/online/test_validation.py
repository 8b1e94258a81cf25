"""Validation of scenes and robots: walls elsewhere, robots that cannot stop in time."""

import warnings

import numpy as np
import pytest

from hcbf_gym.barriers import BarrierSet, ConvexPolygon, HalfPlane, Shapes
from hcbf_gym.errors import CoverageWarning, InvalidInputError, SafetyWarning
from hcbf_gym.models.grid import Grid
from hcbf_gym.programs import FilterStatus
from hcbf_robots import Command, Response, Robot, VelocityFilter
from hcbf_robots.maps.regrid import INSET, onto
from hcbf_robots.walkers import footprint

CART = Robot(Command(1.0, 2.0, look_ahead=0.2), reach=0.2)


def barely_convex():
    """Return a polygon that is strictly convex by rounding alone, and where that fails."""
    rng, away = np.random.default_rng(0), np.array([2000.0, 3000.0])
    for _ in range(1000):
        a, b = rng.uniform(0.0, 4.0, (2, 2))
        along = b - a
        beside = 0.5 * (a + b) + np.array([-along[1], along[0]])
        corners = a, a + along * rng.uniform(0.3, 0.7), b, beside
        try:
            drawn = ConvexPolygon("drawn", 1, tuple(map(tuple, corners)))
        except InvalidInputError:
            continue
        try:
            drawn.moved(-away)
        except InvalidInputError:
            return drawn, away
    raise AssertionError


@pytest.mark.filterwarnings("ignore:safety filter:hcbf_gym.errors.SafetyWarning")
def test_a_barrier_that_cannot_be_moved_stops_a_robot_that_starts_far_away():
    drawn, away = barely_convex()
    wall = HalfPlane("wall", 1, (-1.0, 0.0), -away[0] - 3.0)
    safe = VelocityFilter(CART, [wall, drawn])
    with pytest.warns(SafetyWarning, match="far from the origin: drawn: "):
        given, report = safe.step((1.0, 0.0), (*away, 0.0), np.zeros(3), 0.0)
    assert report["status"] == FilterStatus.BACKUP
    assert not given.any()


@pytest.mark.parametrize("normal", [(0.866025, 0.5), (0.7071065, 0.7071065), (-0.258819, 0.965926)])
@pytest.mark.parametrize("at", [(0.0, 0.0), (5e5, 5.9e6), (-4e6, 3e6)])
def test_a_wall_lies_where_its_numbers_say_however_few_digits_its_normal_has(normal, at):
    offset = float(np.dot(normal, at))
    wall = HalfPlane("wall", 1, normal, offset)
    x, step = np.array([*at, 0.0, 0.0]), np.array([3.0, -4.0, 0.0, 0.0])
    assert abs(wall.h(x)) < 1e-8
    many = Shapes("walls", 1, "half-plane", [[*normal, offset]])
    assert abs(BarrierSet([[many]]).values(x[None], np.zeros(1))).max() < 1e-8
    assert abs(wall.moved(step[:2]).h(x + step)) < 1e-8


@pytest.mark.parametrize("seed", range(24))
def test_each_cell_counts_that_a_turned_mask_reaches_into(seed):
    rng = np.random.default_rng(seed)
    grid = Grid(
        rng.choice([0.05, 0.1, 0.5]), (*rng.uniform(-1, 1, 2), rng.uniform(-4, 4)), (40, 50)
    )
    of = Grid(
        grid.resolution * rng.uniform(0.3, 3.0),
        (*grid.to_world(np.array([25.0, 20.0])), rng.uniform(-4.0, 4.0)),
        (9, 7),
    )
    cells = rng.random(of.shape) < 0.3
    found, _ = onto(grid, cells, of)
    within = np.linspace(1.01 * INSET, 1.0 - 1.01 * INSET, 41)
    inner = np.stack(np.meshgrid(within, within), axis=-1).reshape(-1, 2)
    places = (np.argwhere(cells)[:, None, ::-1] + inner).reshape(-1, 2)
    column, row = np.floor(grid.to_cells(of.to_world(places))).astype(int).T
    inside = (column >= 0) & (column < 50) & (row >= 0) & (row < 40)
    assert found[row[inside], column[inside]].all()
    needed = np.zeros_like(found)
    needed[row[inside], column[inside]] = True
    grown = np.pad(needed, 1)
    beside = sum(
        grown[1 + j : 41 + j, 1 + i : 51 + i].astype(int) for j in (-1, 0, 1) for i in (-1, 0, 1)
    )
    assert (beside[found] > 0).all()  # and none far from it


NARROW = np.radians(16.0)
WEDGE = [
    HalfPlane(f"side {s}", 1, (-np.sin(NARROW), s * np.cos(NARROW)), -1.0) for s in (1.0, -1.0)
]


def test_a_robot_that_cannot_stop_where_walls_close_in_is_warned_of():
    typed = Response(time_constant=0.1, delay=0.05, braking=1.5)
    robot = Robot(Command(2.0, 1.5, sideways=2.0), typed, reach=0.3)
    with pytest.warns(CoverageWarning, match=r"where strict regions close in, .* stop the robot"):
        VelocityFilter(robot, WEDGE)
    with warnings.catch_warnings():
        warnings.simplefilter("error", CoverageWarning)
        VelocityFilter(robot, WEDGE[:1])
        slow = Robot(Command(0.4, 1.5, sideways=0.4), typed, reach=0.3)
        VelocityFilter(slow, WEDGE)


@pytest.mark.parametrize(("command", "latest"), [
    (Command(0.3, 1.0, sideways=0.3), 0.4), (Command(0.5, 1.0, look_ahead=0.2), 0.5),
])  # fmt: skip
def test_a_robot_that_follows_later_than_any_that_stayed_outside_is_named(command, latest):
    wall = WEDGE[:1]
    with pytest.warns(CoverageWarning, match=f"rank 1 is not promised from {latest:g} s on"):
        VelocityFilter(
            Robot(command, Response(time_constant=latest - 0.2, delay=0.2), reach=0.2), wall
        )
    with warnings.catch_warnings():
        warnings.simplefilter("error", CoverageWarning)
        VelocityFilter(
            Robot(command, Response(time_constant=latest - 0.3, delay=0.2), reach=0.2), wall
        )
        VelocityFilter(Robot(command, reach=0.2), wall)


@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-9, 1e-6, 5e-4])
def test_an_outline_may_be_closed_by_its_first_corner_however_it_is_rounded(off):
    corners = [[-0.2, -0.15], [0.1, -0.15], [0.1, 0.15], [-0.2, 0.15]]
    closed = [*corners, [corners[0][0] + off, corners[0][1] - off]]
    assert footprint.reach(closed) == pytest.approx(footprint.reach(corners), abs=1e-3)
