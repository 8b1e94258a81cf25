"""The programs' definitions once more, stage by stage in rational arithmetic, to judge them by.

What a stage decides is a violation δ* of each of its rows. ``{u : a_k u ≥ b_k − δ_k*}`` are then
its minimisers, as no input violates the rows less.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.studies.benchmarks.exact import Array, exactly, quadratic_program, rational, zeros


class Rows(NamedTuple):
    """Rows ``a u ≥ b`` with their weights λ_δ and least slacks δ_min, all rational."""

    a: Array
    b: Array
    weight: Array
    least: Array

    def only(self, chosen: Any) -> "Rows":
        """Return the chosen rows."""
        return Rows(*(field[chosen] for field in self))

    def plain(self) -> "Rows":
        """Return the rows with weight 1 and no least slack."""
        return self._replace(weight=self.weight * 0 + 1, least=self.least * 0)


@dataclass(frozen=True)
class Region:
    """The inputs ``a u ≥ b``, ``u ≥ low``, and u*."""

    a: Array
    b: Array
    low: Array
    u_nominal: Array

    def keep(self, a: Array, b: Array) -> "Region":
        """Return those with ``a u ≥ b``, too."""
        return replace(self, a=np.vstack((self.a, a)), b=np.concatenate((self.b, b)))

    def pin(self, a: Array, value: Array) -> "Region":
        """Return those with ``a u = value``."""
        return self.keep(a, value).keep(-a, -value)

    def nearest(self) -> Array:
        """Return the input nearest u*."""
        return self.drawn(zeros(0, len(self.low)), zeros(0), zeros(0), rational(1))

    def drawn(self, a: Array, target: Array, weight: Array, lambda_u: Any) -> Array:
        """Return ``argmin λ_u ‖u − u*‖² + Σ w_k (t_k − a_k u)²``."""
        n, low = len(self.low), self.low
        hessian = exactly(np.eye(n)) * lambda_u + (a.T * weight) @ a
        linear = hessian @ low - lambda_u * self.u_nominal - (a.T * weight) @ target
        return low + quadratic_program(hessian, linear, self.a, self.b - self.a @ low)

    def relaxed(self, rows: Rows, lambda_u: Any) -> tuple[Array, Array]:
        """Return u and δ of the least ``λ_u ‖u − u*‖² + Σ λ_k max(δ_min, b_k − a_k u)²``."""
        n, m, low = len(self.low), len(rows.b), self.low
        hessian = exactly(np.diag(np.zeros(n + m)))
        hessian[range(n), range(n)] = lambda_u
        hessian[range(n, n + m), range(n, n + m)] = rows.weight
        linear = np.concatenate((lambda_u * (low - self.u_nominal), rows.weight * rows.least))
        a = np.vstack(
            (
                np.hstack((self.a, zeros(len(self.b), m))),
                np.hstack((rows.a, exactly(np.eye(m)))),
            )
        )
        wanted = rows.b - rows.a @ low - rows.least
        x = quadratic_program(hessian, linear, a, np.concatenate((self.b - self.a @ low, wanted)))
        return low + x[:n], rows.least + x[n:]

    def meet(self, rows: Rows) -> "Region":
        """Return those that violate the rows least."""
        if not len(rows.b):
            return self
        _, delta = self.relaxed(rows.plain(), rational(0))
        return self.keep(rows.a, rows.b - delta)


@dataclass(frozen=True)
class Judge:
    """One problem in rational numbers, and its solution by each program.

    Attributes:
        region: U.
        rows: all rows.
        priority: (m,) from 1.
        strict: (m,) whether the level of a row is strict under Lex-CBF-QP.
        lambda_u: λ_u.
    """

    region: Region
    rows: Rows
    priority: np.ndarray
    strict: np.ndarray
    lambda_u: Any

    @classmethod
    def of(cls, input_set: InputSet, u_nominal: np.ndarray, rows: CbfRows, program: Any) -> "Judge":
        """Return the problem that the doubles describe, with a program's weights."""
        a, b = input_set.halfspaces()
        low = input_set.vertices().min(axis=0)
        weight = program.cascade.weights.of(rows.priority, rows.h)
        strict = np.isinf(weight)
        weight, least = np.where(strict, 1.0, weight), program.cascade.least_slack(rows)
        exact = Rows(exactly(rows.a), exactly(rows.b), exactly(weight), exactly(least))
        region = Region(exactly(a), exactly(b), exactly(low), exactly(u_nominal))
        return cls(region, exact, rows.priority, strict, rational(program.cascade.lambda_u))

    def solve(self, name: str) -> Array:
        """Return the input that the program of that name hands back."""
        if name == "cbf-qp":
            return self.region.meet(self.rows).nearest()
        levels = [
            self.rows.only(self.priority == p) for p in range(2, self.priority.max(initial=0) + 1)
        ]
        region = self.region.meet(self.rows.only(self.priority == 1))
        if name == "lex-cbf-qp":
            return self._lexicographic(region, levels)
        if name == "eh-cbf-qp":
            for level in levels:
                region = region.pin(level.a, level.a @ self._drawn(region, level))
            return region.nearest()
        lower = self.rows.only(self.priority > 1)
        return self._relaxed(region, lower) if name == "r-cbf-qp" else self._drawn(region, lower)

    def _relaxed(self, region: Region, rows: Rows) -> Array:
        u, delta = region.relaxed(rows, self.lambda_u)
        if self.lambda_u > 0:
            return u
        paid = rows.weight > 0
        return region.keep(rows.a[paid], (rows.b - delta)[paid]).nearest()

    def _drawn(self, region: Region, rows: Rows) -> Array:
        target = rows.b.copy()
        for k in range(len(rows.b)):
            alone = self.region.meet(rows.only(slice(k, k + 1))).nearest()
            target[k] = rows.a[k] @ alone
        u = region.drawn(rows.a, target, rows.weight, self.lambda_u)
        if self.lambda_u > 0:
            return u
        paid = rows.weight > 0
        return region.pin(rows.a[paid], rows.a[paid] @ u).nearest()

    def _lexicographic(self, region: Region, levels: list[Rows]) -> Array:
        for p, level in enumerate(levels, start=2):
            if self.strict[self.priority == p].all():
                region = region.meet(level)
            else:
                u = self._relaxed(region, level)
                region = region.keep(level.a, np.minimum(level.b, level.a @ u))
        return region.nearest()
