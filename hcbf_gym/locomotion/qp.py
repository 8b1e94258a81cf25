"""The controller's solver of quadratic programs, DAQP; without a solution it returns None."""

from functools import cache
from typing import NamedTuple

import daqp
import numpy as np
from numpy.typing import NDArray

from hcbf_gym.arrays import Array

OPTIMAL = 1  # an exit flag of DAQP
_EQUALITY = 5  # a constraint whose bounds are equal, in DAQP's `sense`


class QuadraticProgram(NamedTuple):
    """``min ½ xᵀHx + fᵀx`` subject to ``lower ≤ [x; A x] ≤ upper``."""

    H: Array  # (n, n) positive semidefinite
    f: Array  # (n,)
    A: Array  # (m, n) general rows
    lower: Array  # (n + m,) bounds, those of the unknowns first
    upper: Array  # (n + m,)
    equalities: int  # how many of the general rows, the first ones, have equal bounds


class Solution(NamedTuple):
    """The result of the solver."""

    x: Array | None  # (n,) the minimiser, or None if none was found
    exitflag: int  # DAQP's; 1 means optimal, −1 infeasible
    multipliers: Array  # (n + m,) of the bounds, positive at upper ones


def solve(program: QuadraticProgram) -> Solution:
    """Solve a convex program with DAQP; where a Hessian is singular, it takes proximal steps."""
    H, f, A, lower, upper, equalities = program
    x, _, exitflag, info = daqp.solve(
        H, f, A, upper, lower, _senses(len(f), len(lower), equalities)
    )
    return Solution(x if exitflag == OPTIMAL else None, exitflag, info["lam"])


@cache
def _senses(unknowns: int, bounds: int, equalities: int) -> NDArray[np.int32]:
    """Return DAQP's kinds of constraints (bounds,); the first general rows are equalities."""
    senses = np.zeros(bounds, dtype=np.int32)
    senses[unknowns : unknowns + equalities] = _EQUALITY
    return senses


def residual(program: QuadraticProgram, solution: Solution) -> float:
    """Return the largest violation of the KKT conditions; infinite without a solution.

    Constraints count in their own units, stationarity relative to the largest entry of f.
    """
    if solution.x is None:
        return np.inf
    H, f, A, lower, upper, _ = program
    n = len(f)
    rows = np.concatenate([solution.x, A @ solution.x])
    gradient = H @ solution.x + f + solution.multipliers[:n] + A.T @ solution.multipliers[n:]
    outside = max(0.0, float((lower - rows).max()), float((rows - upper).max()))
    return max(outside, float(np.abs(gradient).max() / max(1.0, np.abs(f).max())))
