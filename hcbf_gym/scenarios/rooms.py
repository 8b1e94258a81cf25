"""Random floors: six rooms between outer walls, doorways, furniture and zones of ranks 2 and 3.

Doorways join all rooms. A path from the start through doorways to the goal is laid first; furniture
and zones leave `CLEAR` to it, so that a body of that radius has a path that enters nothing. Every
wall and piece of furniture is convex.
"""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.scenarios import hall
from hcbf_gym.scenarios.scene import BOX, Scene

CLEAR = 0.7  # least distance from the free path, and half of the narrowest doorway [m]
CLEAR_ENDS = 0.8  # the same at the start and at the goal, walls included [m]
WIDEST_DOORWAY = 1.8  # [m]
THICKNESS = 0.15  # of walls [m]
OPEN_SHARE = 0.4  # share of the doorways that are open though no path needs them
FURNISHED_SHARE = 0.75  # share of the rooms with a piece of furniture

COLUMNS = 3
ROOMS, DOORWAYS = 2 * COLUMNS, COLUMNS + 2 * (COLUMNS - 1)
INNER_WALLS = 2 * COLUMNS + 3 * (COLUMNS - 1)
"""Pieces of wall between rooms: two in each column, three between columns."""
ZONE_RANKS = (2, 2, 3, 3)
BOXES = ROOMS + len(ZONE_RANKS)  # the furniture, one piece in each room, and the zones
RANKS = (1,) * (2 + INNER_WALLS + ROOMS) + ZONE_RANKS
"""Ranks of the walls at both ends, the walls between rooms, the furniture, the zones."""

_APPROACH = 0.8  # distance from a doorway at which the path turns towards it [m]
_CORNER = 1.0  # least distance of a doorway's middle from the ends of its wall [m]
_TRIES = 8  # places that are drawn for a box, of which it gets the roomiest
_SMALLEST = 0.15  # circumradius below which a box is left out [m]

_NUMBERS = (4, 2, 2, COLUMNS - 1, COLUMNS, 4 * DOORWAYS, BOXES * (5 + 2 * _TRIES))
"""How many random numbers decide: sizes and rooms, start, goal, walls between columns, walls in
columns, doorways, boxes."""

_JOINED = [(2 * column, 2 * column + 1) for column in range(COLUMNS)]
_JOINED += [(room, room + 2) for room in range(2 * (COLUMNS - 1))]
"""The rooms on both sides of each doorway; room 2 c is the lower one of column c."""


def draw(generator: np.random.Generator, scene: Scene) -> None:
    """Fill a scene of two outer walls and `RANKS`; every scene takes as many random numbers."""
    hall.check_count(scene, hall.WALLS + len(RANKS), exact=True)
    scene.ranks[hall.WALLS :] = RANKS
    sizes, start, goal, between, within, doorways, boxes = np.split(
        generator.random(sum(_NUMBERS)), np.cumsum(_NUMBERS)[:-1]
    )
    half_width, length = 3.6 + 0.9 * sizes[0], 10.0 + 3.0 * sizes[1]
    regions = hall.build(scene, length, half_width)
    rooms = _room_corners(length, half_width, between, within)
    opening_order, place, width, extra = doorways.reshape(DOORWAYS, 4).T
    widths, middles = _widths(opening_order, width, extra), _middles(place, rooms)
    for end in range(2):
        hall.wall(regions[end], (length * end, -half_width), (length * end, half_width), THICKNESS)
    _divide(regions[2:], widths, middles, rooms)

    first = int(ROOMS * sizes[2])
    last = (first + 1 + int((ROOMS - 1) * sizes[3])) % ROOMS  # another room
    for point, room, chance in ((scene.start, first, start), (scene.goal, last, goal)):
        reserve, (low, high) = CLEAR_ENDS + 0.5 * THICKNESS, rooms[room]
        point[:] = low + reserve + chance * (high - low - 2.0 * reserve)
    path = _path(scene.start, scene.goal, first, last, widths, middles)

    for k, chances in enumerate(boxes.reshape(BOXES, -1).tolist()):
        size, form, turn, room, absence, *places = chances
        is_zone = k >= ROOMS  # zones are in any room, furniture in its own
        if not is_zone and absence < 1.0 - FURNISHED_SHARE:
            continue
        corners = rooms[int(ROOMS * room) if is_zone else k]
        x, y, largest = _roomiest(path, corners, places)
        radius = min((0.5 if is_zone else 0.35) + 0.4 * size, largest)
        if radius >= _SMALLEST:
            aspect = 0.4 + 0.6 * form
            half_length = radius / np.hypot(1.0, aspect)
            region = regions[2 + INNER_WALLS + k]
            region[:] = BOX, x, y, half_length, aspect, 0.5 * np.pi * turn


def _room_corners(length: float, half_width: float, between: Array, within: Array) -> Array:
    """Return (ROOMS, 2, 2) the lower left and upper right corner of each room [m].

    Random numbers move the walls between columns (COLUMNS − 1,) and within them (COLUMNS,).
    """
    x = np.empty(COLUMNS + 1)  # of the walls between columns, and of both ends
    for k in range(COLUMNS + 1):
        x[k] = length * k / COLUMNS
    x[1:-1] += 0.04 * length * (2.0 * between - 1.0)
    y = 0.2 * half_width * (2.0 * within - 1.0)  # of the wall in each column
    rooms = np.empty((ROOMS, 2, 2))
    for c in range(COLUMNS):
        rooms[2 * c] = (x[c], -half_width), (x[c + 1], y[c])
        rooms[2 * c + 1] = (x[c], y[c]), (x[c + 1], half_width)
    return rooms


def _widths(opening_order: Array, width: Array, extra: Array) -> Array:
    """Return (DOORWAYS,) the width of each doorway [m], 0 where it is closed.

    Doorways open in a random order as long as they join rooms that no open ones join yet. Some of
    the others open as well.
    """
    group = np.arange(ROOMS)  # rooms that open doorways join have one number
    widths = np.zeros(DOORWAYS)
    for k in np.argsort(opening_order):
        one, other = _JOINED[k]
        if group[one] != group[other] or extra[k] < OPEN_SHARE:
            widths[k] = 2.0 * CLEAR + (WIDEST_DOORWAY - 2.0 * CLEAR) * width[k]
            group[group == group[other]] = group[one]
    return widths


def _middles(place: Array, rooms: Array) -> Array:
    """Return (DOORWAYS, 2) the middles of the doorways [m], at a random place of their walls."""
    middles = np.empty((DOORWAYS, 2))
    for k, (one, other) in enumerate(_JOINED):
        along = 0 if k < COLUMNS else 1  # the axis of the wall that both rooms share
        low = max(rooms[one, 0, along], rooms[other, 0, along]) + _CORNER
        high = min(rooms[one, 1, along], rooms[other, 1, along]) - _CORNER
        middles[k, along] = low + place[k] * (high - low)
        middles[k, 1 - along] = rooms[one, 1, 1 - along]
    return middles


def _divide(regions: Array, widths: Array, middles: Array, rooms: Array) -> None:
    """Write the walls between rooms: they end at doorways, and meet where one is closed."""
    for c in range(COLUMNS):
        (x0, _), (x1, y) = rooms[2 * c]
        x, gap = middles[c, 0], 0.5 * widths[c]
        hall.wall(regions[2 * c], (x0, y), (x - gap, y), THICKNESS)
        hall.wall(regions[2 * c + 1], (x + gap, y), (x1, y), THICKNESS)
    for c in range(COLUMNS - 1):
        x, top = rooms[2 * c + 1, 1]
        ends = [-top]
        for k in (COLUMNS + 2 * c, COLUMNS + 2 * c + 1):
            ends += [middles[k, 1] - 0.5 * widths[k], middles[k, 1] + 0.5 * widths[k]]
        ends.append(top)
        for k in range(3):
            piece = regions[2 * COLUMNS + 3 * c + k]
            hall.wall(piece, (x, ends[2 * k]), (x, ends[2 * k + 1]), THICKNESS)


def _path(start: Array, goal: Array, first: int, last: int, widths: Array, middles: Array) -> Array:
    """Return (k, 2) a path from the start to the goal, through the fewest doorways [m]."""
    doorway_towards_goal = {last: -1}  # of each room; a search from the goal's room outwards
    queue = [last]
    for room in queue:
        for k, joined in enumerate(_JOINED):
            if widths[k] > 0.0 and room in joined:
                neighbour = sum(joined) - room
                if neighbour not in doorway_towards_goal:
                    doorway_towards_goal[neighbour] = k
                    queue.append(neighbour)
    path, room = [start], first
    while room != last:
        k = doorway_towards_goal[room]
        direction = 1.0 if room == _JOINED[k][0] else -1.0
        for step in (-1, 0, 1):  # before the doorway, in it, behind it
            point = middles[k].copy()
            point[1 if k < COLUMNS else 0] += direction * _APPROACH * step
            path.append(point)
        room = sum(_JOINED[k]) - room
    return np.array([*path, goal])


def _roomiest(path: Array, room: Array, places: list[float]) -> tuple[float, float, float]:
    """Return x, y and the greatest circumradius of a box in a room beside the path [m].

    It is the best of `_TRIES` places, each of which two random numbers decide.
    """
    (x0, y0), (x1, y1) = room
    best_x, best_y, best_radius = 0.0, 0.0, 0.0
    for k in range(_TRIES):
        x, y = x0 + (x1 - x0) * places[2 * k], y0 + (y1 - y0) * places[2 * k + 1]
        radius = hall.room_beside(path, x, y, CLEAR, CLEAR_ENDS)
        if radius > best_radius:
            best_x, best_y, best_radius = x, y, radius
    return best_x, best_y, best_radius
