"""The programs' definitions once more, stage by stage in rational arithmetic, to judge them by.

What a stage decides is a violation δ* of each of its rows. ``{u : a_k u ≥ b_k − δ_k*}`` are then
its minimisers, as no input violates the rows less.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from benchmarks.judges.certificate import Rationals, Stage, dot, minimiser
from benchmarks.judges.exact import exactly, rational
from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import choose
from hcbf_gym.models.input_sets import InputSet

JUDGED = ("cbf-qp", "r-cbf-qp", "h-cbf-qp", "ih-cbf-qp", "eh-cbf-qp", "lex-cbf-qp")
"""The programs whose equations stand here."""


class Rows(NamedTuple):
    """Rows ``a u ≥ b`` with their weights λ_δ and least slacks δ_min: doubles, which are exact."""

    a: Array
    b: Array
    weight: Array
    least: Array

    def only(self, chosen: Any) -> "Rows":
        """Return the chosen rows."""
        return Rows(*(field[chosen] for field in self))

    def plain(self) -> "Rows":
        """Return the rows with weight 1 and no least slack."""
        return self._replace(weight=np.ones(self.b.size), least=np.zeros(self.b.size))

    def values(self, u: Rationals) -> Rationals:
        """Return a u (m,)."""
        return [dot(a, u) for a in self.a]


@dataclass(frozen=True)
class Region:
    """The inputs ``a u ≥ b``, b rational, all above `low`, and u*."""

    a: Array
    b: Rationals
    low: Array
    u_nominal: Array

    def keep(self, a: Array, b: Rationals) -> "Region":
        """Return those with ``a u ≥ b``, too."""
        return replace(self, a=np.vstack((self.a, a)), b=self.b + b)

    def pin(self, rows: Rows, u: Rationals) -> "Region":
        """Return those at which each row has the value that it has at u."""
        value = rows.values(u)
        return self.keep(rows.a, value).keep(-rows.a, [-v for v in value])

    def bound(self, rows: Rows, u: Rationals) -> "Region":
        """Return those at which no row is violated more than at u."""
        bounds = exactly(rows.b).tolist()
        return self.keep(rows.a, [min(b, v) for b, v in zip(bounds, rows.values(u), strict=True)])

    def nearest(self) -> Rationals:
        """Return the input nearest u*."""
        none = np.zeros(0)
        return self._minimiser(1.0, np.zeros((0, self.low.size)), [], none, None)

    def drawn(self, rows: Rows, target: Rationals, lambda_u: float) -> Rationals:
        """Return ``argmin λ_u ‖u − u*‖² + Σ w_k (t_k − a_k u)²``; of several, the nearest to u*."""
        paid = rows.weight > 0.0
        chosen = rows.only(paid)
        drawn_to = [target[k] for k in np.flatnonzero(paid)]
        u = self._minimiser(lambda_u, chosen.a, drawn_to, chosen.weight, None)
        return u if lambda_u > 0.0 else self.pin(chosen, u).nearest()

    def relaxed(self, rows: Rows, lambda_u: float) -> Rationals:
        """Return u of the least ``λ_u ‖u − u*‖² + Σ w_k max(δ_min, b_k − a_k u)²``, likewise."""
        chosen = rows.only(rows.weight > 0.0)
        u = self._soft(chosen, lambda_u)
        if lambda_u > 0.0:
            return u
        edge = [b - m for b, m in zip(exactly(chosen.b), exactly(chosen.least), strict=True)]
        kept = [min(e, v) for e, v in zip(edge, chosen.values(u), strict=True)]
        return self.keep(chosen.a, kept).nearest()

    def meet(self, rows: Rows) -> "Region":
        """Return those that violate the rows least."""
        return self.bound(rows, self._soft(rows.plain(), 0.0)) if rows.b.size else self

    def _soft(self, rows: Rows, lambda_u: float) -> Rationals:
        target = exactly(rows.b).tolist()
        return self._minimiser(lambda_u, rows.a, target, rows.weight, rows.least)

    def _minimiser(
        self, lambda_u: float, a: Array, target: Rationals, weight: Array, least: Array | None
    ) -> Rationals:
        parts = self.a, self.b, self.low, self.u_nominal
        return minimiser(Stage(*parts, lambda_u, a, target, weight, least))


@dataclass(frozen=True)
class Judge:
    """One problem, and its solution by each program.

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
    lambda_u: float

    @classmethod
    def of(cls, input_set: InputSet, u_nominal: np.ndarray, rows: CbfRows, program: Any) -> "Judge":
        """Return the problem that the doubles describe, with a program's weights."""
        a, b = input_set.halfspaces()
        low = input_set.vertices().min(axis=0) - 1.0
        table, prices = program.prices.weights[0], program.prices
        ranked = zip(rows.priority.tolist(), rows.h.tolist(), strict=True)
        weight = np.array([_core.row_weight(table, rank, h) for rank, h in ranked])
        strict = np.isinf(weight)
        weight, least = np.where(strict, 1.0, weight), np.zeros(rows.b.shape)
        if prices.known_offset and rows.alpha2_psi is not None:
            least = np.where(rows.priority == 1, 0.0, np.maximum(0.0, -rows.alpha2_psi))
        region = Region(np.asarray(a, dtype=np.float64), exactly(b).tolist(), low, u_nominal)
        known = Rows(rows.a, rows.b, weight, least)
        return cls(region, known, rows.priority, strict, float(prices.lambda_u))

    def solve(self, name: str) -> Rationals:
        """Return the input (n,) that the program of that name hands back.

        Raises:
            UnknownNameError: if its equation does not stand here.
        """
        choose("program", name, dict.fromkeys(JUDGED))
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
                region = region.pin(level, self._drawn(region, level))
            return region.nearest()
        lower = self.rows.only(self.priority > 1)
        if name == "r-cbf-qp":
            return region.relaxed(lower, self.lambda_u)
        return self._drawn(region, lower)

    def _drawn(self, region: Region, rows: Rows) -> Rationals:
        """Draw rows to what each would get alone."""
        nominal, target = self.region.nearest(), []
        for k in range(rows.b.size):
            value = dot(rows.a[k], nominal)
            if value < rational(float(rows.b[k])):
                alone = self.region.meet(rows.only(slice(k, k + 1))).nearest()
                value = dot(rows.a[k], alone)
            target.append(value)
        return region.drawn(rows, target, self.lambda_u)

    def _lexicographic(self, region: Region, levels: list[Rows]) -> Rationals:
        for p, level in enumerate(levels, start=2):
            if self.strict[self.priority == p].all():
                region = region.meet(level)
            else:
                region = region.bound(level, region.relaxed(level, self.lambda_u))
        return region.nearest()
