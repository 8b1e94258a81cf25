"""Convex quadratic programs in rational arithmetic, from their KKT conditions: no tolerance.

The conditions of ``min ½ xᵀHx + cᵀx s.t. A x ≥ b, x ≥ 0`` are a linear complementarity problem,
``w = M y + q``, ``w, y ≥ 0``, ``w·y = 0``. Lemke's pivots in doubles guess which y are basic; the
rational solution of that basis is checked against every inequality, so that no wrong guess passes.
Where it breaks one, the pivots run in rational numbers. No code of the judged programs is used.
"""

import importlib
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.arrays import Mask

try:  # ten times faster, the same numbers
    rational: Any = importlib.import_module("gmpy2").mpq
except ImportError:
    rational = Fraction

Array = NDArray[Any]
PIVOTS = 300  # in doubles, before the guess is taken as it is


def exactly(x: Any) -> Array:
    """Return doubles as the rational numbers that they are, in an array of objects."""
    doubles = np.asarray(x, dtype=np.float64)
    exact = np.empty(doubles.size, dtype=object)
    exact[:] = [rational(value) for value in doubles.ravel().tolist()]
    return exact.reshape(doubles.shape)


def zeros(*shape: int) -> Array:
    """Return rational zeros."""
    return exactly(np.zeros(shape))


def quadratic_program(hessian: Array, linear: Array, a: Array, b: Array, loose: Any = 0.0) -> Array:
    """Return a minimiser x (n,) of ``½ xᵀHx + cᵀx`` over ``A x ≥ b``, ``x ≥ 0``.

    Args:
        hessian: (n, n) H, positive semidefinite, rational as all others.
        linear: (n,) c.
        a: (k, n) A.
        b: (k,) b.
        loose: (k,) by which the guess relaxes b.
    """
    n, k = len(linear), len(b)
    matrix = np.vstack((np.hstack((hessian, -a.T)), np.hstack((a, zeros(k, k)))))
    q = np.concatenate((linear, -b))
    doubles = q.astype(np.float64)
    doubles[n:] += loose
    y = proven(matrix, q, guess(matrix.astype(np.float64), doubles))
    return (complementary(matrix, q) if y is None else y)[:n]


def proven(matrix: Array, q: Array, basic: Mask) -> Array | None:
    """Return the y (n,) whose basic entries a guess (n,) names; None if they solve nothing."""
    y, k = zeros(len(q)), np.flatnonzero(basic)
    found = solve(np.hstack((matrix[np.ix_(k, k)], -q[k, None])))
    if found is None:
        return None
    y[k] = found
    w = (matrix[~basic][:, k] @ found if k.size else 0) + q[~basic]
    return None if (found < 0).any() or (w < 0).any() else y


def solve(equations: Array) -> Array | None:
    """Return the solution of equations (n, n + 1), the right-hand sides last; None if dependent."""
    table = equations.copy()
    for column in range(len(table)):
        possible = np.flatnonzero(table[column:, column] != 0)
        if not possible.size:
            return None
        row = column + int(possible[0])
        table[[column, row]] = table[[row, column]]
        _pivot(table, column, column)
    return table[:, -1]


def guess(matrix: Array, q: Array) -> Mask:
    """Return which y (n,) are basic in the solution, by Lemke's pivots in doubles."""
    n = q.size
    row, artificial = int(q.argmin()), 2 * n
    basis, entering = np.arange(n), artificial
    if q[row] >= 0.0:
        return np.zeros(n, dtype=np.bool_)
    table = np.hstack((np.eye(n), -matrix, np.full((n, 1), -1.0), q[:, None]))
    for _ in range(PIVOTS):
        leaving, basis[row] = int(basis[row]), entering
        table[row] /= table[row, entering]
        factor = table[:, entering].copy()
        factor[row] = 0.0
        table -= factor[:, None] * table[row]
        if leaving == artificial:
            break
        entering = leaving + n if leaving < n else leaving - n
        possible = np.flatnonzero(table[:, entering] > 1e-11)
        if not possible.size:
            break
        ratio = np.maximum(table[possible, -1], 0.0) / table[possible, entering]
        least = ratio.min()
        tied = possible[ratio <= least + 1e-11 * (1.0 + least)]
        row = int(tied[(basis[tied] == artificial).argmax()])  # of the artificial one, if it ties
    return np.isin(np.arange(n, 2 * n), basis)


def complementary(matrix: Array, q: Array) -> Array:
    """Return y (n,) with ``w = M y + q``, ``w, y ≥ 0``, ``w·y = 0``, by Lemke's method.

    Ties are broken lexicographically, so that no basis comes twice.

    Raises:
        ArithmeticError: if the pivots end in a ray.
    """
    n = len(q)
    if all(value >= 0 for value in q):
        return zeros(n)
    one = exactly(np.eye(n))
    # columns: w, y, the artificial variable, the right-hand side
    table = np.hstack((one, -matrix, -exactly(np.ones((n, 1))), q[:, None]))
    basis = list(range(n))
    row = min(range(n), key=lambda i: (q[i], -i))
    entering = 2 * n
    while True:
        leaving, basis[row] = basis[row], entering
        _pivot(table, row, entering)
        if leaving == 2 * n:
            break
        entering = leaving + n if leaving < n else leaving - n
        column = table[:, entering]
        choices = [i for i in range(n) if column[i] > 0]
        if not choices:
            raise ArithmeticError("no solution: the problem has none")
        row = _first(table, choices, entering, n)
    y = zeros(n)
    for i, variable in enumerate(basis):
        if n <= variable < 2 * n:
            y[variable - n] = table[i, -1]
    return y


def _first(table: Array, choices: list[int], entering: int, n: int) -> int:
    """Return the row that limits the entering variable first, lexicographically."""
    columns = iter([2 * n + 1, *range(n)])
    while len(choices) > 1:
        column = next(columns)
        ratios = [table[i, column] / table[i, entering] for i in choices]
        least = min(ratios)
        choices = [i for i, ratio in zip(choices, ratios, strict=True) if ratio == least]
    return choices[0]


def _pivot(table: Array, row: int, column: int) -> None:
    table[row] = table[row] / table[row, column]
    pivot = table[row]
    filled = np.flatnonzero(pivot != 0)
    for i in range(len(table)):
        if i != row and table[i, column] != 0:
            table[i, filled] = table[i, filled] - table[i, column] * pivot[filled]
