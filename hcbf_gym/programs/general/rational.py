"""Projections on polyhedra of any dimension in rational arithmetic, by the dual method.

Goldfarb and Idnani's active-set method starts at the unconstrained minimum and adds the constraint
that is missed most, dropping those whose multipliers would change sign. Every step raises the dual
cost, so that without rounding it ends at the minimum.
"""

import importlib
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Rationals

try:  # ten times faster, the same numbers
    rational: Any = importlib.import_module("gmpy2").mpq
except ImportError:
    rational = Fraction

# The price of a distance beside that of a violation: no double can tell the minimum from its limit.
_TINY = 2**-600


def to_rational(x: Array) -> Rationals:
    """Return doubles as the rational numbers that they are, in an array of objects."""
    exact = np.empty(x.size, dtype=object)
    exact[:] = [rational(value) for value in x.ravel().tolist()]
    return exact.reshape(x.shape)


def to_doubles(x: Rationals) -> Array:
    """Return rational numbers (k,) correctly rounded."""
    return np.array([int(value.numerator) / int(value.denominator) for value in x], dtype=float)


class SoftRows(NamedTuple):
    """Rows that a stage pays for instead of meeting: ``Σ w_k δ_k²`` with ``a_k u + δ_k ≥ t_k``.

    Attributes:
        a: (s, n_u) gradients.
        target: (s,) t_k.
        weight: (s,) w_k above 0.
        least: (s,) the least δ_k, or None for the equality ``a_k u + δ_k = t_k``.
    """

    a: Array
    target: Array
    weight: Array
    least: Array | None


class Affine(NamedTuple):
    """``u = point + basis z``."""

    point: Array
    basis: Array

    def rows(self, a: Array, b: Array) -> tuple[Rationals, Rationals]:
        """Return the rows ``a u ≥ b`` as they act on z, unrounded: parallel ones stay parallel."""
        exact = to_rational(a)
        return exact @ to_rational(self.basis), to_rational(b) - exact @ to_rational(self.point)


def least_cost(
    soft: SoftRows,
    centre: Array,
    a: Array,
    b: Array,
    inputs: Affine,
) -> Array:
    """Return the minimiser u (n,) of a stage's cost over ``a u ≥ b`` that is nearest ``u(c)``.

    Args:
        soft: the cost.
        centre: (r,) c.
        a: (k, n) rows of a nonempty set.
        b: (k,) their bounds.
        inputs: u(z), z of r elements.
    """
    free = centre.size
    count = soft.target.size
    one = to_rational(np.eye(count))
    rows, lower = inputs.rows(a, b)
    gradient, target = inputs.rows(soft.a, soft.target)
    above = np.hstack((gradient, one))
    if soft.least is None:
        below, least = -above, -target
    else:
        below = np.hstack((0 * gradient, one))
        least = to_rational(soft.least)
    constraints = np.vstack((np.hstack((rows, np.zeros((len(b), count), dtype=int))), above, below))
    price = to_rational(np.concatenate((np.full(free, _TINY), soft.weight)))
    start = to_rational(np.concatenate((centre, np.zeros(count))))
    z = project(start, 1 / price, constraints, np.concatenate((lower, target, least)))[:free]
    return inputs.point + inputs.basis @ to_doubles(z)


def project(centre: Rationals, ease: Rationals, a: Rationals, b: Rationals) -> Rationals:
    """Return ``argmin Σ (x_i − c_i)² / e_i`` over ``a x ≥ b``.

    Args:
        centre: (n,) c.
        ease: (n,) e > 0, by which a push along an axis moves x.
        a: (k, n) constraints; one that cannot be met beside those before it is left out, as
            rounding alone makes such.
        b: (k,) their bounds.
    """
    x = centre
    active = []
    multiplier = []
    while True:
        lack = b - a @ x
        p = int(np.argmax(lack)) if len(b) else 0
        if not len(b) or lack[p] <= 0:
            return x
        push = rational(0)
        while True:
            effort = _solve(a[active] * ease @ a[active].T, a[active] * ease @ a[p])
            direction = ease * (a[p] - effort @ a[active]) if active else ease * a[p]
            gain = direction @ a[p]
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
            x = x + step * direction
            multiplier = [m - step * e for m, e in zip(multiplier, effort, strict=True)]
            push += step
            if full:
                active, multiplier = [*active, p], [*multiplier, push]
                break
            active, multiplier = (
                [*items[:leaving], *items[leaving + 1 :]] for items in (active, multiplier)
            )


def _solve(matrix: Rationals, right: Rationals) -> Rationals:
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
