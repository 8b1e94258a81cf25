"""Which classes of a map are relaxed in a conflict, and where they are nearest."""

from collections.abc import Iterator
from typing import NamedTuple

from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.errors import finite_array, instance, reals
from hcbf_gym.models.constants import FARTHEST
from hcbf_robots.maps.ranked_map import RankedMap


class Paying(NamedTuple):
    """A class of a map that is relaxed.

    Attributes:
        name: of the class.
        place: (2,) the point of its nearest piece that is nearest the robot [m].
        slack: by how much its row is violated.
    """

    name: str
    place: Array
    slack: float


def paying(ranked: RankedMap, x: ArrayLike, slack: ArrayLike) -> Iterator[Paying]:
    """Yield the classes that are relaxed at a state, in their order, and where.

    Args:
        ranked: the map.
        x: position first [m].
        slack: (m,) of the map's classes, as ``info["safety_filter"]`` has them.

    Raises:
        InvalidInputError: if the slack is not of the map's classes.
    """
    instance("ranked", ranked, RankedMap)
    state = reals("x", x)
    at = finite_array("x", state[:2] if state.ndim == 1 else state, (2,), largest=FARTHEST)
    given = finite_array("slack", slack, (len(ranked.classes),))
    for barrier, paid in zip(ranked.conditions, given.tolist(), strict=True):
        if paid > 0.0:
            distance, normal = barrier.nearest(at)
            yield Paying(barrier.name, at - max(distance, 0.0) * normal, paid)
