"""Maps in scenes and pictures; a package of maps registers its class and reader."""

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
        grid: its place and cells.
        classes: its regions in the order of the conditions, each with a `rank` and a `limit`, the
            speed inside of a speed zone [m/s] or None.
    """

    grid: Grid
    classes: Any

    @abstractmethod
    def outlines(self, region: Any, covered: bool = False) -> list[Array]:
        """Return the corners (k, 2) of what a region occupies, or of what covers it [m]."""

    @abstractmethod
    def to_dict(self) -> dict[str, object]:
        """Return it as a plain dict that its reader reads and JSON can hold."""


class Floors(NamedTuple):
    """How a package of maps reads and uses them."""

    read: Callable[[Mapping[str, Any]], Floor]  # the same map for the same dict
    draw: Callable[[Any, np.random.Generator, Array, Array], None]
    """(map, generator, start (2,), goal (2,)) fills start and goal of a path through it [m]."""


_FLOORS: list[Floors] = []


def register_floors(read: Callable[[Mapping[str, Any]], Floor], draw: Callable[..., None]) -> None:
    """Let scenes have maps, with a reader and a drawer as in `Floors`."""
    _FLOORS[:] = [Floors(read, draw)]


def floors() -> Floors:
    """Return how maps are read and used."""
    if not _FLOORS:
        plugins.load()
    if not _FLOORS:
        raise InvalidInputError(
            "map: got one, expected the package hcbf_robots, which reads maps, to be installed"
        )
    return _FLOORS[0]


def name_of(data: Mapping[str, Any]) -> str:
    """Return the name of a scene in a described map: its file's name without the ending."""
    return Path(str(data.get("file", "map"))).stem
