"""Floor: the interface of maps in scenes and pictures, whose reader a package of maps registers."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import plugins
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.many import Several
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.grid import Grid


class Floor(Several):
    """A map of ranked regions, which scenes and pictures take.

    Attributes:
        grid: the map's origin, resolution and size.
        classes: the map's regions in the order of the conditions, each with a `rank` and a `limit`,
            the speed inside of a speed zone [m/s] or None.
    """

    grid: Grid
    classes: Any

    @abstractmethod
    def outlines(self, region: Any, covered: bool = False) -> list[Array]:
        """Return the outlines (k, 2) of a region's cells, or of the shapes that cover them [m]."""

    @abstractmethod
    def to_dict(self) -> dict[str, object]:
        """Return the map as a plain dict, which its reader reads and JSON can hold."""


class Floors(NamedTuple):
    """The functions by which scenes use a package of maps."""

    read: Callable[[Mapping[str, Any]], Floor]  # returns the same map for the same dict
    draw: Callable[[Any, np.random.Generator, Array, Array], None]
    """(map, generator, start (2,), goal (2,)) fills start and goal of a path through it [m]."""


_FLOORS: list[Floors] = []


def register_floors(read: Callable[[Mapping[str, Any]], Floor], draw: Callable[..., None]) -> None:
    """Register the functions by which scenes use maps; see `Floors`."""
    _FLOORS[:] = [Floors(read, draw)]


def floors() -> Floors:
    """Return the registered functions by which scenes use maps."""
    if not _FLOORS:
        plugins.load()
    if not _FLOORS:
        raise InvalidInputError(
            "map: got one, expected the package hcbf_robots, which reads maps, to be installed"
        )
    return _FLOORS[0]


def name_of(data: Mapping[str, Any]) -> str:
    """Return the name of a scene in the map of a plain dict: its file's name without ending."""
    return Path(str(data.get("file", "map"))).stem
