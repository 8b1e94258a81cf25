"""Random floors: six rooms between four outer walls, doors, furniture and zones of ranks 2 and 3.

Doors join all rooms. A way from the start through doors to the goal is laid first; furniture and
zones leave `CLEAR` to it, so a body of that radius finds a way that enters nothing. Every wall and
piece of furniture is convex: the regions are the cover of a map, which nobody needs to compute.
"""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.scenarios import hall
from hcbf_gym.scenarios.scene import ANGLE, ASPECT, BOX, RADIUS, SHAPE, Scene, X, Y

CLEAR = 0.7
"""Least distance between the free way and anything [m], and half of the narrowest door."""
CLEAR_ENDS = 0.8
"""The same at the start and at the goal, walls included [m]."""
WIDEST = 1.8
"""Of a door [m]."""
THICKNESS = 0.15
"""Of walls [m]."""
OPEN_SHARE = 0.4
"""How many of the doors that no way needs are open."""

COLUMNS = 3
ROOMS, DOORS = 2 * COLUMNS, COLUMNS + 2 * (COLUMNS - 1)
INNER = 2 * COLUMNS + 3 * (COLUMNS - 1)
"""Pieces of wall between rooms: two in each column, three between columns."""
ZONES = (2, 2, 3, 3)
"""Ranks of the zones."""
RANKS = (1,) * (2 + INNER + ROOMS) + ZONES

_BEFORE = 0.8
"""Where the way turns towards a door, in front of it and behind [m]."""
_CORNER = 1.0
"""Least distance of a door's middle from the ends of its wall [m]."""
_TRIES = 8
"""Places that are drawn for furniture or a zone; the roomiest is taken."""
_SMALLEST = 0.15
"""Furniture or a zone with a smaller circumradius is left out [m]."""
_THINGS = ROOMS + len(ZONES)
_PER_THING = 5 + 2 * _TRIES
_WIDTH, _LENGTH, _START_ROOM, _GOAL_ROOM, _START, _GOAL = 0, 1, 2, 3, 4, 6
_KEY, _PLACE, _GAP, _EXTRA = range(4)
_SIZE, _FORM, _TURN, _WHERE, _PRESENT = range(5)


def draw(generator: np.random.Generator, scene: Scene) -> None:
    """Fill a scene of two outer walls and `RANKS`; as many numbers decide every scene."""
    count = hall.WALLS + len(RANKS)
    hall.check_count(scene, count, count)
    scene.ranks[hall.WALLS :] = RANKS
    start, goal = scene.start, scene.goal
    counts = (8, 2 * COLUMNS - 1, 4 * DOORS, _PER_THING * _THINGS)
    numbers = generator.random(sum(counts))
    drawn, lines, doors, things = np.split(numbers, np.cumsum(counts)[:-1])
    doors, things = doors.reshape(DOORS, 4), things.reshape(_THINGS, -1)
    half_width = 3.6 + 0.9 * drawn[_WIDTH]
    length = 10.0 + 3.0 * drawn[_LENGTH]
    regions = hall.build(scene, length, half_width)
    across = np.empty(COLUMNS + 1)  # x of the walls between columns, and of both ends
    for k in range(COLUMNS + 1):
        across[k] = length * k / COLUMNS
        if 0 < k < COLUMNS:
            across[k] += 0.04 * length * (2.0 * lines[k - 1] - 1.0)
    between = 0.2 * half_width * (2.0 * lines[COLUMNS - 1 :] - 1.0)  # y of the wall of each column

    opened = _open(doors)
    middle = _middles(doors, across, between, half_width)
    for end in range(2):
        _wall(regions[end], length * end, -half_width, length * end, half_width)
    _divide(regions[2:], opened, middle, across, between, half_width)

    first = int(ROOMS * drawn[_START_ROOM])
    last = (first + 1 + int((ROOMS - 1) * drawn[_GOAL_ROOM])) % ROOMS
    _place_in(start, first, drawn[_START : _START + 2], across, between, half_width)
    _place_in(goal, last, drawn[_GOAL : _GOAL + 2], across, between, half_width)
    way = _way(start, goal, first, last, opened, middle)
    for k in range(_THINGS):
        chance = things[k]
        room = k if k < ROOMS else int(ROOMS * chance[_WHERE])
        if k < ROOMS and chance[_PRESENT] < 0.25:
            continue
        smaller = 0.35 if k < ROOMS else 0.5
        _furnish(
            regions[2 + INNER + k], chance, smaller, way, _sides(room, across, between, half_width)
        )


def _open(doors: Array) -> Array:
    """Return (DOORS,) the width of each door, 0 where closed; the open ones join all rooms."""
    group = np.arange(ROOMS)
    opened = np.zeros(DOORS)
    for door in np.argsort(doors[:, _KEY]):
        one, other = _joins(door)
        if group[one] != group[other] or doors[door, _EXTRA] < OPEN_SHARE:
            opened[door] = 2.0 * CLEAR + (WIDEST - 2.0 * CLEAR) * doors[door, _GAP]
            group[group == group[other]] = group[one]
    return opened


def _joins(door: int) -> tuple[int, int]:
    """Return the rooms on both sides of a door; room 2 c is the lower one of column c."""
    if door < COLUMNS:
        return 2 * door, 2 * door + 1
    return door - COLUMNS, door - COLUMNS + 2


def _middles(doors: Array, across: Array, between: Array, half_width: float) -> Array:
    """Return (DOORS, 2) where the doors are [m]."""
    middle = np.empty((DOORS, 2))
    for door in range(DOORS):
        share = doors[door, _PLACE]
        if door < COLUMNS:
            low, high = across[door] + _CORNER, across[door + 1] - _CORNER
            middle[door, 0], middle[door, 1] = low + share * (high - low), between[door]
            continue
        column, upper = (door - COLUMNS) // 2, (door - COLUMNS) % 2
        low, high = -half_width, min(between[column], between[column + 1])
        if upper:
            low, high = max(between[column], between[column + 1]), half_width
        low, high = low + _CORNER, high - _CORNER
        middle[door, 0], middle[door, 1] = across[column + 1], low + share * (high - low)
    return middle


def _divide(
    regions: Array, opened: Array, middle: Array, across: Array, between: Array, half_width: float
) -> None:
    """Write the walls between rooms: they end at the doors, and meet where a door is closed."""
    for c in range(COLUMNS):
        x, y, gap = middle[c, 0], between[c], 0.5 * opened[c]
        _wall(regions[2 * c], across[c], y, x - gap, y)
        _wall(regions[2 * c + 1], x + gap, y, across[c + 1], y)
    for c in range(COLUMNS - 1):
        x = across[c + 1]
        lower, upper = COLUMNS + 2 * c, COLUMNS + 2 * c + 1
        ends = (
            -half_width,
            middle[lower, 1] - 0.5 * opened[lower],
            middle[lower, 1] + 0.5 * opened[lower],
            middle[upper, 1] - 0.5 * opened[upper],
            middle[upper, 1] + 0.5 * opened[upper],
            half_width,
        )
        for k in range(3):
            _wall(regions[2 * COLUMNS + 3 * c + k], x, ends[2 * k], x, ends[2 * k + 1])


def _wall(region: Array, x0: float, y0: float, x1: float, y1: float) -> None:
    """Write a wall of `THICKNESS` whose axis runs from one point to another."""
    half = 0.5 * np.hypot(x1 - x0, y1 - y0)
    region[SHAPE], region[RADIUS], region[ASPECT] = BOX, half, 0.5 * THICKNESS / half
    region[X], region[Y] = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    region[ANGLE] = np.arctan2(y1 - y0, x1 - x0)


def _sides(
    room: int, across: Array, between: Array, half_width: float
) -> tuple[float, float, float, float]:
    """Return the least and the greatest x, and the least and the greatest y, of a room [m]."""
    column = room // 2
    low, high = -half_width, between[column]
    if room % 2:
        low, high = between[column], half_width
    return across[column], across[column + 1], low, high


def _place_in(
    point: Array, room: int, chance: Array, across: Array, between: Array, half_width: float
) -> None:
    """Write a point of a room that leaves `CLEAR_ENDS` to its walls."""
    x0, x1, y0, y1 = _sides(room, across, between, half_width)
    reserve = CLEAR_ENDS + 0.5 * THICKNESS
    point[0] = x0 + reserve + chance[0] * (x1 - x0 - 2.0 * reserve)
    point[1] = y0 + reserve + chance[1] * (y1 - y0 - 2.0 * reserve)


def _way(start: Array, goal: Array, first: int, last: int, opened: Array, middle: Array) -> Array:
    """Return (k, 2) a way from the start to the goal, through the fewest doors."""
    through = np.full(ROOMS, -1)  # the door by which one leaves a room towards the last
    queue, asked, found = np.empty(ROOMS, dtype=np.int64), 0, 1
    queue[0] = last
    while asked < found:
        here = queue[asked]
        asked += 1
        for door in range(DOORS):
            one, other = _joins(door)
            if opened[door] == 0.0 or here not in (one, other):
                continue
            there = one + other - here
            if there != last and through[there] < 0:
                through[there] = door
                queue[found] = there
                found += 1
    way = np.empty((2 + 3 * ROOMS, 2))
    way[0], count, room = start, 1, first
    while room != last:
        door = through[room]
        one, other = _joins(door)
        direction = 1.0 if room == one else -1.0
        for k in range(3):
            way[count] = middle[door]
            way[count, 1 if door < COLUMNS else 0] += direction * _BEFORE * (k - 1)
            count += 1
        room = one + other - room
    way[count] = goal
    return way[: count + 1]


def _furnish(
    region: Array,
    chance: Array,
    smaller: float,
    way: Array,
    sides: tuple[float, float, float, float],
) -> None:
    """Write a box in a room, as large as it wants to be or as the way beside it leaves room."""
    x0, x1, y0, y1 = sides
    best, best_x, best_y = 0.0, 0.0, 0.0
    for k in range(_TRIES):
        x = x0 + (x1 - x0) * chance[5 + 2 * k]
        y = y0 + (y1 - y0) * chance[6 + 2 * k]
        free = hall.room_beside(way, x, y, CLEAR, CLEAR_ENDS)
        if free > best:
            best, best_x, best_y = free, x, y
    radius = min(smaller + 0.4 * chance[_SIZE], best)
    if radius < _SMALLEST:
        return
    aspect = 0.4 + 0.6 * chance[_FORM]
    region[SHAPE], region[X], region[Y] = BOX, best_x, best_y
    region[RADIUS], region[ASPECT] = radius / np.hypot(1.0, aspect), aspect
    region[ANGLE] = 0.5 * np.pi * chance[_TURN]
