"""A map whose classes of cells have ranks, as conditions of the safety filter."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hcbf_gym import _core, records
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.mapped import MappedRegion, MappedZone
from hcbf_gym.barriers.pieces import Pieces
from hcbf_gym.errors import (
    InvalidInputError,
    as_array,
    check_options,
    choose,
    count,
    finite_array,
    shown,
)
from hcbf_gym.models.constants import FARTHEST
from hcbf_gym.models.grid import Grid
from hcbf_gym.scenarios.floor import Floor
from hcbf_robots.maps import packing, reading
from hcbf_robots.maps.cover import Cover, boxes
from hcbf_robots.maps.map_class import MapClass


@dataclass(frozen=True, eq=False)
class RankedMap(Floor):
    """An immutable map: the cells of a grid in classes, each with its rank.

    In a list of barriers it is one condition for each class, in the order of the classes. All
    outside the grid belongs to the class of the kind "unknown", and is free where there is none.

    Args:
        grid: of the cells.
        classes: of the cells; a cell may be of several classes.
        source: the files that the map was read from, as `from_dict` takes them; None for arrays.

    Raises:
        InvalidInputError: if two classes share a name, or cells have another shape than the grid.

    Examples:
        >>> import numpy as np
        >>> cells = np.zeros((20, 40), dtype=bool)
        >>> cells[:, 0] = True
        >>> walls = MapClass("walls", 1, "keepout", cells)
        >>> room = RankedMap(Grid(0.1, (0.0, 0.0, 0.0), (20, 40)), (walls,))
        >>> room.distance([[1.0, 1.0]], 1).round(3)
        array([0.9])
    """

    grid: Grid
    classes: tuple[MapClass, ...]
    source: Mapping[str, Any] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        is_list = isinstance(self.classes, Sequence) and not isinstance(self.classes, str)
        if not is_list or not all(isinstance(region, MapClass) for region in self.classes):
            raise InvalidInputError(
                f"map: classes: got {shown(self.classes)}, expected a sequence of MapClasses"
            )
        object.__setattr__(self, "classes", tuple(self.classes))
        names = [region.name for region in self.classes]
        if not names or len(set(names)) < len(names):
            raise InvalidInputError(
                f"map: got classes named {names}, expected one or more, all different"
            )
        if self.source is not None:
            records.check_mapping("map: source", self.source)
        if not isinstance(self.grid, Grid):
            raise InvalidInputError(f"map: grid: got {shown(self.grid)}, expected a Grid")
        for region in self.classes:
            if region.cells.shape != self.grid.shape:
                raise InvalidInputError(
                    f"map class {region.name!r}: got cells of the shape {region.cells.shape}, "
                    f"expected {self.grid.shape} as the grid's"
                )

    @classmethod
    def load(
        cls,
        file: str | Path,
        masks: Mapping[str, int | Mapping[str, object]] | None = None,
        *,
        rank: int = 1,
        unknown: int | None = 1,
        margin: float = 0.0,
    ) -> Self:
        """Read a map of Nav2 with masks, which may have other grids than the map.

        A cell that was never seen is unknown, whatever the thresholds of the file. The numbers of
        free, occupied and unknown cells are logged.

        Args:
            file: the map server's YAML file.
            masks: YAML file of a mask → its rank as a keepout, or its fields: "rank", "kind",
                "name", "margin", and for the kind "speed" either "limit" [m/s], or "base" and
                "multiplier" [m/s]. As in Nav2, a cell's limit is base + multiplier · occupancy,
                and none where that is not positive. Relative paths are relative to the map's.
            rank: of the map's occupied cells, the class "occupied".
            unknown: rank of the unknown cells and of all outside the grid, the class "unknown";
                None makes them free.
            margin: reserved around both classes [m].

        Raises:
            InvalidInputError: if a file cannot be read, a field is missing, unknown or out of
                range, or every cell is strict.
        """
        masks = {} if masks is None else masks
        return cls(*reading.read(file, masks, rank, unknown, margin))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Return the map of a dict that `to_dict` wrote, or that has the arguments of `load`.

        Raises:
            InvalidInputError: if a key is missing or unknown, or a value is malformed.
        """
        records.check_mapping("map", data)
        if "file" in data:
            check_options("map", data, ("file", "masks", *reading.DEFAULTS))
            return cls.load(**data)
        return cls(*packing.unpacked(data))

    def to_dict(self) -> dict[str, object]:
        """Return the map as a plain dict that `from_dict` reads and JSON can hold."""
        if self.source is not None:
            return records.plain(self.source)
        return packing.packed(self.grid, self.classes)

    def __eq__(self, other: object) -> bool:
        """Return whether two maps are described by equal dicts."""
        if not isinstance(other, RankedMap):
            return NotImplemented
        return self is other or self.to_dict() == other.to_dict()

    __hash__ = object.__hash__

    @cached_property
    def covers(self) -> tuple[Cover, ...]:
        """The covers of the classes, in their order."""
        return tuple(Cover.of(region.cells) for region in self.classes)

    @property
    def conditions(self) -> tuple[MappedRegion | MappedZone, ...]:
        """The barriers of the classes, in their order."""
        return self._conditions

    @cached_property
    def _conditions(self) -> tuple[MappedRegion | MappedZone, ...]:
        return tuple(map(self._condition, self.classes, self.covers))

    @cached_property
    def _pieces_in_grid(self) -> tuple[Pieces, ...]:
        """The pieces of each class, without those of all outside the grid."""
        barriers = zip(self.classes, self.covers, self.conditions, strict=True)
        return tuple(
            self._pieces(cover) if region.kind == "unknown" else barrier.pieces
            for region, cover, barrier in barriers
        )

    def polygons(self, name: str) -> list[Array]:
        """Return the corners (k, 2) of the convex pieces that cover a class's cells [m]."""
        indices = {region.name: k for k, region in enumerate(self.classes)}
        k = choose("map class", name, indices)
        return self.conditions[k].pieces.polygons[: len(self.covers[k].sizes)]

    def outlines(self, region: MapClass, covered: bool = False) -> list[Array]:
        """Return the corners (k, 2) of rectangles of a class's cells, or of its pieces [m]."""
        if covered:
            return self.polygons(region.name)
        return [self.grid.to_world(box) for box in boxes(region.cells)]

    def distance(self, points: ArrayLike, rank: int | None = None) -> Array:
        """Return the distances (N,) of points from the pieces over keepout and unknown cells [m].

        They never exceed the true distances, and are negative inside a piece. All outside the grid
        is left out here.

        Args:
            points: (N, 2) [m].
            rank: only classes of this rank count; None for all.

        Raises:
            InvalidInputError: if the points are not finite.
        """
        places = finite_array("points", points, (None, 2), largest=FARTHEST)
        rank = None if rank is None else count("rank", rank)
        least, distance = np.full(len(places), np.inf), np.empty(len(places))
        for region, pieces in zip(self.classes, self._pieces_in_grid, strict=True):
            if region.kind != "speed" and rank in (None, region.rank):
                _core.pieces_distances(pieces.packed, 0, places, distance)
                np.minimum(least, distance, out=least)
        return least

    def update(self, corner: tuple[int, int], cells: Mapping[str, ArrayLike]) -> "RankedMap":
        """Return the map with a window of cells replaced; only pieces near it are computed anew.

        Args:
            corner: lowest row and column of the window.
            cells: class name → (h, w) truth values; the other classes stay.

        Raises:
            InvalidInputError: if there is no such class, or the window leaves the grid.
        """
        indices = {region.name: k for k, region in enumerate(self.classes)}
        records.check_mapping("map update: cells", cells)
        check_options("map update: classes", cells, indices)
        classes, covers = list(self.classes), list(self.covers)
        conditions = list(self.conditions)
        for name, values in cells.items():
            k = indices[name]
            window = as_array(f"map update: {name}", values)
            row, column = _checked_corner(corner, window, self.grid)
            end_row, end_column = row + window.shape[0], column + window.shape[1]
            changed_cells = classes[k].cells.copy()
            if np.array_equal(changed_cells[row:end_row, column:end_column], window):
                continue
            changed_cells[row:end_row, column:end_column] = window
            classes[k] = replace(classes[k], cells=changed_cells)
            covers[k] = covers[k].after(changed_cells, (row, column, end_row, end_column))
            conditions[k] = self._condition(classes[k], covers[k])
        changed = RankedMap(self.grid, tuple(classes))
        vars(changed).update(covers=tuple(covers), _conditions=tuple(conditions))
        return changed

    def _condition(self, region: MapClass, cover: Cover) -> MappedRegion | MappedZone:
        """Return the barrier of a class."""
        is_unknown = region.kind == "unknown"
        pieces = self._pieces(cover, with_outside=is_unknown)
        fields: dict[str, Any] = {"pieces": pieces, "margin": region.margin}
        fields |= {"grid": self.grid, "cells": region.cells}
        if region.limit is not None:
            return MappedZone(region.name, region.rank, limit=region.limit, **fields)
        return MappedRegion(region.name, region.rank, beyond=is_unknown, **fields)

    def _pieces(self, cover: Cover, *, with_outside: bool = False) -> Pieces:
        """Return the pieces of a cover in the world, followed by those outside the grid."""
        corners, sizes = cover.grown(), cover.sizes
        if with_outside:
            corners = np.concatenate([corners, self._outside])
            sizes = np.concatenate([sizes, np.full(4, 4)])
        world = self.grid.to_world(corners.reshape(-1, 2)).reshape(corners.shape)
        return Pieces(world, sizes, self.grid.origin, around=4 if with_outside else 0)

    @property
    def _outside(self) -> Array:
        """(4, 8, 2) columns and rows of four rectangles around the grid, beyond `FARTHEST`."""
        (rows, columns), far = self.grid.shape, 4.0 * FARTHEST / self.grid.resolution
        right, top = columns + far, rows + far
        left_and_right = [(-far, -far, 0.0, top), (columns, -far, right, top)]
        below_and_above = [(-far, -far, right, 0.0), (-far, rows, right, top)]
        rectangles = np.array(left_and_right + below_and_above)
        corners = np.zeros((4, 8, 2))
        corners[:, :4, 0] = rectangles[:, [0, 2, 2, 0]]
        corners[:, :4, 1] = rectangles[:, [1, 1, 3, 3]]
        return corners


def _checked_corner(corner: Any, window: NDArray[Any], grid: Grid) -> tuple[int, int]:
    """Return the lowest row and column of a window, or refuse one that is not in the grid."""
    is_cell = isinstance(corner, tuple | list) and len(corner) == 2
    is_cell = is_cell and all(
        isinstance(n, int | np.integer) and not isinstance(n, bool) and n >= 0 for n in corner
    )
    if not is_cell or window.ndim != 2 or window.dtype != np.bool_:
        raise InvalidInputError(
            f"map update: got {window.dtype} of the shape {window.shape} at {shown(corner)}, "
            "expected truth values (h, w) at a row and a column"
        )
    row, column = int(corner[0]), int(corner[1])
    if row + window.shape[0] > grid.shape[0] or column + window.shape[1] > grid.shape[1]:
        raise InvalidInputError(
            f"map update: got a window of {window.shape} cells at {(row, column)}, expected it "
            f"within the {grid.shape} cells of the map"
        )
    return row, column
