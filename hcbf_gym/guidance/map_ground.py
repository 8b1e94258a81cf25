"""The ground of a map: painted once, and repainted where its cells change."""

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Mask
from hcbf_gym.barriers.mapped import MappedRegion
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.guidance.field import Ground, geometry_of, open_ground
from hcbf_gym.models.grid import Grid

Window = tuple[int, int, int, int]
"""First row, end of the rows, first column and end of the columns, the border counted."""


class MapGround:
    """The ground of a map's regions; its speed zones are open.

    A cell is in a region where its centre is nearer to the occupied squares than the clearance and
    the class's own margin. Classes of one rank and one clearance are painted together.

    Args:
        regions: the classes of one map.
        clearance: what edges reserve besides the margins of their classes [m].
        opened: ranks from it on may be crossed at their price, above 1; 0 for none.
        before: a ground of the same grid, of which unchanged cells are copied; None for none.

    Raises:
        InvalidInputError: if the classes have different grids.

    Attributes:
        ground: of the map alone, without barriers beside it.
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
            self._paint((1, rows + 1, 1, columns + 1))
            return
        self.ground = before.ground
        window = self._window_changed_since(before)
        if window is not None:
            self.ground = Ground(before.ground.cost.copy(), before.ground.rank.copy())
            self._paint(window)

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
        return MapGround(regions, self.clearance, self.opened, before=self)

    def _window_changed_since(self, before: "MapGround") -> Window | None:
        """Return the rows and columns whose paint may differ from before; None if no cell does."""
        keys = before._layers.keys() | self._layers.keys()
        empty = np.zeros_like(self.ground.rank, dtype=np.bool_)
        changed = empty.copy()
        for key in keys:
            changed |= before._layers.get(key, empty) != self._layers.get(key, empty)
        if not changed.any():
            return None
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        # how far a cell raises costs; 2: distances are from its edge, and the cast rounds down
        farthest = max(clearance for _, clearance in keys)
        reach = int((farthest + _core.GROUND_HALO) / self.grid.resolution) + 2
        return (
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
        """Return rank and clearance → (rows + 2, columns + 2) the occupied cells of both."""
        layers: dict[tuple[int, float], Mask] = {}
        for region in regions:
            key, cells = (region.priority, region.margin + self.clearance), _bordered(region)
            layers[key] = layers[key] | cells if key in layers else cells
        return layers

    def _paint(self, window: Window) -> None:
        """Paint a window of the ground anew, from the price of open cells on."""
        side = float(self.geometry[2])
        inner = slice(window[0], window[1]), slice(window[2], window[3])
        self.ground.cost[inner] = side
        self.ground.rank[inner] = 0
        for (rank, clearance), cells in self._layers.items():
            _core.paint_cells(*self.ground, window, cells, side, rank, clearance, self.opened)


def _bordered(region: MappedRegion) -> Mask:
    """Return (rows + 2, columns + 2) the cells of a class, and around them what is beyond."""
    return np.pad(region.cells, 1, constant_values=region.beyond)


def _grid_of(regions: tuple[MappedRegion, ...]) -> Grid:
    """Return the one grid of all classes.

    Raises:
        InvalidInputError: if there are several.
    """
    grid = regions[0].grid
    for region in regions:
        if region.grid != grid:
            raise InvalidInputError(
                f"guidance: got classes of {grid} and of {region.grid} in one scene, expected one "
                "map"
            )
    return grid
