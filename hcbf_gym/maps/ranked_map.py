"""A map with ranks: what a robot may not enter, and what it may cross if it must."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hcbf_gym.errors import InvalidInputError
from hcbf_gym.maps.grid import Grid, MapClass

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RankedMap:
    """Cells of a grid in classes, each with its rank. It never changes: `update` returns another.

    Args:
        grid: where the cells lie.
        classes: what cells mean; a cell may be of several classes.

    Raises:
        InvalidInputError: if two classes share a name, or cells are not of the grid's shape.
    """

    grid: Grid
    classes: tuple[MapClass, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "classes", tuple(self.classes))
        names = [one.name for one in self.classes]
        if not names or len(set(names)) < len(names):
            raise InvalidInputError(f"map: got classes {names}, expected different names")
        for one in self.classes:
            if one.cells.shape != self.grid.shape:
                raise InvalidInputError(
                    f"map class {one.name!r}: got cells of the shape {one.cells.shape}, "
                    f"expected {self.grid.shape} as the grid"
                )

    @classmethod
    def load(
        cls,
        file: str | Path,
        masks: Mapping[str, int | Mapping[str, Any]] | None = None,
        **options: Any,
    ) -> Self:
        """Read a map of Nav2, YAML with PGM or PNG, and masks with their ranks."""
        raise NotImplementedError

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Return the map that `to_dict` described."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Return the map as a plain dict that `from_dict` reads and JSON can hold."""
        raise NotImplementedError

    def distance(self, points: ArrayLike, rank: int | None = None) -> Array:
        """Return (N,) covered distances of points (N, 2) from keepout and unknown of a rank [m].

        Args:
            points: (N, 2) [m].
            rank: of the classes that count; None is every one.
        """
        raise NotImplementedError

    def update(self, corner: tuple[int, int], cells: Mapping[str, ArrayLike]) -> Self:
        """Return the map with a window of cells replaced.

        Args:
            corner: lowest row and column of the window.
            cells: class name → (h, w) truth values; the others stay.
        """
        raise NotImplementedError

    def mask(self, rank: int) -> NDArray[np.bool_]:
        """Return (rows, columns) whether a cell is keepout or unknown of a rank."""
        found = np.zeros(self.grid.shape, dtype=np.bool_)
        for one in self.classes:
            if one.rank == rank and one.kind != "speed":
                found |= one.cells
        return found
