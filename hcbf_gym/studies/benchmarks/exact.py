"""The planar programs solved by enumeration, in rational arithmetic: no tolerance anywhere.

One-sided penalties are minimised by brute force over the cells that their kinks cut out of the
polygon. Slow, and meant to be read beside the definitions of the programs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.programs.exact.rational import (
    Point,
    Polygon,
    Quadratic,
    at,
    cut,
    dot,
    minimisers,
    rational,
)


class Row(NamedTuple):
    """One row ``a·u ≥ b`` with what a program reads beside it, all rational."""

    a: Point
    b: Any
    weight: Any
    least: Any
    priority: int


def distance(u_nominal: Point, weight: Any) -> Quadratic:
    """Return ``½ w ‖u − u*‖²`` up to a constant."""
    zero = rational(0)
    return Quadratic(weight, zero, weight, weight * u_nominal[0], weight * u_nominal[1])


def gap(u: Point, v: Point) -> Any:
    """Return ``‖u − v‖²``."""
    return (u[0] - v[0]) ** 2 + (u[1] - v[1]) ** 2


def nearest(polygon: Polygon, u_nominal: Point) -> Point:
    """Return the point of a polygon nearest u*."""
    return minimisers(polygon, distance(u_nominal, rational(1)))[0]


def penalty(rows: Sequence[Row], u: Point) -> Any:
    """Return ``½ Σ w_k max(m_k, b_k − a_k·u)²``."""
    return sum((r.weight * max(r.least, r.b - dot(r.a, u)) ** 2 for r in rows), rational(0)) / 2


def soft_minimisers(polygon: Polygon, rows: Sequence[Row], cost: Quadratic) -> Polygon:
    """Return the points that minimise cost plus :func:`penalty`: one, or a face."""
    best: tuple[Any, Point] | None = None
    cells: list[tuple[Polygon, int, Quadratic]] = [(polygon, 0, cost)]
    while cells:
        cell, k, quadratic = cells.pop()
        if k == len(rows):
            u = minimisers(cell, quadratic)[0]
            value = cost(u) + penalty(rows, u)
            if best is None or value < best[0]:
                best = (value, u)
            continue
        row = rows[k]
        kink = row.b - row.least
        met, paid = cut(cell, row.a, kink), cut(cell, (-row.a[0], -row.a[1]), -kink)
        if len(met) > 1 or met == cell:
            cells.append((met, k + 1, quadratic))
        if len(paid) > 1 or paid == cell:
            cells.append((paid, k + 1, quadratic.add(row.weight, row.a, row.b)))
    assert best is not None
    if cost.xx != 0:
        return [best[1]]
    for row in rows:  # each violation above m_k has one value on all minimisers
        if row.weight == 0 or row.a == (0, 0):
            continue
        value, kink = dot(row.a, best[1]), row.b - row.least
        polygon = at(polygon, row.a, value) if value < kink else cut(polygon, row.a, kink)
    return polygon


def meet(polygon: Polygon, rows: Sequence[Row]) -> Polygon:
    """Return the inputs that meet the rows, or those of least ``Σ max(0, b − a·u)²``."""
    met = polygon
    for row in rows:
        if met and row.a != (0, 0):
            met = cut(met, row.a, row.b)
    if met:
        return met
    plain = [row._replace(weight=rational(1), least=rational(0)) for row in rows]
    return soft_minimisers(polygon, plain, Quadratic(*[rational(0)] * 5))


@dataclass(frozen=True)
class Exact:
    """One problem in rational numbers, and its solution by each program.

    Args:
        vertices: (V, 2) corners of U, counter-clockwise.
        u_nominal: (2,) u*.
        rows: the rows of one state.
        weight: (m,) λ_δ; infinity for a strict level.
        least: (m,) δ_min.
        lambda_u: λ_u.
    """

    polygon: Polygon
    u_nominal: Point
    rows: tuple[Row, ...]
    lambda_u: Any

    @classmethod
    def of(
        cls,
        vertices: np.ndarray,
        u_nominal: np.ndarray,
        rows: CbfRows,
        weight: np.ndarray,
        least: np.ndarray,
        lambda_u: float,
    ) -> "Exact":
        """Return the problem that the doubles describe."""

        def point(u: np.ndarray) -> Point:
            return rational(float(u[0])), rational(float(u[1]))

        exact_rows = tuple(
            Row(
                point(rows.a[k]),
                rational(float(rows.b[k])),
                None if np.isinf(weight[k]) else rational(float(weight[k])),
                rational(float(least[k])),
                int(rows.priority[k]),
            )
            for k in range(rows.b.size)
        )
        return cls([point(v) for v in vertices], point(u_nominal), exact_rows, rational(lambda_u))

    def levels(self) -> list[list[Row]]:
        """Return the rows of each priority."""
        count = max((row.priority for row in self.rows), default=0)
        return [[row for row in self.rows if row.priority == p + 1] for p in range(count)]

    def solve(self, name: str) -> Point:
        """Return the input that the program of that name hands back."""
        return nearest(self.choices(name), self.u_nominal)

    def choices(self, name: str) -> Polygon:
        """Return all inputs between which only the distance from u* is left to decide."""
        levels = self.levels() or [[]]
        lower = [row for level in levels[1:] for row in level]
        if name == "cbf-qp":
            return meet(self.polygon, self.rows)
        feasible = meet(self.polygon, levels[0])
        if name == "lex-cbf-qp":
            return self._lexicographic(feasible, levels[1:])
        if name == "r-cbf-qp":
            return soft_minimisers(feasible, lower, self._distance())
        if name == "eh-cbf-qp":
            for level in levels[1:]:
                u = nearest(self._drawn(feasible, level), self.u_nominal)
                for row in level:
                    feasible = at(feasible, row.a, dot(row.a, u))
            return feasible
        return self._drawn(feasible, lower)

    def alone(self, row: Row) -> Point:
        """Return û_k, the solution of the program of one row."""
        return nearest(meet(self.polygon, [row]), self.u_nominal)

    def _distance(self) -> Quadratic:
        return distance(self.u_nominal, self.lambda_u)

    def _drawn(self, feasible: Polygon, rows: Sequence[Row]) -> Polygon:
        cost = self._distance()
        for row in rows:
            cost = cost.add(row.weight, row.a, dot(row.a, self.alone(row)))
        return minimisers(feasible, cost)

    def _lexicographic(self, feasible: Polygon, levels: Sequence[Sequence[Row]]) -> Polygon:
        for level in levels:
            if level[0].weight is None:
                feasible = meet(feasible, level)
                continue
            u = nearest(soft_minimisers(feasible, level, self._distance()), self.u_nominal)
            for row in level:
                feasible = cut(feasible, row.a, min(row.b, dot(row.a, u)))
        return feasible

    def costs(self, name: str, u: Point) -> list[Any]:
        """Return what the program minimises at u, in the order in which it does.

        EH-CBF-QP's stages are judged by their δ alone: later stages move u on.
        """
        strict = [row._replace(weight=rational(1), least=rational(0)) for row in self.rows]
        levels = self.levels() or [[]]
        lower = [row for level in levels[1:] for row in level]
        away = self.lambda_u * gap(u, self.u_nominal) / 2
        if name == "cbf-qp":
            return [penalty(strict, u)]
        costs = [penalty([row for row in strict if row.priority == 1], u)]
        if name == "lex-cbf-qp":
            for level in levels[1:]:
                free = level[0].weight is None
                rows = [r for r in strict if r.priority == level[0].priority] if free else level
                costs.append(penalty(rows, u) + (0 if free else away))
            return costs
        if name == "r-cbf-qp":
            return [*costs, penalty(lower, u) + away]
        drawn = [
            row.weight * (dot(row.a, self.alone(row)) - dot(row.a, u)) ** 2 / 2 for row in lower
        ]
        if name == "eh-cbf-qp":
            return [*costs, *drawn]
        return [*costs, sum(drawn, away)]
