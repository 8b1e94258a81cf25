"""Random clutter: 15 to 25 overlapping regions of three ranks around a winding way that is free.

The way is drawn first, a line through six points across the hall; every region leaves `CLEAR` to
it. So a way that enters nothing exists by construction, mostly far from the straight line.
"""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.scenarios.hall import (
    ANGLE,
    ASPECT,
    DISC,
    ELLIPSE,
    RADIUS,
    SHAPE,
    Layout,
    X,
    Y,
    hide,
    room_beside,
)

CLEAR = 0.45
"""Least distance between the free way and any region or wall [m]."""
CLEAR_ENDS = 0.8
"""The same at the start and at the goal [m]."""
FEWEST, MOST = 15, 25
PRIORITIES = tuple(1 + k % 3 for k in range(MOST))

_BENDS = 4
"""Points of the way between start and goal."""
_TRIES = 12
"""Places that are drawn for each region; the first that leaves room is taken, or the roomiest."""
_SMALLEST = 0.3
"""A place leaves room where the circumradius need not be smaller [m]."""
_SIZE, _KIND, _TURN, _FORM = range(4)
_PER_REGION = 4 + 2 * _TRIES


def draw(rng: np.random.Generator) -> Layout:
    """Return the scene that the generator decides; it gives as many numbers for every scene."""
    hall, bends, chances = np.split(rng.random(4 + _BENDS + MOST * _PER_REGION), (4, 4 + _BENDS))
    goal, regions = np.empty(2), np.empty((MOST, 8))
    half_width = _lay_out(hall, bends, chances.reshape(MOST, _PER_REGION), goal, regions)
    return Layout(half_width, goal, regions, PRIORITIES)


def _lay_out(hall: Array, bends: Array, chances: Array, goal: Array, regions: Array) -> float:
    """Write the goal and the regions; return the hall's half width."""
    half_width = 2.6 + 0.4 * hall[0]
    length = 9.0 + 1.0 * hall[1]
    goal[0], goal[1] = length, 1.2 * (2.0 * hall[2] - 1.0)
    count = FEWEST + int((MOST - FEWEST + 1) * hall[3])
    way = np.zeros((_BENDS + 2, 2))
    for k in range(_BENDS):
        way[k + 1, 0] = length * (k + 1) / (_BENDS + 1)
        across = 2.0 * bends[k] - 1.0  # never on the straight line
        way[k + 1, 1] = (half_width - CLEAR) * (0.7 * across + 0.3 * np.sign(across))
    way[_BENDS + 1] = goal

    hide(regions, length, half_width)
    for k in range(count):
        region = regions[k]
        chance = chances[k]
        wanted = 0.35 + 0.55 * chance[_SIZE]
        room = -np.inf
        for attempt in range(_TRIES):
            x = length * chance[4 + 2 * attempt]
            y = goal[1] * x / length + 0.7 * half_width * (2.0 * chance[5 + 2 * attempt] - 1.0)
            free = room_beside(way, x, y, CLEAR, CLEAR_ENDS)
            if free > room:
                region[X], region[Y], room = x, y, free
            if room >= _SMALLEST:
                break
        region[RADIUS] = max(0.05, min(wanted, room))
        region[SHAPE] = (DISC, ELLIPSE, 3 + int(4.0 * chance[_FORM]))[int(3.0 * chance[_KIND])]
        region[ASPECT], region[ANGLE] = 0.5 + 0.5 * chance[_FORM], 2.0 * np.pi * chance[_TURN]
    return half_width
