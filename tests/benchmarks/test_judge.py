"""The judge of the programs: what it proves is a minimiser, in rational numbers."""

import numpy as np
import pytest

from benchmarks.judges import exact
from benchmarks.judges.exact import exactly


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
