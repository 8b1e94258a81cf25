"""A map with ranks: what a robot may not enter, and what it may cross if it must."""

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
    """Cells of a grid in classes, each with its rank. It never changes: `update` returns another.

    In a list of barriers it is one condition a class, in the order of the classes. All outside the
    grid belongs to a class of the kind "unknown", and is free where there is none.

    Args:
        grid: where the cells lie.
        classes: what cells mean; a cell may be of several classes.
        source: the files that it was read from, as `from_dict` takes them; None for arrays.

    Raises:
        InvalidInputError: if two classes share a name, or cells are not of the grid's shape.

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
        listed = isinstance(self.classes, Sequence) and not isinstance(self.classes, str)
        if not listed or not all(isinstance(one, MapClass) for one in self.classes):
            raise InvalidInputError(
                f"map: classes: got {shown(self.classes)}, expected a sequence of MapClasses"
            )
        object.__setattr__(self, "classes", tuple(self.classes))
        names = [one.name for one in self.classes]
        if not names or len(set(names)) < len(names):
            raise InvalidInputError(
                f"map: got classes named {names}, expected one or more, all different"
            )
        if self.source is not None:
            records.check_mapping("map: source", self.source)
        if not isinstance(self.grid, Grid):
            raise InvalidInputError(f"map: grid: got {shown(self.grid)}, expected a Grid")
        for one in self.classes:
            if one.cells.shape != self.grid.shape:
                raise InvalidInputError(
                    f"map class {one.name!r}: got cells of the shape {one.cells.shape}, "
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
        """Read a map of Nav2, and masks, which are looked up by position as Nav2 does.

        A cell that was never seen is unknown, whatever the thresholds of the file. How many cells
        are free, occupied and unknown is logged.

        Args:
            file: YAML of the map server.
            masks: YAML of a mask → its rank as a keepout, or its fields: "rank", "kind", "name",
                "margin", and for the kind "speed" either "limit" [m/s], or "base" and "multiplier"
                [m/s]: as in Nav2, a cell's limit is base + multiplier · occupancy, and none where
                that is not positive. Paths are those beside the map unless they are absolute.
            rank: of the map's occupied cells, the class "occupied".
            unknown: rank of the cells of which nothing is known and of all outside the grid, the
                class "unknown"; None makes them free.
            margin: reserved around both [m].

        Raises:
            InvalidInputError: if a file cannot be read, a field is missing, unknown or out of
                range, or every cell is strict.
        """
        masks = {} if masks is None else masks
        grid, classes = reading.read(file, masks, rank, unknown, margin)
        return cls(grid, classes, reading.source(file, masks, rank, unknown, margin))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Return the map that `to_dict` described, or that `load` reads from {"file": …, …}.

        Raises:
            InvalidInputError: if it describes none.
        """
        records.check_mapping("map", data)
        if "file" in data:
            check_options("map", data, ("file", "masks", *reading.USUAL))
            return cls.load(**data)
        return cls(*packing.unpacked(data))

    def to_dict(self) -> dict[str, object]:
        """Return the map as a plain dict that `from_dict` reads and JSON can hold."""
        if self.source is not None:
            return records.plain(self.source)
        return packing.packed(self.grid, self.classes)

    def __eq__(self, other: object) -> bool:
        """Return whether two maps are described alike."""
        if not isinstance(other, RankedMap):
            return NotImplemented
        return self is other or self.to_dict() == other.to_dict()

    __hash__ = object.__hash__

    @cached_property
    def covers(self) -> tuple[Cover, ...]:
        """What covers each class, in the order of the classes."""
        return tuple(Cover.of(one.cells) for one in self.classes)

    @property
    def conditions(self) -> tuple[MappedRegion | MappedZone, ...]:
        """A barrier for each class, in the order of the classes."""
        return self._conditions

    @cached_property
    def _conditions(self) -> tuple[MappedRegion | MappedZone, ...]:
        return tuple(
            self._condition(one, cover)
            for one, cover in zip(self.classes, self.covers, strict=True)
        )

    @cached_property
    def _cells(self) -> tuple[Pieces, ...]:
        """What covers the cells of each class, and nothing outside the grid."""
        found = []
        for one, cover, barrier in zip(self.classes, self.covers, self._conditions, strict=True):
            outside = one.kind == "unknown"
            found.append(self._pieces(cover, outside=False) if outside else barrier.pieces)
        return tuple(found)

    def polygons(self, name: str) -> list[Array]:
        """Return the corners (k, 2) of the convex pieces that cover a class's cells [m]."""
        barrier = choose("map class", name, {one.name: one for one in self._conditions})
        covers = {one.name: cover for one, cover in zip(self.classes, self.covers, strict=True)}
        return barrier.pieces.polygons[: len(covers[name].sizes)]

    def outlines(self, region: MapClass, covered: bool = False) -> list[Array]:
        """Return the corners (k, 2) of rectangles of a class's cells, or of its pieces [m]."""
        if covered:
            return self.polygons(region.name)
        return [self.grid.to_world(box) for box in boxes(region.cells)]

    def distance(self, points: ArrayLike, rank: int | None = None) -> Array:
        """Return (N,) the covered distance of points from keepout and unknown cells [m].

        It never exceeds the true distance; inside a piece it is negative. What lies outside the
        grid does not count here.

        Args:
            points: (N, 2) [m].
            rank: of the classes that count; None for all.

        Raises:
            InvalidInputError: if the points are not finite.
        """
        at = finite_array("points", points, (None, 2), largest=FARTHEST)
        rank = None if rank is None else count("rank", rank)
        least, distance = np.full(len(at), np.inf), np.empty(len(at))
        for one, cells in zip(self.classes, self._cells, strict=True):
            if one.kind != "speed" and rank in (None, one.rank):
                _core.pieces_distances(cells.packed, 0, at, distance)
                np.minimum(least, distance, out=least)
        return least

    def update(self, corner: tuple[int, int], cells: Mapping[str, ArrayLike]) -> "RankedMap":
        """Return the map with a window of cells replaced; only what is near it is covered anew.

        Args:
            corner: lowest row and column of the window.
            cells: class name → (h, w) truth values; the other classes stay.

        Raises:
            InvalidInputError: if there is no such class, or the window leaves the grid.
        """
        known = {one.name: k for k, one in enumerate(self.classes)}
        records.check_mapping("map update: cells", cells)
        check_options("map update: classes", cells, known)
        classes, covers = list(self.classes), list(self.covers)
        conditions = list(self._conditions)
        for name, values in cells.items():
            k = known[name]
            window = as_array(f"map update: {name}", values)
            r, c = _corner(corner, window, self.grid)
            h, w = window.shape
            now = classes[k].cells.copy()
            if np.array_equal(now[r : r + h, c : c + w], window):
                continue
            now[r : r + h, c : c + w] = window
            classes[k] = replace(classes[k], cells=now)
            covers[k] = covers[k].after(now, (r, c, r + h, c + w))
            conditions[k] = self._condition(classes[k], covers[k])
        changed = RankedMap(self.grid, tuple(classes))
        vars(changed).update(covers=tuple(covers), _conditions=tuple(conditions))
        return changed

    def _condition(self, one: MapClass, cover: Cover) -> MappedRegion | MappedZone:
        """Return the barrier of a class."""
        beyond = one.kind == "unknown"
        found = self._pieces(cover, outside=beyond)
        fields: dict[str, Any] = {"pieces": found, "margin": one.margin}
        fields |= {"grid": self.grid, "cells": one.cells}
        if one.limit is not None:
            return MappedZone(one.name, one.rank, limit=one.limit, **fields)
        return MappedRegion(one.name, one.rank, beyond=beyond, **fields)

    def _pieces(self, cover: Cover, *, outside: bool) -> Pieces:
        """Return what covers a class, and with it all that lies outside the grid, if it does."""
        corners, sizes = cover.grown(), cover.sizes
        if outside:
            corners = np.concatenate([corners, self._outside])
            sizes = np.concatenate([sizes, np.full(4, 4)])
        world = self.grid.to_world(corners.reshape(-1, 2)).reshape(corners.shape)
        return Pieces(world, sizes, self.grid.origin, around=4 if outside else 0)

    @property
    def _outside(self) -> Array:
        """(4, 8, 2) columns and rows of four rectangles around the grid, as far as anything is."""
        (rows, columns), far = self.grid.shape, 4.0 * FARTHEST / self.grid.resolution
        right, top = columns + far, rows + far
        left_of, right_of = (-far, -far, 0.0, top), (columns, -far, right, top)
        below, above = (-far, -far, right, 0.0), (-far, rows, right, top)
        found = np.zeros((4, 8, 2))
        for corners, (u0, v0, u1, v1) in zip(found, (left_of, right_of, below, above), strict=True):
            corners[:4] = (u0, v0), (u1, v0), (u1, v1), (u0, v1)
        return found


def _corner(corner: Any, window: NDArray[Any], grid: Grid) -> tuple[int, int]:
    """Return the lowest row and column of a window that lies in the grid."""
    sound = isinstance(corner, tuple | list) and len(corner) == 2
    sound = sound and all(
        isinstance(n, int | np.integer) and not isinstance(n, bool) and n >= 0 for n in corner
    )
    if not sound or window.ndim != 2 or window.dtype != np.bool_:
        raise InvalidInputError(
            f"map update: got {window.dtype} of the shape {window.shape} at {shown(corner)}, "
            "expected truth values (h, w) at a row and a column"
        )
    r, c = int(corner[0]), int(corner[1])
    rows, columns = grid.shape
    if r + window.shape[0] > rows or c + window.shape[1] > columns:
        raise InvalidInputError(
            f"map update: got a window of {window.shape} cells at {(r, c)}, expected it within "
            f"the {grid.shape} cells of the map"
        )
    return r, c
