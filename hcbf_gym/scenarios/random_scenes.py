"""Random scenes: a hall with ranked regions, conflicts in a stated share, a path always open.

Each region has its own stretch of the hall, so that it leaves `GAP` to its neighbours and to
both walls: the path exists by construction, and standing still meets every strict row. In a
conflict the episode starts inside a region of priority 3 whose nearest exit is in one of 2.
"""

from functools import cache

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.scenarios import hall
from hcbf_gym.scenarios.scene import RADIUS, Scene, X, Y

GAP = 0.8
"""Least passage between two regions, and between a region and a wall [m]; a conflicting pair
counts as one region."""
WIDE_GAP = 1.25
"""The same of `random-wide` [m], where a robot of .46 m radius passes with room for margins."""
CONFLICT_SHARE = 0.5
"""Share of scenes that start in a conflict, of `random` and `random-moving` alike."""
START_CLEARANCE = 1.0
"""Least distance from the start to any strict region [m]."""
MAX_DRIFT = 0.2
"""Greatest speed of a moving region [m/s]."""
LONGER = 1.7
"""By how much each region beyond `REGIONS` makes the hall longer [m]."""

REGIONS = 5
"""As many as the shipped families have, and the fewest that a scene can have."""

# what is drawn: four numbers for the hall, one for each region's presence, seven for each region
_WIDTH, _LENGTH, _GOAL, _CONFLICT = range(4)
_PLACE, _SIZE, _ALONG, _ACROSS, _KIND, _TURN, _FORM = range(7)
# a conflict's two regions have no stretch: their draws decide where they are
_HEADING, _DEPTH, _DISTANCE, _INNER, _OUTER = _SIZE, _ALONG, _ACROSS, _KIND, _TURN


def draw(
    generator: np.random.Generator, scene: Scene, moving: bool = False, gap: float = GAP
) -> None:
    """Fill a scene of two walls and `REGIONS` regions or more; each more makes the hall longer.

    Args:
        generator: of which every scene takes the same number of numbers.
        scene: to fill.
        moving: let the relaxed regions drift that are not part of a conflict.
        gap: least passage between two regions, and between a region and a wall [m]; a wider one
            moves walls and regions apart and the goal farther away.
    """
    hall.check_count(scene, hall.WALLS + REGIONS)
    goal, n_slots = scene.goal, len(scene.ranks) - hall.WALLS
    scene.ranks[hall.WALLS :] = ranks = _ranks(n_slots)
    of_2, of_3 = ranks.index(2), ranks.index(3)
    numbers = generator.random(4 + n_slots + 7 * n_slots)
    drawn, presence, chances = np.split(numbers, (4, 4 + n_slots))
    chances = chances.reshape(n_slots, 7)
    conflict = drawn[_CONFLICT] < CONFLICT_SHARE
    order = np.empty(n_slots, dtype=np.int64)
    n = 0
    for slot in range(n_slots):  # which regions have a stretch, and in which order
        in_play = slot in (0, of_2) or presence[slot] < 0.5
        if in_play and not (conflict and slot in (of_2, of_3)):
            place = int(n * chances[slot, _PLACE])
            order[n] = order[place]
            order[place] = slot
            n = n + 1

    half_width = 2.2 + 0.6 * drawn[_WIDTH] + (gap - GAP)
    length = 8.5 + 1.5 * drawn[_LENGTH] + 0.5 * n * (gap - GAP) + LONGER * (n_slots - REGIONS)
    goal[0], goal[1] = length, 1.2 * (2.0 * drawn[_GOAL] - 1.0)
    first = 1.0 + 0.4 + 0.5 * gap if conflict else START_CLEARANCE - 0.5 * gap
    stretch = (length - 0.6 - first) / n
    regions = hall.build(scene, length, half_width)
    for k in range(n):
        slot = order[k]
        reach = first + k * stretch, stretch, half_width - gap
        _place(regions[slot], chances[slot], reach, gap, goal)
        if moving and ranks[slot] > 1:
            speed = MAX_DRIFT * chances[slot, _PLACE]
            heading = 2.0 * np.pi * chances[slot, _SIZE]
            velocity = speed * np.cos(heading), speed * np.sin(heading)
            scene.velocities[hall.WALLS + slot] = velocity
    if conflict:
        _collide(regions[of_3], regions[of_2], chances[of_3])


@cache
def _ranks(count: int) -> list[int]:
    """Return the ranks of regions: two fifths each of 1 and 2, and a fifth of 3."""
    return [1 + 5 * k // (2 * count) for k in range(count)]


def _place(
    region: Array, chance: Array, reach: tuple[float, float, float], gap: float, goal: Array
) -> None:
    """Put a region near the straight line, within its stretch (from, length, half width)."""
    first, stretch, half_width = reach
    radius = min(1.1, 0.5 * (stretch - gap)) * (0.7 + 0.3 * chance[_SIZE])
    free = stretch - gap - 2.0 * radius
    x = first + 0.5 * gap + radius + free * chance[_ALONG]
    straight = goal[1] * x / goal[0]
    across = half_width - radius
    y = min(max(straight + 0.5 * (2.0 * chance[_ACROSS] - 1.0) * radius, -across), across)
    region[X], region[Y], region[RADIUS] = x, y, radius
    hall.shape(region, chance[_KIND], chance[_TURN], chance[_FORM])


def _collide(inner: Array, outer: Array, chance: Array) -> None:
    """Put the start inside `inner`, with `outer` beside its nearest exit: a conflict."""
    heading = 2.0 * np.pi * chance[_HEADING]
    depth = 0.3 + 0.2 * chance[_DEPTH]
    distance = 0.1 + 0.1 * chance[_DISTANCE]  # below the depth: the rows exclude another
    inner[RADIUS] = 0.6 + 0.2 * chance[_INNER]
    outer[RADIUS] = 0.4 + 0.2 * chance[_OUTER]
    back = depth - inner[RADIUS]
    ahead = distance + outer[RADIUS]
    inner[X], inner[Y] = back * np.cos(heading), back * np.sin(heading)
    outer[X], outer[Y] = ahead * np.cos(heading), ahead * np.sin(heading)
