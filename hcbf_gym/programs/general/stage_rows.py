"""Rows as the stages of a cascade read them."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.compilation import kernel
from hcbf_gym.programs.plans import Plan
from hcbf_gym.programs.prices import Prices
from hcbf_gym.programs.weights import weight_of


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
    stage: Integers
    strict: Mask
    weight: Array
    least: Array
    target: Array

    def only(self, chosen: NDArray[np.intp] | slice) -> "StageRows":
        """Return the chosen (s,) rows."""
        return self._make(field[chosen] for field in self)


def stage_rows(plan: Plan, prices: Prices, rows: CbfRows, least: Array) -> StageRows:
    """Return the rows of one state as the stages of a plan read them.

    Args:
        plan: what is solved.
        prices: its numbers.
        rows: of the state.
        least: (m,) δ_min.
    """
    by_level = plan.order == "by level"
    found = _staged(prices.weights.table[0], by_level, rows.priority, rows.h)
    return StageRows(rows.a, rows.b, *found, least, rows.b)


@kernel()
def _staged(
    table: Array, by_level: bool, priority: Integers, h: Array
) -> tuple[Integers, Mask, Array]:
    """Return stage, strict and weight (m,); `table` is that of `Weights`."""
    stage, strict = priority.copy(), np.empty(h.size, dtype=np.bool_)
    weight = np.ones(h.size)
    for k in range(h.size):
        price = weight_of(table, priority[k], h[k])
        strict[k] = np.isinf(price)
        if not by_level:
            stage[k] = 1 if strict[k] else 2
        if not strict[k]:
            weight[k] = price
    return stage, strict, weight


def in_stages(rows: StageRows) -> list[StageRows]:
    """Return the rows of each stage that has any, as parts of the rows in their order."""
    stage = rows.stage.tolist()
    if stage != sorted(stage):
        rows = rows.only(np.argsort(rows.stage, kind="stable"))
    ends = np.cumsum([stage.count(one) for one in sorted(set(stage))]).tolist()
    return [rows.only(slice(*part)) for part in pairwise([0, *ends])]
