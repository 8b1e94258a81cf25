"""Rows as the stages of a cascade read them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.programs.plans import Plan
from hcbf_gym.programs.prices import Prices


class StageRows(NamedTuple):
    """Rows as the stages read them.

    Attributes:
        a: (s, n_u) gradients.
        b: (s,) bounds.
        stage: (s,) from 1.
        strict: (s,) whether its stage meets the row, instead of paying for it.
        weight: (s,) λ_δ(h); 1 for a strict row.
        least: (s,) δ_min.
        target: (s,) a·û of a row that is drawn to it; b of the others.
    """

    a: Array
    b: Array
    stage: NDArray[np.int64]
    strict: NDArray[np.bool_]
    weight: Array
    least: Array
    target: Array

    def only(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> "StageRows":
        """Return the chosen (s,) rows."""
        return self._make(field[chosen] for field in self)


def stage_rows(plan: Plan, prices: Prices, rows: CbfRows) -> StageRows:
    """Return the rows of one state as the stages of a plan read them."""
    weight = prices.weights.of(rows.priority, rows.h)
    strict = (rows.priority == 1) | np.isinf(weight)
    stage = rows.priority if plan.order == "by level" else np.where(strict, 1, 2)
    weight = np.where(strict, 1.0, weight)
    return StageRows(rows.a, rows.b, stage, strict, weight, prices.least_slack(rows), rows.b)
