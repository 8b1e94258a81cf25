"""What judges prove and measure, against slower texts of the same definitions."""

import numpy as np
import pytest

from benchmarks.judges import exact, squares
from benchmarks.judges.exact import exactly
from hcbf_gym.barriers import BarrierSet, Capsule, ConvexPolygon, Disc, Ellipse
from hcbf_robots.maps import Grid
from tests.maps.floors import ORIGINS, cells, room, true_distance


def problems(seed, count):
    """Yield M and q of random programs, flat and degenerate ones among them."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        n, k = int(rng.integers(1, 4)), int(rng.integers(1, 8))
        root = rng.normal(0.0, 1.0, (n, n)) * rng.choice([0.0, 1.0], n)
        a, point = rng.normal(0.0, 1.0, (k, n)), exactly(rng.uniform(0.0, 3.0, n))
        a[rng.random(k) < 0.3] = a[0]  # several rows in one line
        a = exactly(a)
        b = a @ point - exactly(rng.uniform(0.0, 1.0, k) * (rng.random(k) < 0.5))
        hessian = exactly(root).T @ exactly(root)
        linear = -hessian @ exactly(rng.normal(0.0, 9.0, n))  # bounded below
        matrix = np.vstack((np.hstack((hessian, -a.T)), np.hstack((a, exact.zeros(k, k)))))
        yield matrix, np.concatenate((linear, -b)), n


def cost(matrix, q, y, n):
    return y[:n] @ matrix[:n, :n] @ y[:n] / 2 + q[:n] @ y[:n]


def solves(matrix, q, y):
    w = matrix @ y + q
    return (y >= 0).all() and (w >= 0).all() and w @ y == 0


def test_what_a_guess_proves_costs_what_rational_pivots_find():
    proven = 0
    for matrix, q, n in problems(0, 60):
        pivoted = exact.complementary(matrix, q)
        guess = exact.guess(matrix.astype(float), q.astype(float))
        y = exact.proven(matrix, q, guess)
        assert solves(matrix, q, pivoted)
        if y is not None:
            proven += 1
            assert solves(matrix, q, y)
            assert cost(matrix, q, y, n) == cost(matrix, q, pivoted, n)
    assert proven > 40


def test_no_wrong_guess_is_proven():
    rng, proven = np.random.default_rng(1), 0
    for matrix, q, _ in problems(2, 300):
        y = exact.proven(matrix, q, rng.random(len(q)) < 0.4)
        proven += y is not None
        assert y is None or solves(matrix, q, y)
    assert proven > 20


@pytest.mark.parametrize("size", [1, 2, 5])
def test_equations_are_solved_exactly(size):
    rng = np.random.default_rng(size)
    a, x = rng.normal(0.0, 1.0, (size, size)), exactly(rng.normal(0.0, 1.0, size))
    a[0] *= 1e-9
    equations = np.hstack((exactly(a), (exactly(a) @ x)[:, None]))
    assert (exact.solve(equations) == x).all()
    assert exact.solve(np.vstack((equations[1:], equations[-1:]))) is None or size == 1


REGIONS = {
    "disc": (Disc, ((0.5, -0.3), 0.8)),
    "ellipse": (Ellipse, ((0.4, 0.2), (0.3, 1.2), 0.7)),
    "polygon": (ConvexPolygon, (((-1.0, -0.5), (0.5, -1.0), (1.5, 0.0), (0.5, 1.0), (-0.5, 0.8)),)),
    "capsule": (Capsule, ((-1.0, -0.5), (1.0, 0.8), 0.3)),
}
"""Regions with an inside, and their numbers."""


@pytest.mark.parametrize("origin", ORIGINS)
@pytest.mark.parametrize("reach", [0.23, 1.0])
def test_squares_are_as_far_as_the_nearest_of_all_cells(origin, reach):
    floor, mask = room(3, origin), cells(3)
    at = np.random.default_rng(0).uniform(-30.0, 110.0, (2000, 2))
    at[::5] = np.round(at[::5])  # on the cells' corners
    points = floor.grid.to_world(at)
    found = squares.distances(floor.grid, mask, points, reach)
    wanted = np.minimum(true_distance(floor, mask, points), reach)
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-12)


def test_without_a_true_cell_every_distance_is_the_reach():
    grid = Grid(0.05, ORIGINS[0], (4, 5))
    found = squares.distances(grid, np.zeros((4, 5), dtype=np.bool_), np.zeros((3, 2)), 0.7)
    np.testing.assert_allclose(found, 0.7)


def is_inside(kind, c, x, y):
    """Return (N,) whether points are in a region, by its inequalities instead of a distance."""
    if kind == "disc":
        return np.hypot(x - c[0], y - c[1]) <= c[2]
    if kind == "ellipse":
        turned = (x - c[0] + 1j * (y - c[1])) * np.exp(-1j * c[4])
        return (turned.real / c[2]) ** 2 + (turned.imag / c[3]) ** 2 <= 1.0
    if kind == "capsule":
        along = c[2] - c[0] + 1j * (c[3] - c[1])
        z, length = (x - c[0] + 1j * (y - c[1])) * abs(along) / along, abs(along)
        beside = (z.real >= 0.0) & (z.real <= length) & (abs(z.imag) <= c[4])
        return beside | (abs(z) <= c[4]) | (abs(z - length) <= c[4])
    corners = np.reshape(c, (-1, 2))
    pairs = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    left_of = [(bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0.0 for (ax, ay), (bx, by) in pairs]
    return np.all(left_of, axis=0)


@pytest.mark.parametrize("kind", REGIONS)
def test_a_region_is_as_far_as_the_nearest_point_beyond_its_border(kind):
    shape, arguments = REGIONS[kind]
    numbers = np.concatenate([np.ravel(one) for one in arguments])
    axis = np.linspace(-3.0, 3.0, 601)
    x, y = (values.ravel() for values in np.meshgrid(axis, axis))
    inside = is_inside(kind, numbers, x, y)
    px, py = np.random.default_rng(0).uniform(-2.0, 2.0, (2, 60))
    states = np.column_stack([px, py, 0.0 * px, 0.0 * py])
    found = BarrierSet([[shape("it", 1, *arguments)]]).along(states, np.zeros(60))[:, 0]
    assert ((found <= 0.0) == is_inside(kind, numbers, px, py)).all()
    for k in range(len(px)):
        beyond = inside != (found[k] <= 0.0)
        wanted = np.hypot(x[beyond] - px[k], y[beyond] - py[k]).min()
        assert -1e-4 <= wanted - abs(found[k]) < 2.0 * (axis[1] - axis[0])
