"""A class of a map's cells: its meaning, its rank and its cells."""

from dataclasses import dataclass

import numpy as np

from hcbf_gym.arrays import Mask
from hcbf_gym.barriers.layout import LOWEST_RANK
from hcbf_gym.errors import InvalidInputError, as_array, choose, finite_float, shown
from hcbf_gym.models.constants import FARTHEST

KINDS = ("keepout", "speed", "unknown")
"""Kinds of classes: cells not to be entered, to be crossed slowly, or never seen."""


@dataclass(frozen=True, eq=False)
class MapClass:
    """Cells of one meaning and one rank.

    Args:
        name: of the class in messages, infos and figures.
        rank: 1 is the highest and strict.
        kind: "keepout", "speed" or "unknown", see `KINDS`.
        cells: (rows, columns) truth values, row 0 the lowest; copied, read-only.
        limit: greatest speed inside [m/s], of the kind "speed" alone.
        margin: distance that is reserved around the cells besides the robot's own margins [m].

    Raises:
        InvalidInputError: if an argument has another type or is out of range.
    """

    name: str
    rank: int
    kind: str
    cells: Mask
    limit: float | None = None
    margin: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InvalidInputError(
                f"map class: name: got {shown(self.name)}, expected non-empty text"
            )
        label = f"map class {self.name!r}"
        choose(f"{label}: kind", self.kind, dict.fromkeys(KINDS))
        is_integer = isinstance(self.rank, int | np.integer) and not isinstance(self.rank, bool)
        if not is_integer or not 1 <= self.rank <= LOWEST_RANK:
            raise InvalidInputError(
                f"{label}: rank: got {shown(self.rank)}, expected an integer from 1 to "
                f"{LOWEST_RANK}"
            )
        if (self.kind == "speed") != (self.limit is not None):
            raise InvalidInputError(
                f"{label}: limit: got {shown(self.limit)} for the kind {self.kind!r}, "
                "expected a speed [m/s] for the kind 'speed' and None for the others"
            )
        cells = as_array(f"{label}: cells", self.cells)
        if cells.ndim != 2 or cells.dtype != np.bool_:
            raise InvalidInputError(
                f"{label}: cells: got {cells.dtype} of the shape {cells.shape}, "
                "expected truth values (rows, columns)"
            )
        cells = cells.copy()
        cells.flags.writeable = False
        object.__setattr__(self, "cells", cells)
        object.__setattr__(self, "rank", int(self.rank))
        if self.limit is not None:
            limit = finite_float(
                f"{label}: limit", self.limit, minimum=0.0, maximum=FARTHEST, exclusive=True
            )
            object.__setattr__(self, "limit", limit)
        margin = finite_float(f"{label}: margin", self.margin, minimum=0.0, maximum=100.0)
        object.__setattr__(self, "margin", margin)

    @property
    def is_strict(self) -> bool:
        """Whether no robot may enter these cells."""
        return self.rank == 1 and self.kind != "speed"
