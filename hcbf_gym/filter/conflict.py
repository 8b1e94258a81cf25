"""Which conditions of a filtered step conflict, from the rows that the filter itself makes."""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.filter.bound import Bound
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.conflicts import ConflictReport, conflict_among


def conflict_of(bound: Bound, i: int, input_set: InputSet | None) -> ConflictReport | None:
    """Return the conflict of a plant whose state was accepted; None if there is none.

    The rows are made once more, from the same sample.

    Args:
        bound: the filter of the plants, after its last step.
        i: which plant.
        input_set: U; None takes the corners of the program, at one heading and speed.

    Returns:
        The report, whose `rows` are indices of the conditions.
    """
    step = bound.copy_of_last_step()
    if step is None or step.check() != 0 or not step.pose(i):
        return None  # the last step refused its scene, its input or its state
    _, a, b, h, _, _ = step.problem()
    priority, whose = step.conditions(i)
    there = np.flatnonzero(priority > 0)  # a batch fills up shorter scenes
    rows = CbfRows(a[there], b[there], h[there], priority[there])
    whose = whose[there]
    limits = _sides(step.corners()) if input_set is None else input_set.halfspaces()
    found = conflict_among(rows, bound.rows["slack"][i, whose], limits)
    if found is None:
        return None
    return found._replace(rows=tuple(sorted({int(whose[row]) for row in found.rows})))


def _sides(corners: Array) -> tuple[Array, Array]:
    """Return A (V, 2) and b (V,) of corners, counter-clockwise, with ``U = {u : A u ≥ b}``."""
    side = np.roll(corners, -1, axis=0) - corners
    inward = np.column_stack((-side[:, 1], side[:, 0]))
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    return inward, np.einsum("ij,ij->i", inward, corners)
