"""Lists the classes of a map that are relaxed in a conflict, and where the robot meets them."""

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
        name: the name of the class.
        place: (2,) the point of its pieces that is nearest to the robot [m].
        slack: the violation of its row.
    """

    name: str
    place: Array
    slack: float


def paying(ranked: RankedMap, x: ArrayLike, slack: ArrayLike) -> Iterator[Paying]:
    """Yield the classes that are relaxed at a state, in the order of the map's classes.

    Args:
        ranked: the map.
        x: (n,) the state, whose first two entries are the position [m].
        slack: (m,) of the map's classes, as ``info["safety_filter"]`` has them.

    Raises:
        InvalidInputError: if the slacks are not as many as the map's classes, or not finite.
    """
    instance("ranked", ranked, RankedMap)
    state = reals("x", x)
    position = state[:2] if state.ndim == 1 else state
    position = finite_array("x", position, (2,), largest=FARTHEST)
    slacks = finite_array("slack", slack, (len(ranked.classes),)).tolist()
    for barrier, violation in zip(ranked.conditions, slacks, strict=True):
        if violation > 0.0:
            distance, normal = barrier.nearest(position)
            yield Paying(barrier.name, position - max(distance, 0.0) * normal, violation)
