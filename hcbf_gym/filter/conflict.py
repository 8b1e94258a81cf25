"""Which conditions of a filtered step conflict, from the rows that the filter itself makes."""

from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.conflicts import ConflictReport, conflict_among


class Polygon(NamedTuple):
    """The U of a differential drive at one heading and speed.

    Attributes:
        corners: (V, 2) counter-clockwise [m/s²].
    """

    corners: Array

    @property
    def n_u(self) -> int:
        """The number of inputs, 2."""
        return 2

    @property
    def radius(self) -> float:
        """The largest norm of an input."""
        return float(np.linalg.norm(self.corners, axis=1).max())

    def halfspaces(self) -> tuple[Array, Array]:
        """Return A (V, 2) and b (V,) with ``U = {u : A u ≥ b}`` and unit rows."""
        side = np.roll(self.corners, -1, axis=0) - self.corners
        inward = np.column_stack((-side[:, 1], side[:, 0]))
        inward /= np.linalg.norm(inward, axis=1, keepdims=True)
        return inward, np.einsum("ij,ij->i", inward, self.corners)


def conflict_of(
    asked: Any, i: int, slack: Array, input_set: InputSet | None
) -> ConflictReport | None:
    """Return the conflict of a plant whose state was accepted; None where there is none.

    The rows are made once more, from the same sample.

    Args:
        asked: the `_core.Filter` of copies, which are written to, as the last step left them.
        i: which plant.
        slack: (M,) of its rows at that step.
        input_set: U; None takes the corners of the program.

    Returns:
        the report, whose `rows` are indices of the conditions.
    """
    if asked.check() != 0 or not asked.pose(i):
        return None  # the last step refused its scene, its input or its state
    _, a, b, h, _, _ = asked.problem()
    priority, whose = asked.conditions(i)
    there = np.flatnonzero(priority > 0)  # a batch fills up shorter scenes
    rows = CbfRows(a[there], b[there], h[there], priority[there])
    whose = whose[there]
    limits: Any = Polygon(asked.corners()) if input_set is None else input_set
    found = conflict_among(rows, slack[whose], limits)
    if found is None:
        return None
    return found._replace(rows=tuple(sorted({int(whose[row]) for row in found.rows})))
