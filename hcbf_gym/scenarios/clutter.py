"""Random clutter: 15 to 25 overlapping regions of three ranks around a winding, free path.

The path is drawn first, a line through six points across the hall. Every region then gets a place
and a size that leave `CLEAR` to the path (`_LEAST_RADIUS` states the rare exception). So a path
that enters nothing exists by construction, mostly far from the straight line.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.scenarios import hall
from hcbf_gym.scenarios.scene import RADIUS, Scene, X, Y

CLEAR = 0.45  # least distance between the free path and any region or wall [m]
CLEAR_ENDS = 0.8  # the same at the start and at the goal [m]
MAX_REGIONS = 25  # regions of the shipped family, in play or not
MIN_SHARE = 0.6  # least share of a scene's regions that is in play


class Range(NamedTuple):
    """A range of values, from which a random number in [0, 1) takes one."""

    least: float
    width: float

    def at(self, chance: float) -> float:
        """Return the value at a random number: `least` at 0, `least + width` at 1."""
        return self.least + self.width * chance


_HALF_WIDTH = Range(2.6, 0.4)  # of the hall [m]: the path has space for bends to both sides
_LENGTH = Range(9.0, 1.0)  # of the hall, and x of the goal [m]
_GOAL_OFFSET = 1.2  # greatest |y| of the goal [m]
_BENDS = 4  # points of the path between start and goal
_BEND = Range(0.3, 0.7)  # |y| of a bend, as a share of what `CLEAR` to the walls allows
_SPREAD = 0.7  # of regions to both sides of the straight line, as a share of the half width
_RADIUS = Range(0.35, 0.55)  # circumradius of a region where the path leaves room for it [m]
_TRIES = 12  # places that are drawn for a region: it gets the first with room, or the roomiest
_ENOUGH_ROOM = 0.3  # circumradius that a place must allow to end the tries [m]
_LEAST_RADIUS = 0.05
"""Circumradius of a region that finds no place with as much room [m]. It comes nearer to the path
than `CLEAR`, in about one scene of 7500, and by 0.08 m at most in 60 000 scenes."""


class RegionDraw(NamedTuple):
    """Random numbers in [0, 1) that decide a region."""

    size: float
    kind: float  # disc, ellipse or polygon
    turn: float  # angle of the shape
    form: float  # aspect ratio, or number of corners
    places: list[float]  # (2 `_TRIES`,) along and across the hall, for each place in turn


class Place(NamedTuple):
    """A centre for a region."""

    x: float  # [m]
    y: float  # [m]
    room: float  # greatest circumradius that leaves the path clear, negative too near to it [m]


def draw(generator: np.random.Generator, scene: Scene) -> None:
    """Fill a scene of two walls and 3 regions or more.

    Every scene of as many regions takes as many numbers from the generator, even for places and
    regions that it does not use. So a scene depends on the seed and its index, and not on the
    contents of the scenes before it.
    """
    hall.check_count(scene, hall.WALLS + 3)
    ranks = scene.ranks[hall.WALLS :]
    max_regions = len(ranks)
    ranks[:] = 1 + np.arange(max_regions) % 3

    by_width, by_length, by_goal, by_count = generator.random(4).tolist()
    bends = generator.random(_BENDS).tolist()
    region_numbers = generator.random((max_regions, 4 + 2 * _TRIES)).tolist()

    half_width, length = _HALF_WIDTH.at(by_width), _LENGTH.at(by_length)
    scene.goal[:] = length, _GOAL_OFFSET * (2.0 * by_goal - 1.0)
    path = _winding_path(bends, half_width, scene.goal)
    regions = hall.build(scene, length, half_width)
    min_regions = round(MIN_SHARE * max_regions)
    count = min_regions + int((max_regions - min_regions + 1) * by_count)
    for region, numbers in zip(regions[:count], region_numbers[:count], strict=True):
        drawn = RegionDraw(*numbers[:4], places=numbers[4:])
        place = _place(drawn.places, path, half_width, scene.goal)
        radius = max(_LEAST_RADIUS, min(_RADIUS.at(drawn.size), place.room))
        region[X], region[Y], region[RADIUS] = place.x, place.y, radius
        hall.shape(region, drawn.kind, drawn.turn, drawn.form)


def _winding_path(bends: list[float], half_width: float, goal: Array) -> Array:
    """Return a path (k, 2) from the origin to the goal [m], with a bend at each random number."""
    path = np.zeros((_BENDS + 2, 2))
    for k, bend in enumerate(bends, start=1):
        across = 2.0 * bend - 1.0
        # no bend is on the straight line, as its |y| has a least value
        share = np.sign(across) * _BEND.at(abs(across))
        path[k] = goal[0] * k / (_BENDS + 1), (half_width - CLEAR) * share
    path[-1] = goal
    return path


def _place(numbers: list[float], path: Array, half_width: float, goal: Array) -> Place:
    """Return the first place around the line to the goal with `_ENOUGH_ROOM`, or the roomiest.

    Two random numbers decide each place: its x, and its y beside the line.
    """
    roomiest = Place(0.0, 0.0, room=-np.inf)
    for along, across in zip(numbers[::2], numbers[1::2], strict=True):
        x = goal[0] * along
        y = goal[1] * x / goal[0] + _SPREAD * half_width * (2.0 * across - 1.0)
        room = hall.room_beside(path, x, y, CLEAR, CLEAR_ENDS)
        if room > roomiest.room:
            roomiest = Place(x, y, room)
        if roomiest.room >= _ENOUGH_ROOM:
            break
    return roomiest
