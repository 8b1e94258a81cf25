"""The planar programs in rational arithmetic, for what does not fit into doubles.

Every double is a rational number. Where the rows of one stage differ so much in steepness that
their least squares do not fit into doubles, all stages of the state are decided here: slowly, and
exactly.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.cascades import Cascade, StageRows
from hcbf_gym.programs.exact.rational import (
    NOTHING,
    Penalty,
    Point,
    Polygon,
    Quadratic,
    at,
    cut,
    dot,
    minimisers,
    rational,
    soft_minimum,
    to_doubles,
    to_rational,
)
from hcbf_gym.programs.program import account
from hcbf_gym.programs.result import FilterResult

Array = NDArray[Any]


def filter_exactly(
    cascade: Cascade,
    input_set: InputSet,
    u_nominal: NDArray[np.float64],
    rows: CbfRows,
    state: int = 0,
) -> FilterResult:
    """Filter one nominal input in rational arithmetic.

    Args:
        cascade: what is solved.
        input_set: U, of two inputs.
        u_nominal: (2,) u*.
        rows: the rows of one state.
        state: which of a batch's states it is, where each has weights of its own.

    Returns:
        The result, with one fallback.
    """
    polygon = [_point(corner) for corner in input_set.vertices().tolist()]
    inputs = ExactInputs(polygon, _point(u_nominal.tolist()))
    u, target = cascade.decide(inputs, _exact(cascade.stage_rows(rows, state)))
    targets = None if target is None else to_doubles(target)
    result = account(cascade, input_set.radius, u_nominal, rows, to_doubles(u), targets)
    return result._replace(fallbacks=1)


def _exact(rows: StageRows) -> StageRows:
    """Return rows of doubles as the rational numbers that these are."""
    a, b, priority, strict, weight, least = rows
    return StageRows(
        to_rational(a), to_rational(b), priority, strict, to_rational(weight), to_rational(least)
    )


def _point(u: list[float]) -> Point:
    return rational(u[0]), rational(u[1])


class ExactInputs(NamedTuple):
    """The inputs that the stages so far leave, as a polygon; see `cascades.Inputs`."""

    polygon: Polygon
    u_nominal: Point

    def nearest(self) -> Array:
        """Return ``argmin ‖u − u*‖²``."""
        return _array(minimisers(self.polygon, self._distance(rational(1)))[0])

    def meeting(self, rows: StageRows) -> "ExactInputs | None":
        """Keep those that meet the rows; None where none does."""
        met = self.polygon
        for a, b in zip(rows.a, rows.b, strict=True):
            if met and a.any():
                met = cut(met, tuple(a), b)
        return self._replace(polygon=met) if met else None

    def violating_least(self, rows: StageRows) -> "ExactInputs":
        """Keep those that violate the rows least, ``min Σ max(0, b_k − a_k u)²``."""
        ones, zeros = rows.b * 0 + 1, rows.b * 0
        return self._minimisers(_penalties(rows._replace(weight=ones, least=zeros)))

    def meet(self, rows: StageRows) -> "ExactInputs":
        """Keep those that meet the rows or, where none does, violate them least."""
        met = self.meeting(rows)
        return self.violating_least(rows) if met is None else met

    def relax(self, rows: StageRows, lambda_u: float) -> Array:
        """Return ``argmin λ_u ‖u − u*‖² + Σ λ_δk max(δ_min, b_k − a_k u)²``."""
        penalties = _penalties(rows)
        if lambda_u == 0.0:
            return self._minimisers(penalties).nearest()
        one, zero, (x, y) = rational(1), rational(0), self.u_nominal
        price = rational(lambda_u)
        away = [Penalty((one, zero), x, price, None), Penalty((zero, one), y, price, None)]
        return _array(soft_minimum(self.polygon, [*away, *penalties]))

    def draw(self, rows: StageRows, target: Array, lambda_u: float) -> Array:
        """Return ``argmin λ_u ‖u − u*‖² + Σ λ_δk (t_k − a_k u)²``."""
        cost = self._distance(rational(lambda_u))
        for a, t, weight in zip(rows.a, target, rows.weight, strict=True):
            cost = cost.add(weight, tuple(a), t)
        return self._replace(polygon=minimisers(self.polygon, cost)).nearest()

    def pin(self, rows: StageRows, u: Array) -> "ExactInputs":
        """Keep those at which each row has the value that it has at u."""
        polygon = self.polygon
        for a in rows.a:
            polygon = at(polygon, tuple(a), a @ u)
        return self._replace(polygon=polygon)

    def bound(self, rows: StageRows, u: Array) -> "ExactInputs":
        """Keep those at which no row is violated more than at u."""
        polygon = self.polygon
        for a, b in zip(rows.a, rows.b, strict=True):
            polygon = cut(polygon, tuple(a), min(b, a @ u))
        return self._replace(polygon=polygon)

    def _distance(self, weight: Any) -> Quadratic:
        one, zero, (x, y) = rational(1), rational(0), self.u_nominal
        return NOTHING.add(weight, (one, zero), x).add(weight, (zero, one), y)

    def _minimisers(self, penalties: list[Penalty]) -> "ExactInputs":
        """Keep the minimisers of a sum of penalties: each excess has one value on all of them."""
        u, polygon = soft_minimum(self.polygon, penalties), self.polygon
        for p in penalties:
            value, kink = dot(p.a, u), p.target - p.least
            polygon = at(polygon, p.a, value) if value < kink else cut(polygon, p.a, kink)
        return self._replace(polygon=polygon)


def _array(u: Point) -> Array:
    return np.array(u, dtype=object)


def _penalties(rows: StageRows) -> list[Penalty]:
    """Return what the rows cost, without those that cost nothing or the same everywhere."""
    stage = zip(rows.a, rows.b, rows.weight, rows.least, strict=True)
    return [Penalty(tuple(a), b, w, m) for a, b, w, m in stage if w > 0 and a.any()]
