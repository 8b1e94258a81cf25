"""The ground of a map: painted once, and repainted where its cells change."""

from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Mask
from hcbf_gym.barriers.mapped import MappedRegion
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.guidance.field import Ground, geometry_of, open_ground
from hcbf_gym.models.grid import Grid


class Window(NamedTuple):
    """A rectangle of the ground's cells; indices count the border."""

    first_row: int
    end_row: int  # one above the last row
    first_column: int
    end_column: int


class MapGround:
    """The ground of a map's regions; its speed zones are open.

    A cell is in a region where its centre is nearer to the occupied squares than the clearance and
    the class's own margin. Classes of one rank and one clearance are painted together.

    Args:
        regions: the classes of one map.
        clearance: the distance that edges reserve besides the margins of their classes [m].
        opened: the lowest rank that may be crossed at its price, above 1; 0 if none may.
        before: a ground of the same grid, from which unchanged cells are copied; None for none.

    Raises:
        InvalidInputError: if the classes have different grids.

    Attributes:
        ground: cost and rank of the cells, without the scene's other barriers.
        geometry: (7,) of its grid, see `guidance.field`.
    """

    def __init__(
        self,
        regions: tuple[MappedRegion, ...],
        clearance: float,
        opened: int,
        before: "MapGround | None" = None,
    ):
        self.regions, self.clearance, self.opened = regions, clearance, opened
        self.grid = _grid_of(regions)
        self.geometry = geometry_of(self.grid)
        self._layers = self._layers_of(regions)
        rows, columns = self.grid.shape
        if before is None:
            self.ground = open_ground(rows, columns, self.grid.resolution)
            self._paint(Window(1, rows + 1, 1, columns + 1))
            return
        self.ground = before.ground
        window = self._window_changed_since(before)
        if window is not None:
            self.ground = Ground(before.ground.cost.copy(), before.ground.rank.copy())
            self._paint(window)

    def with_regions(self, regions: tuple[MappedRegion, ...]) -> "MapGround":
        """Return the ground of another map on the same grid, repainted where cells differ.

        Raises:
            InvalidInputError: if the other map has another grid.
        """
        if _grid_of(regions) != self.grid:
            raise InvalidInputError(
                f"guidance: got a map of {_grid_of(regions)} in an episode on {self.grid}, "
                "expected the same grid until the next reset"
            )
        return MapGround(regions, self.clearance, self.opened, before=self)

    def _window_changed_since(self, before: "MapGround") -> Window | None:
        """Return the rows and columns whose paint may differ from before; None if no cell does."""
        layers = before._layers.keys() | self._layers.keys()
        empty = np.zeros_like(self.ground.rank, dtype=np.bool_)
        changed = empty.copy()
        for layer in layers:
            changed |= before._layers.get(layer, empty) != self._layers.get(layer, empty)
        if not changed.any():
            return None
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        # how far a cell raises costs; 2: distances are from its edge, and the cast rounds down
        farthest = max(clearance for _, clearance in layers)
        reach = int((farthest + _core.GROUND_HALO) / self.grid.resolution) + 2
        return Window(
            max(1, int(rows[0]) - reach),
            min(changed.shape[0] - 1, int(rows[-1]) + 1 + reach),
            max(1, int(columns[0]) - reach),
            min(changed.shape[1] - 1, int(columns[-1]) + 1 + reach),
        )

    def name_at(self, j: int, i: int, rank: int) -> str:
        """Return the name of the nearest region of a rank that covers row j and column i."""
        nearest, name = np.inf, "a barrier"
        for region in self.regions:
            cells = np.argwhere(_bordered(region)) - 1  # without the border
            if region.priority != rank or len(cells) == 0:
                continue
            distance = np.abs(cells - (j, i)).max(axis=1).min()  # in cells
            reach = (region.margin + self.clearance) / self.grid.resolution + 1.0
            if distance < nearest and distance <= reach:
                nearest, name = distance, repr(region.name)
        return name

    def _layers_of(self, regions: tuple[MappedRegion, ...]) -> dict[tuple[int, float], Mask]:
        """Return (rank, clearance) → (rows + 2, columns + 2) the cells of classes with both."""
        layers: dict[tuple[int, float], Mask] = {}
        for region in regions:
            layer, cells = (region.priority, region.margin + self.clearance), _bordered(region)
            layers[layer] = layers[layer] | cells if layer in layers else cells
        return layers

    def _paint(self, window: Window) -> None:
        """Paint a window of the ground anew: open cells first, then the layers over them."""
        side = self.grid.resolution
        rows = slice(window.first_row, window.end_row)
        columns = slice(window.first_column, window.end_column)
        self.ground.cost[rows, columns] = side
        self.ground.rank[rows, columns] = 0
        for (rank, clearance), cells in self._layers.items():
            _core.paint_cells(*self.ground, window, cells, side, rank, clearance, self.opened)


def _bordered(region: MappedRegion) -> Mask:
    """Return (rows + 2, columns + 2) the cells of a class; the border is in it if `beyond` is."""
    return np.pad(region.cells, 1, constant_values=region.beyond)


def _grid_of(regions: tuple[MappedRegion, ...]) -> Grid:
    """Return the grid that all classes share; refuse classes of different grids."""
    grid = regions[0].grid
    for region in regions:
        if region.grid != grid:
            raise InvalidInputError(
                f"guidance: got classes of {grid} and of {region.grid} in one scene, expected one "
                "map"
            )
    return grid
