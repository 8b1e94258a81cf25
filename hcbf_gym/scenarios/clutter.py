"""Random clutter: 15 to 25 overlapping regions of three ranks around a winding, free path.

The path is drawn first, a line through six points across the hall; every region leaves `CLEAR` to
it. So a path that enters nothing exists by construction, mostly far from the straight line.
"""

import numpy as np

from hcbf_gym.scenarios import hall
from hcbf_gym.scenarios.scene import RADIUS, Scene, X, Y

CLEAR = 0.45
"""Least distance between the free path and any region or wall [m]."""
CLEAR_ENDS = 0.8
"""The same at the start and at the goal [m]."""
MOST = 25
"""Regions of the shipped family."""
FEWEST = 0.6
"""Share of a scene's regions that is in play at least."""

_BENDS = 4
"""Points of the path between start and goal."""
_TRIES = 12
"""Places that are drawn for each region; the first that leaves room is taken, or the roomiest."""
_SMALLEST = 0.3
"""A place leaves room where the circumradius need not be smaller [m]."""
_SIZE, _KIND, _TURN, _FORM = range(4)
_PER_REGION = 4 + 2 * _TRIES


def draw(generator: np.random.Generator, scene: Scene) -> None:
    """Fill a scene of two walls and 3 regions or more; as many numbers decide every scene."""
    hall.check_count(scene, hall.WALLS + 3)
    ranks, goal = scene.ranks[hall.WALLS :], scene.goal
    most = len(ranks)
    ranks[:] = 1 + np.arange(most) % 3
    numbers = generator.random(4 + _BENDS + most * _PER_REGION)
    drawn, bends, chances = np.split(numbers, (4, 4 + _BENDS))
    chances = chances.reshape(most, _PER_REGION)
    half_width = 2.6 + 0.4 * drawn[0]
    length = 9.0 + 1.0 * drawn[1]
    goal[0], goal[1] = length, 1.2 * (2.0 * drawn[2] - 1.0)
    fewest = round(FEWEST * most)
    count = fewest + int((most - fewest + 1) * drawn[3])
    path = np.zeros((_BENDS + 2, 2))
    for k in range(_BENDS):
        path[k + 1, 0] = length * (k + 1) / (_BENDS + 1)
        across = 2.0 * bends[k] - 1.0  # never on the straight line
        path[k + 1, 1] = (half_width - CLEAR) * (0.7 * across + 0.3 * np.sign(across))
    path[_BENDS + 1] = goal

    regions = hall.build(scene, length, half_width)
    for k in range(count):
        region = regions[k]
        chance = chances[k]
        wanted = 0.35 + 0.55 * chance[_SIZE]
        room = -np.inf
        for attempt in range(_TRIES):
            x = length * chance[4 + 2 * attempt]
            y = goal[1] * x / length + 0.7 * half_width * (2.0 * chance[5 + 2 * attempt] - 1.0)
            free = hall.room_beside(path, x, y, CLEAR, CLEAR_ENDS)
            if free > room:
                region[X], region[Y], room = x, y, free
            if room >= _SMALLEST:
                break
        region[RADIUS] = max(0.05, min(wanted, room))
        hall.shape(region, chance[_KIND], chance[_TURN], chance[_FORM])
