"""Rows as the stages of a cascade read them."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers, Mask
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
    m, by_level = rows.b.size, plan.order == "by level"
    stage, strict, weight = np.empty(m, np.int64), np.empty(m, np.bool_), np.empty(m)
    table = prices.weights.table[0]
    _core.stage_rows(table, by_level, rows.priority, rows.h, stage, strict, weight)
    return StageRows(rows.a, rows.b, stage, strict, weight, least, rows.b)


def in_stages(rows: StageRows) -> list[StageRows]:
    """Return the rows of each stage that has any, as parts of the rows in their order."""
    stage = rows.stage.tolist()
    if stage != sorted(stage):
        rows = rows.only(np.argsort(rows.stage, kind="stable"))
    ends = np.cumsum([stage.count(one) for one in sorted(set(stage))]).tolist()
    return [rows.only(slice(*part)) for part in pairwise([0, *ends])]
