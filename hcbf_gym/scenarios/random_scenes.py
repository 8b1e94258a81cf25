"""Random scenes: a hall with ranked regions and a free path from the origin to the goal.

Each region has its own stretch of the hall, and leaves `GAP` to its neighbours and to both walls.
So a path exists by construction, and to stand still at the start satisfies every strict row. A
conflict puts the start inside a region of priority 3 whose nearest exit is in one of priority 2.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.scenarios import hall
from hcbf_gym.scenarios.scene import RADIUS, Scene, X, Y

GAP = 0.8
"""Least passage between two regions, and between a region and a wall [m]; a conflicting pair
counts as one region."""
WIDE_GAP = 1.25  # of `random-wide` [m]: a robot of 0.46 m radius passes with room for margins
CONFLICT_SHARE = 0.5  # share of scenes that start in a conflict
START_CLEARANCE = 1.0  # least distance from the start to any strict region [m]
MAX_DRIFT = 0.2  # greatest speed of a moving region [m/s]
REGIONS = 5  # of the shipped families, and the least that a scene can have
LENGTH_PER_REGION = 1.7  # by which each region beyond `REGIONS` makes the hall longer [m]


class RegionDraw(NamedTuple):
    """Random numbers in [0, 1) that decide a region; some decide two independent things."""

    place: float  # in the order along the hall; the speed of a moving region
    size: float  # the heading of a moving region; the direction of a conflict's exit
    along: float  # position in its stretch; the depth of a conflict's start in the inner region
    across: float  # position off the straight line; from a conflict's start to the outer region
    kind: float  # disc, ellipse or polygon; the radius of a conflict's inner region
    turn: float  # angle of the shape; the radius of a conflict's outer region
    form: float  # aspect ratio, or number of corners


def draw(
    generator: np.random.Generator, scene: Scene, moving: bool = False, gap: float = GAP
) -> None:
    """Fill a scene of two walls and `REGIONS` regions or more; each more makes the hall longer.

    Args:
        generator: from which every scene of as many regions takes as many numbers.
        scene: the scene to fill.
        moving: whether relaxed regions drift; those of a conflict never do.
        gap: least passage between two regions, and between a region and a wall [m]. A wider one
            moves walls and regions apart and the goal farther away.
    """
    hall.check_count(scene, hall.WALLS + REGIONS)
    count = len(scene.ranks) - hall.WALLS
    scene.ranks[hall.WALLS :] = ranks = _ranks(count)
    numbers = generator.random(4 + count + 7 * count).tolist()
    by_width, by_length, by_goal, by_conflict, *presence = numbers[: 4 + count]
    draws = [RegionDraw(*numbers[k : k + 7]) for k in range(4 + count, len(numbers), 7)]
    inner, outer = ranks.index(3), ranks.index(2)
    is_conflict = by_conflict < CONFLICT_SHARE
    in_play = [k for k in range(count) if k in (0, outer) or presence[k] < 0.5]
    order = _shuffled([k for k in in_play if not (is_conflict and k in (inner, outer))], draws)

    widening = gap - GAP
    length = 8.5 + 1.5 * by_length + 0.5 * len(order) * widening
    length += LENGTH_PER_REGION * (count - REGIONS)
    half_width = 2.2 + 0.6 * by_width + widening
    scene.goal[:] = length, 1.2 * (2.0 * by_goal - 1.0)
    regions = hall.build(scene, length, half_width)
    begin = 1.0 + 0.4 + 0.5 * gap if is_conflict else START_CLEARANCE - 0.5 * gap
    stretch = (length - 0.6 - begin) / len(order)  # of the hall, for each region
    for place, k in enumerate(order):
        low = begin + place * stretch + 0.5 * gap
        _write_region(regions[k], draws[k], low, stretch - gap, half_width - gap, scene.goal)
        if moving and ranks[k] > 1:
            speed, heading = MAX_DRIFT * draws[k].place, 2.0 * np.pi * draws[k].size
            velocity = speed * np.cos(heading), speed * np.sin(heading)
            scene.velocities[hall.WALLS + k] = velocity
    if is_conflict:
        _write_conflict(regions[inner], regions[outer], draws[inner])


@cache
def _ranks(count: int) -> list[int]:
    """Return the ranks of the regions: two fifths are 1, two fifths are 2, and a fifth is 3."""
    return [1 + 5 * k // (2 * count) for k in range(count)]


def _shuffled(regions: list[int], draws: list[RegionDraw]) -> list[int]:
    """Return the regions' indices in the random order in which they follow along the hall."""
    order: list[int] = []
    for k in regions:
        place = int(len(order) * draws[k].place)
        order.append(k)
        order[place], order[-1] = k, order[place]
    return order


def _write_region(
    region: Array, drawn: RegionDraw, low: float, length: float, half_width: float, goal: Array
) -> None:
    """Write a region (6,) near the straight line to the goal, for x from `low` to `low + length`.

    All |y| in the region are at most `half_width` [m].
    """
    radius = min(1.1, 0.5 * length) * (0.7 + 0.3 * drawn.size)
    x = low + radius + (length - 2.0 * radius) * drawn.along
    straight = goal[1] * x / goal[0]
    across = half_width - radius
    y = min(max(straight + 0.5 * (2.0 * drawn.across - 1.0) * radius, -across), across)
    region[X], region[Y], region[RADIUS] = x, y, radius
    hall.shape(region, drawn.kind, drawn.turn, drawn.form)


def _write_conflict(inner: Array, outer: Array, drawn: RegionDraw) -> None:
    """Write `inner` (6,) around the start, and `outer` (6,) over the nearest exit: a conflict."""
    heading = 2.0 * np.pi * drawn.size
    depth = 0.3 + 0.2 * drawn.along
    distance = 0.1 + 0.1 * drawn.across  # below the depth, so that the two rows conflict
    inner[RADIUS] = 0.6 + 0.2 * drawn.kind
    outer[RADIUS] = 0.4 + 0.2 * drawn.turn
    back = depth - inner[RADIUS]
    ahead = distance + outer[RADIUS]
    inner[X], inner[Y] = back * np.cos(heading), back * np.sin(heading)
    outer[X], outer[Y] = ahead * np.cos(heading), ahead * np.sin(heading)
