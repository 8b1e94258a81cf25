"""Convex quadratic programs in rational arithmetic, from their KKT conditions: no tolerance.

The conditions of ``min ½ xᵀHx + cᵀx s.t. A x ≥ b, x ≥ 0`` are a linear complementarity problem,
``w = M y + q``, ``w, y ≥ 0``, ``w·y = 0``, which Lemke's pivots solve. It shares no code with the
programs that it judges.
"""

import importlib
import math
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

try:  # ten times faster, the same numbers
    _gmpy2: Any = importlib.import_module("gmpy2")
    rational: Any = _gmpy2.mpq
    common_multiple: Any = _gmpy2.lcm
except ImportError:
    rational, common_multiple = Fraction, math.lcm

Array = NDArray[Any]


def exactly(x: Any) -> Array:
    """Return doubles as the rational numbers that they are, in an array of objects."""
    doubles = np.asarray(x, dtype=np.float64)
    exact = np.empty(doubles.size, dtype=object)
    exact[:] = [rational(value) for value in doubles.ravel().tolist()]
    return exact.reshape(doubles.shape)


def zeros(*shape: int) -> Array:
    """Return rational zeros."""
    return exactly(np.zeros(shape))


def quadratic_program(hessian: Array, linear: Array, a: Array, b: Array) -> Array:
    """Return a minimiser x (n,) of ``½ xᵀHx + cᵀx`` over ``A x ≥ b``, ``x ≥ 0``."""
    n, k = len(linear), len(b)
    matrix = np.vstack((np.hstack((hessian, -a.T)), np.hstack((a, zeros(k, k)))))
    return complementary(matrix, np.concatenate((linear, -b)))[:n]


def complementary(matrix: Array, q: Array) -> Array:
    """Return y (n,) with ``w = M y + q``, ``w, y ≥ 0``, ``w·y = 0``, by Lemke's method.

    Ties are broken lexicographically, so that no basis comes twice.
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
