"""Random clutter: 15 to 25 overlapping regions of three ranks around a winding, free path.

The path is drawn first, a line through six points across the hall; every region leaves `CLEAR` to
it. So a path that enters nothing exists by construction, mostly far from the straight line.
"""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.scenarios import hall
from hcbf_gym.scenarios.scene import RADIUS, Scene, X, Y

CLEAR = 0.45  # least distance between the free path and any region or wall [m]
CLEAR_ENDS = 0.8  # the same at the start and at the goal [m]
MAX_REGIONS = 25  # regions of the shipped family, in play or not
MIN_SHARE = 0.6  # least share of a scene's regions that is in play

_BENDS = 4  # points of the path between start and goal
_TRIES = 12  # places that are drawn for a region: it gets the first with room, or the roomiest
_SMALLEST = 0.3  # a place leaves room where the circumradius need not be smaller [m]
_NUMBERS_PER_REGION = 4 + 2 * _TRIES


def draw(generator: np.random.Generator, scene: Scene) -> None:
    """Fill a scene of two walls and 3 regions or more; equally many take equally many numbers."""
    hall.check_count(scene, hall.WALLS + 3)
    ranks = scene.ranks[hall.WALLS :]
    max_regions = len(ranks)
    ranks[:] = 1 + np.arange(max_regions) % 3
    numbers = generator.random(4 + _BENDS + max_regions * _NUMBERS_PER_REGION)
    (by_width, by_length, by_goal, by_count), bends, chances = np.split(numbers, (4, 4 + _BENDS))
    half_width, length = 2.6 + 0.4 * by_width, 9.0 + 1.0 * by_length
    scene.goal[:] = length, 1.2 * (2.0 * by_goal - 1.0)
    min_regions = round(MIN_SHARE * max_regions)
    count = min_regions + int((max_regions - min_regions + 1) * by_count)
    path = _winding_path(bends, half_width, scene.goal)
    regions = hall.build(scene, length, half_width)
    for region, chance in zip(regions[:count], chances.reshape(max_regions, -1), strict=False):
        size, kind, turn, form, *places = chance.tolist()
        room = _put(region, places, path, half_width, scene.goal)
        region[RADIUS] = max(0.05, min(0.35 + 0.55 * size, room))
        hall.shape(region, kind, turn, form)


def _winding_path(bends: Array, half_width: float, goal: Array) -> Array:
    """Return the path (k, 2) from the origin to the goal, with random bends across the hall [m]."""
    path = np.zeros((_BENDS + 2, 2))
    for k in range(1, _BENDS + 1):
        path[k, 0] = goal[0] * k / (_BENDS + 1)
        across = 2.0 * bends[k - 1] - 1.0
        # at least 0.3 to one side: never on the straight line
        path[k, 1] = (half_width - CLEAR) * (0.7 * across + 0.3 * np.sign(across))
    path[-1] = goal
    return path


def _put(region: Array, places: list[float], path: Array, half_width: float, goal: Array) -> float:
    """Write the centre of a region; return the greatest circumradius that it may have there [m].

    Two random numbers decide each of `_TRIES` places around the line to the goal.
    """
    roomiest = -np.inf
    for attempt in range(_TRIES):
        x = goal[0] * places[2 * attempt]
        across = 2.0 * places[2 * attempt + 1] - 1.0
        y = goal[1] * x / goal[0] + 0.7 * half_width * across
        room = hall.room_beside(path, x, y, CLEAR, CLEAR_ENDS)
        if room > roomiest:
            region[X], region[Y], roomiest = x, y, room
        if roomiest >= _SMALLEST:
            break
    return roomiest
