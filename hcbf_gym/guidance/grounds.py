"""The ground of a map: painted once, and repainted where its cells change."""

from copy import copy

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.errors import InvalidInputError
from hcbf_gym.guidance.ground import HALO, Ground, open_ground, paint_cells
from hcbf_gym.maps import RankedMap

Array = NDArray[np.float64]
Window = tuple[int, int, int, int]


class MapGround:
    """What a field walks on where a map lies.

    Classes of one rank and one clearance are painted together. Speed zones are open ground.

    Args:
        ranked_map: whose cells are painted.
        clearance: what edges keep besides the margins of their classes [m].
        opened: ranks from it on may be crossed at their price, above 1; 0 for none.

    Attributes:
        ground: of the map alone, without barriers beside it.
        geometry: (7,) of its grid, see `guidance.field`.
    """

    def __init__(self, ranked_map: RankedMap, clearance: float, opened: int):
        grid = ranked_map.grid
        self.clearance, self.opened = clearance, opened
        self.geometry = geometry_of_grid(ranked_map)
        self.ground = open_ground(*grid.shape, grid.resolution)
        self.ranked_map = ranked_map
        self._layers = self._layers_of(ranked_map)
        self._paint((0, grid.shape[0], 0, grid.shape[1]))

    def with_map(self, ranked_map: RankedMap) -> "MapGround":
        """Return the ground of a map of the same grid, repainted where its cells are others.

        Raises:
            InvalidInputError: if the grid is another one.
        """
        if ranked_map.grid != self.ranked_map.grid:
            raise InvalidInputError(
                f"guidance: got a map of {ranked_map.grid} in an episode on "
                f"{self.ranked_map.grid}, expected the same grid until the next reset"
            )
        other = copy(self)
        other.ranked_map, other._layers = ranked_map, self._layers_of(ranked_map)
        keys = self._layers.keys() | other._layers.keys()
        empty = np.zeros(ranked_map.grid.shape, dtype=np.bool_)
        changed = empty.copy()
        for key in keys:
            changed |= self._layers.get(key, empty) != other._layers.get(key, empty)
        if not changed.any():
            return other
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        farthest = max(clearance for _, clearance in keys)
        reach = int((farthest + HALO) / ranked_map.grid.resolution) + 2
        window = (
            max(0, int(rows[0]) - reach),
            min(changed.shape[0], int(rows[-1]) + 1 + reach),
            max(0, int(columns[0]) - reach),
            min(changed.shape[1], int(columns[-1]) + 1 + reach),
        )
        other.ground = Ground(self.ground.cost.copy(), self.ground.rank.copy())
        other._paint(window)
        return other

    def name_at(self, j: int, i: int, rank: int) -> str:
        """Return what a message calls a region of a rank at a cell: its class's name if it has one.

        Args:
            j: row.
            i: column.
            rank: of the region.
        """
        nearest, name = np.inf, "a barrier"
        for one in self.ranked_map.classes:
            if one.rank == rank and one.kind != "speed" and one.cells.any():
                apart = np.abs(np.argwhere(one.cells) - (j, i)).max(axis=1).min()
                within = (one.margin + self.clearance) / self.ranked_map.grid.resolution + 1.0
                if apart < nearest and apart <= within:
                    nearest, name = apart, repr(one.name)
        return name

    def _layers_of(self, ranked_map: RankedMap) -> dict[tuple[int, float], NDArray[np.bool_]]:
        """Return rank and clearance → (rows, columns) the cells that have both."""
        layers: dict[tuple[int, float], NDArray[np.bool_]] = {}
        for one in ranked_map.classes:
            if one.kind != "speed":
                key = one.rank, one.margin + self.clearance
                layers[key] = layers[key] | one.cells if key in layers else one.cells
        return layers

    def _paint(self, window: Window) -> None:
        """Paint a window anew."""
        side = float(self.geometry[2])
        inner = slice(window[0] + 1, window[1] + 1), slice(window[2] + 1, window[3] + 1)
        self.ground.cost[inner] = side
        self.ground.rank[inner] = 0
        for (rank, kept), cells in self._layers.items():
            paint_cells(self.ground, window, cells, side, rank, kept, self.opened)


def geometry_of_grid(ranked_map: RankedMap) -> Array:
    """Return (7,) x and y of the first cell's centre, side [m], ny, nx, cos and sin of the yaw."""
    grid = ranked_map.grid
    first = grid.to_world([[0.5, 0.5]])[0]
    return np.array([*first, grid.resolution, *grid.shape, *grid.axes[:, 0]])
