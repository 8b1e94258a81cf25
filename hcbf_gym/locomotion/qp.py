"""The controller's door to a solver: every status is read, none is guessed."""

from typing import NamedTuple

import daqp
import numpy as np

from hcbf_gym.locomotion.condensed import QuadraticProgram
from hcbf_gym.locomotion.state import Array

_OPTIMAL = 1


class QpSolution(NamedTuple):
    """What the solver said.

    Attributes:
        x: (n,) the minimiser, or None if there is none.
        exitflag: DAQP's; 1 means optimal.
        multipliers: (n + m,) of the bounds, positive at upper ones.
    """

    x: Array | None
    exitflag: int
    multipliers: Array


def solve(program: QuadraticProgram) -> QpSolution:
    """Solve a strictly convex program with DAQP."""
    H, f, A, lower, upper = program
    x, _, exitflag, info = daqp.solve(H, f, A, upper, lower)
    return QpSolution(x if exitflag == _OPTIMAL else None, exitflag, info["lam"])


def residual(program: QuadraticProgram, solution: QpSolution) -> float:
    """Return the largest violation of the KKT conditions, in the units of the rows.

    Stationarity is measured relative to the largest entry of f.

    Args:
        program: as it was solved.
        solution: as it was returned.
    """
    if solution.x is None:
        return np.inf
    H, f, A, lower, upper = program
    rows = np.concatenate([solution.x, A @ solution.x])
    n = len(f)
    gradient = H @ solution.x + f + solution.multipliers[:n] + A.T @ solution.multipliers[n:]
    outside = max(0.0, float((lower - rows).max()), float((rows - upper).max()))
    return max(outside, float(np.abs(gradient).max() / max(1.0, np.abs(f).max())))
