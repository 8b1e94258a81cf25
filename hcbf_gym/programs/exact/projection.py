"""Projections on polyhedra of any dimension in rational arithmetic, by the dual method.

Goldfarb and Idnani's active-set method starts at the unconstrained minimum and adds the constraint
that is missed most, dropping those whose multipliers would change sign. Every step raises the dual
cost, so that without rounding it ends at the minimum.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.programs.exact.rational import rational, to_doubles, to_rational

Array = NDArray[Any]

# The price of a distance beside that of a violation: no double can tell the minimum from its limit.
_TINY = 2**-600


class Stage(NamedTuple):
    """``Σ w_k δ_k²`` with ``a_k z + δ_k ≥ t_k``, ``δ_k ≥ m_k``; equal where there is no m."""

    a: NDArray[np.float64]
    target: NDArray[np.float64]
    weight: NDArray[np.float64]
    least: NDArray[np.float64] | None


def least_cost(
    stage: Stage,
    centre: NDArray[np.float64],
    rows: NDArray[np.float64],
    lower: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the minimiser z (r,) of a stage's cost over ``rows z ≥ lower`` that is nearest c.

    Args:
        stage: the cost.
        centre: (r,) c.
        rows: (k, r) rows of a nonempty set.
        lower: (k,) their bounds.
    """
    free, count = centre.size, stage.target.size
    one = np.eye(count)
    constraints = [np.pad(rows, ((0, 0), (0, count))), np.hstack((stage.a, one))]
    bounds = [lower, stage.target]
    if stage.least is None:
        constraints.append(-constraints[1])
        bounds.append(-stage.target)
    else:
        constraints.append(np.hstack((np.zeros((count, free)), one)))
        bounds.append(stage.least)
    price = to_rational(np.concatenate((np.full(free, _TINY), stage.weight)))
    start = to_rational(np.concatenate((centre, np.zeros(count))))
    a, b = to_rational(np.vstack(constraints)), to_rational(np.concatenate(bounds))
    return to_doubles(project(start, 1 / price, a, b)[:free])


def project(centre: Array, ease: Array, a: Array, b: Array) -> Array:
    """Return ``argmin Σ (x_i − c_i)² / e_i`` over ``a x ≥ b``.

    Args:
        centre: (n,) c.
        ease: (n,) e > 0, by which a push along an axis moves x.
        a: (k, n) constraints; one that cannot be met beside those before it is left out, as
            rounding alone makes such.
        b: (k,) their bounds.
    """
    x, active, multiplier = centre, [], []
    while True:
        lack = b - a @ x
        p = int(np.argmax(lack)) if len(b) else 0
        if not len(b) or lack[p] <= 0:
            return x
        push = rational(0)
        while True:
            effort = _solve(a[active] * ease @ a[active].T, a[active] * ease @ a[p])
            way = ease * (a[p] - effort @ a[active]) if active else ease * a[p]
            gain = way @ a[p]
            limits = [
                (m / e, j) for j, (m, e) in enumerate(zip(multiplier, effort, strict=True)) if e > 0
            ]
            drop, leaving = min(limits, default=(None, -1))
            reach = (b[p] - a[p] @ x) / gain if gain > 0 else None
            if drop is None and reach is None:
                kept = np.arange(len(b)) != p
                return project(centre, ease, a[kept], b[kept])
            full = drop is None or (reach is not None and reach <= drop)
            step = reach if full else drop
            x = x + step * way
            multiplier = [m - step * e for m, e in zip(multiplier, effort, strict=True)]
            push += step
            if full:
                active, multiplier = [*active, p], [*multiplier, push]
                break
            active, multiplier = (
                [*items[:leaving], *items[leaving + 1 :]] for items in (active, multiplier)
            )


def _solve(matrix: Array, right: Array) -> Array:
    """Return x with ``matrix x = right``, the matrix positive definite."""
    m, x = matrix.copy(), right.copy()
    for i in range(len(x)):
        for j in range(i + 1, len(x)):
            if m[j, i] != 0:
                factor = m[j, i] / m[i, i]
                m[j, i:] = m[j, i:] - factor * m[i, i:]
                x[j] -= factor * x[i]
    for i in reversed(range(len(x))):
        x[i] = (x[i] - m[i, i + 1 :] @ x[i + 1 :]) / m[i, i]
    return x
