"""Which conditions of a filtered step conflict, from the rows that the filter itself makes."""

from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Records
from hcbf_gym.barriers.row_kernels import B, H
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.filtering import step
from hcbf_gym.filtering.plants import Drives, Plants, split
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
    shared: tuple[Records, Array, Drives],
    plants: Plants,
    atlas: Array | None,
    input_set: InputSet | None,
) -> ConflictReport | None:
    """Return the conflict of one plant whose state was accepted; None where there is none.

    The rows are made once more, from the same sample; copies are written to.

    Args:
        shared: constants, the plant's program and whether it has an axle, as `step.pose` takes it.
        plants: one plant, as the last step left it.
        atlas: as `step.filter_plants` takes it.
        input_set: U; None takes the corners of the program.

    Returns:
        the report, whose `rows` are indices of the conditions.
    """
    constants, program, drives = shared
    constants = constants.copy()
    constants["input_sets"] = min(1, constants["input_sets"][0])
    sensed, slack = plants.sensed.copy(), plants.rows["slack"][0]
    sensed["known"] = 0  # or the time of the same sample would not advance
    copies = plants._replace(sensed=sensed, told=plants.told.copy(), rows=plants.rows.copy())
    _, part, work, source = step.pose(constants, program, drives, copies, atlas)
    m = part.kind.shape[1]
    whose = source if source.size else np.arange(m)
    there = part.priority[0] > 0  # a batch fills up shorter scenes
    rows = CbfRows(
        work.a[0, :m][there], work.rows[B, 0, :m][there], work.rows[H, 0, :m][there],
        part.priority[0][there],
    )  # fmt: skip
    whose = whose[there]
    limits: Any = input_set
    if limits is None:
        limits = Polygon(split(constants[0], program)[0][0])
    found = conflict_among(rows, slack[whose], limits)
    if found is None:
        return None
    return found._replace(rows=tuple(sorted({int(whose[row]) for row in found.rows})))
