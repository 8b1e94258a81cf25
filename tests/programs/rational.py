"""Polygons, quadratics and one-sided penalties in rational arithmetic: no tolerance anywhere.

What the compiled polygons are compared with. All functions take any type of rational numbers; a
polygon is the list of its corners in order, two corners are a segment, one is a point.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

Point = tuple[Any, Any]
Polygon = list[Point]


class Penalty(NamedTuple):
    """``w max(m, t − a·u)²``, or ``w (t − a·u)²`` without a least slack m."""

    a: Point
    target: Any
    weight: Any
    least: Any


class Quadratic(NamedTuple):
    """``½ uᵀ M u − g·u``."""

    xx: Any
    xy: Any
    yy: Any
    gx: Any
    gy: Any

    def add(self, weight: Any, a: Point, target: Any) -> "Quadratic":
        """Return the sum with ``½ w (a·u − t)²``."""
        x, y = a
        return Quadratic(
            self.xx + weight * x * x,
            self.xy + weight * x * y,
            self.yy + weight * y * y,
            self.gx + weight * target * x,
            self.gy + weight * target * y,
        )

    def __call__(self, u: Point) -> Any:
        """Return the value at u."""
        x, y = u
        square = self.xx * x * x + 2 * self.xy * x * y + self.yy * y * y
        return square / 2 - self.gx * x - self.gy * y


NOTHING = Quadratic(0, 0, 0, 0, 0)


def dot(a: Point, u: Point) -> Any:
    """Return a·u."""
    return a[0] * u[0] + a[1] * u[1]


def cut(polygon: Polygon, a: Point, b: Any) -> Polygon:
    """Return the part of a polygon with ``a·u ≥ b``; empty if there is none."""
    heights = [dot(a, u) - b for u in polygon]
    result: Polygon = []
    for i, (u, here) in enumerate(zip(polygon, heights, strict=True)):
        before, there = polygon[i - 1], heights[i - 1]
        if here * there < 0:
            t = there / (there - here)
            crossing = (before[0] + t * (u[0] - before[0]), before[1] + t * (u[1] - before[1]))
            if crossing not in result:
                result.append(crossing)
        if here >= 0 and u not in result:
            result.append(u)
    return result


def at(polygon: Polygon, a: Point, value: Any) -> Polygon:
    """Return the part of a polygon with ``a·u = value``."""
    return cut(cut(polygon, a, value), (-a[0], -a[1]), -value)


def minimisers(polygon: Polygon, cost: Quadratic) -> Polygon:
    """Return the points of a polygon that minimise a convex quadratic: one, or a face."""
    determinant = cost.xx * cost.yy - cost.xy * cost.xy
    if determinant == 0:
        if cost.xx == 0 and cost.yy == 0:
            return polygon
        n, g = ((cost.xx, cost.xy), cost.gx) if cost.xx != 0 else ((cost.xy, cost.yy), cost.gy)
        values = [dot(n, u) for u in polygon]  # M u = g has the row n·u = g
        return at(polygon, n, min(max(g, min(values)), max(values)))
    centre = (
        (cost.yy * cost.gx - cost.xy * cost.gy) / determinant,
        (cost.xx * cost.gy - cost.xy * cost.gx) / determinant,
    )
    sides = [(polygon[i - 1], polygon[i]) for i in range(len(polygon))]
    if len(polygon) > 2 and all(
        (v[0] - u[0]) * (centre[1] - u[1]) >= (v[1] - u[1]) * (centre[0] - u[0]) for u, v in sides
    ):
        return [centre]
    candidates = list(polygon)
    for u, v in sides:
        d = (v[0] - u[0], v[1] - u[1])
        curvature = cost.xx * d[0] * d[0] + 2 * cost.xy * d[0] * d[1] + cost.yy * d[1] * d[1]
        if curvature == 0:
            continue
        slope = (cost.xx * u[0] + cost.xy * u[1] - cost.gx) * d[0]
        slope += (cost.xy * u[0] + cost.yy * u[1] - cost.gy) * d[1]
        t = -slope / curvature
        if 0 < t < 1:
            candidates.append((u[0] + t * d[0], u[1] + t * d[1]))
    return [min(candidates, key=cost)]


def soft_minimum(polygon: Polygon, penalties: Sequence[Penalty]) -> Point:
    """Return a minimiser of a sum of penalties over a polygon.

    The kinks ``t_k − a_k·u = m_k`` cut the polygon into cells on each of which the cost is one
    quadratic. From the minimiser on one cell a direction of descent leads to another; the cost
    falls with every step, so that none comes twice.
    """
    count = len(polygon)
    u: Point = (sum(x for x, _ in polygon) / count, sum(y for _, y in polygon) / count)
    ray: Point | None = (0, 0)
    while ray is not None:
        cell, cost = polygon, NOTHING
        for p in penalties:
            if p.least is None:
                cost = cost.add(p.weight, p.a, p.target)
            elif _pays(p, u, ray):
                cell = cut(cell, (-p.a[0], -p.a[1]), p.least - p.target)
                cost = cost.add(p.weight, p.a, p.target)
            else:
                cell = cut(cell, p.a, p.target - p.least)
        u = minimisers(cell, cost)[0]
        rays = _rays(polygon, penalties, u)
        ray = next((ray for ray in rays if _slope(penalties, u, ray) < 0), None)
    return u


def _pays(p: Penalty, u: Point, ray: Point) -> bool:
    """Tell whether a row's cost rises with its violation at u or, at its kink, along the ray."""
    excess = p.target - p.least - dot(p.a, u)
    return excess > 0 or (excess == 0 and dot(p.a, ray) < 0)


def _slope(penalties: Sequence[Penalty], u: Point, ray: Point) -> Any:
    """Return half the directional derivative of the cost at u."""
    return sum(
        -p.weight * (p.target - dot(p.a, u)) * dot(p.a, ray)
        for p in penalties
        if p.least is None or _pays(p, u, ray)
    )


def _rays(polygon: Polygon, penalties: Sequence[Penalty], u: Point) -> list[Point]:
    """Return directions into the polygon between neighbours of which the cost's slope is linear.

    If it falls along none of them, it falls nowhere.
    """
    rays = [(v[0] - u[0], v[1] - u[1]) for v in polygon if v != u]
    if len(polygon) < 3:
        return rays
    edges = [
        (q[0] - p[0], q[1] - p[1])
        for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True)
        if (q[0] - p[0]) * (u[1] - p[1]) == (q[1] - p[1]) * (u[0] - p[0])
    ]
    for p in penalties:
        if p.least is None or p.target - p.least != dot(p.a, u):
            continue
        for x, y in ((-p.a[1], p.a[0]), (p.a[1], -p.a[0])):
            if all(edge[0] * y >= edge[1] * x for edge in edges):
                rays.append((x, y))
    return rays
