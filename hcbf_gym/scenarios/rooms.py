"""Random floors: six rooms between outer walls, doorways, furniture and zones of ranks 2 and 3.

Doorways join all rooms. A path from the start through doorways to the goal is laid first; furniture
and zones leave `CLEAR` to it, so that a body of that radius has a path that enters nothing. Every
wall and piece of furniture is convex.
"""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.scenarios import hall
from hcbf_gym.scenarios.scene import ANGLE, ASPECT, BOX, RADIUS, SHAPE, Scene, X, Y

CLEAR = 0.7
"""Least distance between the free path and anything [m], and half of the narrowest doorway."""
CLEAR_ENDS = 0.8
"""The same at the start and at the goal, walls included [m]."""
WIDEST = 1.8
"""Of a doorway [m]."""
THICKNESS = 0.15
"""Of walls [m]."""
OPEN_SHARE = 0.4
"""The share that is open of the doorways that no path needs."""

COLUMNS = 3
ROOMS, DOORWAYS = 2 * COLUMNS, COLUMNS + 2 * (COLUMNS - 1)
INNER = 2 * COLUMNS + 3 * (COLUMNS - 1)
"""Pieces of wall between rooms: two in each column, three between columns."""
ZONES = (2, 2, 3, 3)
"""Ranks of the zones."""
RANKS = (1,) * (2 + INNER + ROOMS) + ZONES

_BEFORE = 0.8
"""Distance from a doorway, on both sides, at which the path turns towards it [m]."""
_CORNER = 1.0
"""Least distance of a doorway's middle from the ends of its wall [m]."""
_TRIES = 8
"""Places that are drawn for furniture or a zone; the roomiest is taken."""
_SMALLEST = 0.15
"""Furniture or a zone with a smaller circumradius is left out [m]."""
_THINGS = ROOMS + len(ZONES)
_PER_THING = 5 + 2 * _TRIES
_WIDTH, _LENGTH, _START_ROOM, _GOAL_ROOM, _START, _GOAL = 0, 1, 2, 3, 4, 6
_KEY, _PLACE, _GAP, _EXTRA = range(4)
_SIZE, _FORM, _TURN, _WHERE, _PRESENT = range(5)
_JOINED = [(2 * k, 2 * k + 1) if k < COLUMNS else (k - COLUMNS, k - COLUMNS + 2)
           for k in range(DOORWAYS)]  # fmt: skip
"""The rooms on both sides of each doorway; room 2 c is the lower one of column c."""


def draw(generator: np.random.Generator, scene: Scene) -> None:
    """Fill a scene of two outer walls and `RANKS`; as many numbers decide every scene."""
    hall.check_count(scene, hall.WALLS + len(RANKS), exact=True)
    scene.ranks[hall.WALLS :] = RANKS
    start, goal = scene.start, scene.goal
    counts = (8, 2 * COLUMNS - 1, 4 * DOORWAYS, _PER_THING * _THINGS)
    drawn, lines, doorways, things = np.split(generator.random(sum(counts)), np.cumsum(counts)[:-1])
    doorways, things = doorways.reshape(DOORWAYS, 4), things.reshape(_THINGS, -1)
    half_width = 3.6 + 0.9 * drawn[_WIDTH]
    length = 10.0 + 3.0 * drawn[_LENGTH]
    regions = hall.build(scene, length, half_width)
    across = np.empty(COLUMNS + 1)  # x of the walls between columns, and of both ends
    for k in range(COLUMNS + 1):
        across[k] = length * k / COLUMNS
        if 0 < k < COLUMNS:
            across[k] += 0.04 * length * (2.0 * lines[k - 1] - 1.0)
    between = 0.2 * half_width * (2.0 * lines[COLUMNS - 1 :] - 1.0)  # y of the wall of each column
    rooms = np.empty((ROOMS, 2, 2))  # lower left and upper right corner
    for k in range(ROOMS):
        column, low, high = k // 2, -half_width, half_width
        rooms[k, :, 0] = across[column], across[column + 1]
        rooms[k, :, 1] = (between[column], high) if k % 2 else (low, between[column])

    width, middle = _widths(doorways), _middles(doorways, rooms)
    for end in range(2):
        hall.wall(regions[end], (length * end, -half_width), (length * end, half_width), THICKNESS)
    _divide(regions[2:], width, middle, rooms)
    first = int(ROOMS * drawn[_START_ROOM])
    last = (first + 1 + int((ROOMS - 1) * drawn[_GOAL_ROOM])) % ROOMS
    for point, room, at in ((start, first, _START), (goal, last, _GOAL)):
        reserve, (low, high) = CLEAR_ENDS + 0.5 * THICKNESS, rooms[room]
        point[:] = low + reserve + drawn[at : at + 2] * (high - low - 2.0 * reserve)
    path = _path(start, goal, first, last, width, middle)
    for k in range(_THINGS):
        chance, is_zone = things[k], k >= ROOMS
        if is_zone or chance[_PRESENT] >= 0.25:
            room = int(ROOMS * chance[_WHERE]) if is_zone else k
            _furnish(regions[2 + INNER + k], chance, 0.5 if is_zone else 0.35, path, rooms[room])


def _widths(doorways: Array) -> Array:
    """Return (DOORWAYS,) the width of each, 0 where closed; the open ones join all rooms."""
    group = np.arange(ROOMS)
    width = np.zeros(DOORWAYS)
    for k in np.argsort(doorways[:, _KEY]):
        one, other = _JOINED[k]
        if group[one] != group[other] or doorways[k, _EXTRA] < OPEN_SHARE:
            width[k] = 2.0 * CLEAR + (WIDEST - 2.0 * CLEAR) * doorways[k, _GAP]
            group[group == group[other]] = group[one]
    return width


def _middles(doorways: Array, rooms: Array) -> Array:
    """Return (DOORWAYS, 2) where the doorways are [m]."""
    middle = np.empty((DOORWAYS, 2))
    for k, (one, other) in enumerate(_JOINED):
        along = 0 if k < COLUMNS else 1  # the axis of the wall that both rooms share
        low = max(rooms[one, 0, along], rooms[other, 0, along]) + _CORNER
        high = min(rooms[one, 1, along], rooms[other, 1, along]) - _CORNER
        middle[k, along] = low + doorways[k, _PLACE] * (high - low)
        middle[k, 1 - along] = rooms[one, 1, 1 - along]
    return middle


def _divide(regions: Array, width: Array, middle: Array, rooms: Array) -> None:
    """Write the walls between rooms: they end at doorways, and meet where one is closed."""
    for c in range(COLUMNS):
        (x0, _), (x1, y) = rooms[2 * c]
        x, gap = middle[c, 0], 0.5 * width[c]
        hall.wall(regions[2 * c], (x0, y), (x - gap, y), THICKNESS)
        hall.wall(regions[2 * c + 1], (x + gap, y), (x1, y), THICKNESS)
    for c in range(COLUMNS - 1):
        x, top = rooms[2 * c + 1, 1]
        ends = [-top]
        for k in (COLUMNS + 2 * c, COLUMNS + 2 * c + 1):
            ends += [middle[k, 1] - 0.5 * width[k], middle[k, 1] + 0.5 * width[k]]
        ends.append(top)
        for k in range(3):
            piece = regions[2 * COLUMNS + 3 * c + k]
            hall.wall(piece, (x, ends[2 * k]), (x, ends[2 * k + 1]), THICKNESS)


def _path(start: Array, goal: Array, first: int, last: int, width: Array, middle: Array) -> Array:
    """Return (k, 2) a path from the start to the goal, through the fewest doorways."""
    through = {last: -1}  # the doorway from each room towards the last
    queue = [last]
    for here in queue:
        for k, joined in enumerate(_JOINED):
            if width[k] > 0.0 and here in joined:
                there = sum(joined) - here
                if there not in through:
                    through[there] = k
                    queue.append(there)
    path, room = [start], first
    while room != last:
        k = through[room]
        direction = 1.0 if room == _JOINED[k][0] else -1.0
        for step in (-1, 0, 1):
            point = middle[k].copy()
            point[1 if k < COLUMNS else 0] += direction * _BEFORE * step
            path.append(point)
        room = sum(_JOINED[k]) - room
    return np.array([*path, goal])


def _furnish(region: Array, chance: Array, smaller: float, path: Array, room: Array) -> None:
    """Write a box in a room, of its drawn size or as large as the path beside it allows."""
    (x0, y0), (x1, y1) = room
    best, best_x, best_y = 0.0, 0.0, 0.0
    for k in range(_TRIES):
        x = x0 + (x1 - x0) * chance[5 + 2 * k]
        y = y0 + (y1 - y0) * chance[6 + 2 * k]
        free = hall.room_beside(path, x, y, CLEAR, CLEAR_ENDS)
        if free > best:
            best, best_x, best_y = free, x, y
    radius = min(smaller + 0.4 * chance[_SIZE], best)
    if radius < _SMALLEST:
        return
    aspect = 0.4 + 0.6 * chance[_FORM]
    region[SHAPE], region[X], region[Y] = BOX, best_x, best_y
    region[RADIUS], region[ASPECT] = radius / np.hypot(1.0, aspect), aspect
    region[ANGLE] = 0.5 * np.pi * chance[_TURN]
