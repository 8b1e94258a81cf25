"""The ground of a map: painted once, and repainted where its cells change."""

from copy import copy

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Mask
from hcbf_gym.barriers.mapped import MappedRegion
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.guidance.field import Ground, geometry_of, open_ground
from hcbf_gym.models.grid import Grid

Window = tuple[int, int, int, int]


class MapGround:
    """The ground of a map's regions; its speed zones are open.

    A cell is in a region where its centre is nearer to the occupied squares than the clearance and
    the class's own margin. Classes of one rank and one clearance are painted together.

    Args:
        regions: the classes of one map.
        clearance: what edges reserve besides the margins of their classes [m].
        opened: ranks from it on may be crossed at their price, above 1; 0 for none.

    Raises:
        InvalidInputError: if the classes have different grids.

    Attributes:
        ground: of the map alone, without barriers beside it.
        geometry: (7,) of its grid, see `guidance.field`.
    """

    def __init__(self, regions: tuple[MappedRegion, ...], clearance: float, opened: int):
        self.clearance, self.opened = clearance, opened
        self.grid = _grid_of(regions)
        self.geometry = geometry_of(self.grid)
        self.ground = open_ground(*self.grid.shape, self.grid.resolution)
        self.regions = regions
        self._layers = self._layers_of(regions)
        rows, columns = self.grid.shape
        self._paint((1, rows + 1, 1, columns + 1))

    def with_regions(self, regions: tuple[MappedRegion, ...]) -> "MapGround":
        """Return the ground of a map of the same grid, repainted where its cells are others.

        Raises:
            InvalidInputError: if the grid is another one.
        """
        if _grid_of(regions) != self.grid:
            raise InvalidInputError(
                f"guidance: got a map of {_grid_of(regions)} in an episode on {self.grid}, "
                "expected the same grid until the next reset"
            )
        other = copy(self)
        other.regions, other._layers = regions, self._layers_of(regions)
        keys = self._layers.keys() | other._layers.keys()
        empty = np.zeros_like(self.ground.rank, dtype=np.bool_)
        changed = empty.copy()
        for key in keys:
            changed |= self._layers.get(key, empty) != other._layers.get(key, empty)
        if not changed.any():
            return other
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        farthest = max(clearance for _, clearance in keys)
        reach = int((farthest + _core.GROUND_HALO) / self.grid.resolution) + 2
        window = (
            max(1, int(rows[0]) - reach),
            min(changed.shape[0] - 1, int(rows[-1]) + 1 + reach),
            max(1, int(columns[0]) - reach),
            min(changed.shape[1] - 1, int(columns[-1]) + 1 + reach),
        )
        other.ground = Ground(self.ground.cost.copy(), self.ground.rank.copy())
        other._paint(window)
        return other

    def name_at(self, j: int, i: int, rank: int) -> str:
        """Return what a message calls a region of a rank at row j and column i."""
        nearest, name = np.inf, "a barrier"
        for one in self.regions:
            places = np.argwhere(_bordered(one)) - 1
            if one.priority != rank or len(places) == 0:
                continue
            apart = np.abs(places - (j, i)).max(axis=1).min()
            within = (one.margin + self.clearance) / self.grid.resolution + 1.0
            if apart < nearest and apart <= within:
                nearest, name = apart, repr(one.name)
        return name

    def _layers_of(self, regions: tuple[MappedRegion, ...]) -> dict[tuple[int, float], Mask]:
        """Return rank and clearance → (rows + 2, columns + 2) the cells that have both."""
        layers: dict[tuple[int, float], Mask] = {}
        for one in regions:
            key, cells = (one.priority, one.margin + self.clearance), _bordered(one)
            layers[key] = layers[key] | cells if key in layers else cells
        return layers

    def _paint(self, window: Window) -> None:
        """Paint a window of the ground anew."""
        side = float(self.geometry[2])
        inner = slice(window[0], window[1]), slice(window[2], window[3])
        self.ground.cost[inner] = side
        self.ground.rank[inner] = 0
        for (rank, kept), cells in self._layers.items():
            _core.paint_cells(*self.ground, window, cells, side, rank, kept, self.opened)


def _bordered(one: MappedRegion) -> Mask:
    """Return (rows + 2, columns + 2) the cells of a class; the border is what is around."""
    return np.pad(one.cells, 1, constant_values=one.beyond)


def _grid_of(regions: tuple[MappedRegion, ...]) -> Grid:
    """Return the one grid of all classes.

    Raises:
        InvalidInputError: if there are several.
    """
    grid = regions[0].grid
    for one in regions:
        if one.grid != grid:
            raise InvalidInputError(
                f"guidance: got classes of {grid} and of {one.grid} in one scene, expected one map"
            )
    return grid
