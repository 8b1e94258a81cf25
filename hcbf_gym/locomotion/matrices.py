"""Small dense matrices for the compiled kernels.

Written out as loops: at these sizes a call to BLAS, or an array made from a list, costs more than
the arithmetic, and a result that no library decides is the same on every machine.
"""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel


@kernel()
def cross(a: Array, b: Array) -> Array:
    """Return (3,) a × b."""
    c = np.empty(3)
    c[0] = a[1] * b[2] - a[2] * b[1]
    c[1] = a[2] * b[0] - a[0] * b[2]
    c[2] = a[0] * b[1] - a[1] * b[0]
    return c


@kernel()
def add_cross(out: Array, a: Array, b: Array) -> None:
    """Add a × b to `out` (3,)."""
    out[0] += a[1] * b[2] - a[2] * b[1]
    out[1] += a[2] * b[0] - a[0] * b[2]
    out[2] += a[0] * b[1] - a[1] * b[0]


@kernel()
def apply(A: Array, x: Array) -> Array:
    """Return (m,) A x."""
    y = np.empty(A.shape[0])
    for i in range(A.shape[0]):
        total = 0.0
        for j in range(A.shape[1]):
            total += A[i, j] * x[j]
        y[i] = total
    return y


@kernel()
def apply_transposed(A: Array, x: Array) -> Array:
    """Return (n,) Aᵀ x."""
    y = np.empty(A.shape[1])
    for j in range(A.shape[1]):
        total = 0.0
        for i in range(A.shape[0]):
            total += A[i, j] * x[i]
        y[j] = total
    return y


@kernel()
def inverse_3x3(A: Array) -> Array:
    """Return the inverse of a (3, 3) matrix by cofactors.

    The determinant is held away from zero, so that a singular leg, stretched or with its foot on
    the abad axis, gets a finite answer.
    """
    c00 = A[1, 1] * A[2, 2] - A[1, 2] * A[2, 1]
    c01 = A[1, 2] * A[2, 0] - A[1, 0] * A[2, 2]
    c02 = A[1, 0] * A[2, 1] - A[1, 1] * A[2, 0]
    determinant = A[0, 0] * c00 + A[0, 1] * c01 + A[0, 2] * c02
    if abs(determinant) < 1e-5:
        determinant = 1e-5 if determinant >= 0.0 else -1e-5
    inverse = np.empty((3, 3))
    inverse[0, 0] = c00
    inverse[1, 0] = c01
    inverse[2, 0] = c02
    inverse[0, 1] = A[0, 2] * A[2, 1] - A[0, 1] * A[2, 2]
    inverse[1, 1] = A[0, 0] * A[2, 2] - A[0, 2] * A[2, 0]
    inverse[2, 1] = A[0, 1] * A[2, 0] - A[0, 0] * A[2, 1]
    inverse[0, 2] = A[0, 1] * A[1, 2] - A[0, 2] * A[1, 1]
    inverse[1, 2] = A[0, 2] * A[1, 0] - A[0, 0] * A[1, 2]
    inverse[2, 2] = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    for i in range(3):
        for j in range(3):
            inverse[i, j] /= determinant
    return inverse


@kernel()
def solve_in_place(A: Array, B: Array) -> None:
    """Turn B (n, m) into A⁻¹B by Gaussian elimination with row pivoting; A (n, n) is used up."""
    n = A.shape[0]
    for column in range(n):
        pivot = column
        for row in range(column + 1, n):
            if abs(A[row, column]) > abs(A[pivot, column]):
                pivot = row
        if pivot != column:
            for j in range(n):
                A[column, j], A[pivot, j] = A[pivot, j], A[column, j]
            for j in range(B.shape[1]):
                B[column, j], B[pivot, j] = B[pivot, j], B[column, j]
        scale = 1.0 / A[column, column]
        for j in range(column, n):
            A[column, j] *= scale
        for j in range(B.shape[1]):
            B[column, j] *= scale
        for row in range(n):
            factor = A[row, column]
            if row != column and factor != 0.0:
                for j in range(column, n):
                    A[row, j] -= factor * A[column, j]
                for j in range(B.shape[1]):
                    B[row, j] -= factor * B[column, j]
