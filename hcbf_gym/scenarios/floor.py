"""What a map is to scenes and pictures; a package of maps brings its class and how it is read."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from hcbf_gym import plugins
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.grid import Grid


@runtime_checkable
class Region(Protocol):
    """A part of a map, as pictures show it."""

    @property
    def rank(self) -> int:
        """1 is the highest and strict."""
        ...

    @property
    def limit(self) -> float | None:
        """The speed inside of a speed zone [m/s]; None for a region."""
        ...


@runtime_checkable
class Floor(Protocol):
    """A map of ranked regions, which scenes and pictures take; `Several` in a list of barriers."""

    @property
    def grid(self) -> Grid:
        """Where it is."""
        ...

    @property
    def conditions(self) -> tuple[Barrier, ...]:
        """A barrier for each region."""
        ...

    @property
    def classes(self) -> Sequence[Region]:
        """Its regions, in the order of the conditions."""
        ...

    def outlines(self, region: Any, covered: bool = False) -> list[Array]:
        """Return the corners (k, 2) of what a region occupies, or of what covers it [m]."""
        ...

    def to_dict(self) -> dict[str, object]:
        """Return it as a plain dict that its reader reads and JSON can hold."""
        ...


class Floors(NamedTuple):
    """How a package of maps reads and uses them.

    Attributes:
        read: the dict of a map → the map, the same one for the same dict.
        draw: (map, generator, start (2,), goal (2,)) fills start and goal of a path through it [m].
    """

    read: Callable[[Mapping[str, Any]], Floor]
    draw: Callable[[Any, np.random.Generator, Array, Array], None]


_FLOORS: list[Floors] = []


def register_floors(read: Callable[[Mapping[str, Any]], Floor], draw: Callable[..., None]) -> None:
    """Let scenes have maps.

    Args:
        read: as `Floors` has it.
        draw: as `Floors` has it.
    """
    _FLOORS[:] = [Floors(read, draw)]


def floors() -> Floors:
    """Return how maps are read and used.

    Raises:
        InvalidInputError: if no package of maps is installed.
    """
    if not _FLOORS:
        plugins.load()
    if not _FLOORS:
        raise InvalidInputError(
            "map: got one, expected the package hcbf_robots, which reads maps, to be installed"
        )
    return _FLOORS[0]


def name_of(data: Mapping[str, Any]) -> str:
    """Return what a scene in a described map is called: its file's name without the ending."""
    return Path(str(data.get("file", "map"))).stem
