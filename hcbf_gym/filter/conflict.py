"""Finds which conditions of a filtered step conflict, from the rows that the filter makes."""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.filter import solvers
from hcbf_gym.filter.bound import Bound
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.conflicts import ConflictReport, conflict_among


def conflict_of(bound: Bound, i: int, input_set: InputSet | None) -> ConflictReport | None:
    """Return which conditions of a plant no input met together at the last step.

    The rows are made once more, from the same sample.

    Args:
        bound: the filter, after its last step.
        i: the plant, whose state was accepted.
        input_set: U; None takes the corners of the step's own U, which turns with a heading.

    Returns:
        The conflict, whose `rows` are indices of the conditions; None if there is none.
    """
    step = bound.copy_of_last_step()
    if step is None or step.check() != solvers.DONE or not step.pose(i):
        return None  # the last step refused its scene, its input or its state
    _, a, b, h, _, _ = step.problem()
    priority, condition_of_row = step.conditions(i)
    has_row = np.flatnonzero(priority > 0)  # shorter scenes of a batch are filled up
    rows = CbfRows(a[has_row], b[has_row], h[has_row], priority[has_row])
    condition_of_row = condition_of_row[has_row]
    halfspaces = _sides(step.corners()) if input_set is None else input_set.halfspaces()
    conflict = conflict_among(rows, bound.rows["slack"][i, condition_of_row], halfspaces)
    if conflict is None:
        return None
    # a condition of a map has several rows
    conditions = {int(condition_of_row[row]) for row in conflict.rows}
    return conflict._replace(rows=tuple(sorted(conditions)))


def _sides(corners: Array) -> tuple[Array, Array]:
    """Return A (V, 2) and b (V,) of ``U = {u : A u ≥ b}`` with counter-clockwise corners (V, 2)."""
    side = np.roll(corners, -1, axis=0) - corners
    inward = np.column_stack((-side[:, 1], side[:, 0]))
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    return inward, np.einsum("ij,ij->i", inward, corners)
