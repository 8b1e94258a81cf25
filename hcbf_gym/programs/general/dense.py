"""What a stage leaves of the inputs: those that keep what its rows have, or pay, at one of them."""

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.programs.tolerances import DEPENDENT, ZERO_GRADIENT


def pin(rows: Array, bounds: Array, basis: Array, a: Array, u: Array) -> tuple[Array, Array]:
    """Return the bounds and the basis that are left where ``a u`` keeps its value.

    u is a member: rounding must not take it out, so no bound stays above its value at u.

    Args:
        rows: (k, n) rows that the inputs meet.
        bounds: (k,) their bounds.
        basis: (n, r) orthonormal free directions.
        a: (s, n) rows to be pinned.
        u: (n,) a member.
    """
    unit, nothing = _core.unit_rows(a, np.zeros(len(a)), ZERO_GRADIENT)
    within, _ = _core.unit_rows(unit @ basis, nothing, DEPENDENT)
    if len(within):
        _, singular, orthogonal = np.linalg.svd(within)
        basis = basis @ orthogonal[(singular > DEPENDENT).sum() :].T
    return np.minimum(bounds, rows @ u), basis


def lock(rows: Array, bounds: Array, a: Array, b: Array, u: Array) -> tuple[Array, Array, Array]:
    """Return the rows and bounds with those of ``a u ≥ b`` that u meets, and those it violates.

    Args:
        rows: (k, n) rows that the inputs meet.
        bounds: (k,) their bounds.
        a: (s, n) rows of a stage, of any length.
        b: (s,) their bounds.
        u: (n,) a minimiser of the stage.
    """
    violated = np.empty(b.size, np.bool_)
    _core.violated(a, b, u, violated)
    met = ~violated
    level, bound = _core.level_rows(a[met], np.minimum(b, a @ u)[met], ZERO_GRADIENT)
    return np.concatenate((rows, level)), np.concatenate((bounds, bound)), a[violated]
