"""Random scenes: a hall with ranked regions, conflicts in a stated share, a way always open.

The hall runs along +x between two walls. Each region has a stretch of the hall to itself, so that
it leaves `GAP` to its neighbours and to both walls: the way exists by construction, and standing
still meets every strict row. In a conflict the robot wakes inside a region of priority 3 whose
nearest exit leads into one of priority 2.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.barriers import Barrier, ConvexPolygon, Disc, Ellipse, HalfPlane, layout
from hcbf_gym.scenarios.references import PointReference
from hcbf_gym.scenarios.scenario import Scenario

Array = NDArray[np.float64]

GAP = 0.8
"""Least passage between two regions, and between a region and a wall [m]; a conflicting pair
counts as one region."""
CONFLICT_SHARE = 0.5
"""Share of scenes that start in a conflict, of `random` and `random-moving` alike."""
START_CLEARANCE = 1.0
"""Least distance from the start to any strict region [m]."""
V_MAX = 1.0
"""Strict cap on the speed [m/s], low enough for the walking robot to follow."""
MAX_DRIFT = 0.2
"""Greatest speed of a moving region [m/s]."""

PRIORITIES = (1, 1, 2, 2, 3)
"""Of the five regions, after the two strict walls; the first and the third are always in play."""
_FIRST_OF_2, _OF_3 = 2, 4
_DISC, _ELLIPSE = 0, 1  # a shape above is a regular polygon of that many corners
_X, _Y, _VX, _VY, _SHAPE, _RADIUS, _ASPECT, _ANGLE = range(8)
_N_UNIFORM = 9 + 7 * len(PRIORITIES)


class Layout(NamedTuple):
    """A random scene as numbers.

    Attributes:
        half_width: of the hall [m].
        goal: (2,) [m]; the start is the origin.
        regions: (5, 8) centre [m], velocity [m/s], shape, circumradius [m], ratio of an ellipse's
            semi-axes, angle [rad].
    """

    half_width: float
    goal: Array
    regions: Array


def draw(rng: np.random.Generator, moving: bool = False) -> Layout:
    """Return the scene that the generator decides.

    Args:
        rng: gives the same number of numbers for every scene.
        moving: let the relaxed regions drift that are not part of a conflict.
    """
    goal, regions = np.empty(2), np.zeros((len(PRIORITIES), 8))
    half_width = _lay_out(rng.random(_N_UNIFORM), moving, goal, regions)
    return Layout(half_width, goal, regions)


def scenario(name: str, layout: Layout) -> Scenario:
    """Return the scene as a `Scenario` of the given name."""
    return Scenario(
        name=name,
        barriers=(
            HalfPlane("left wall", 1, normal=(0.0, -1.0), offset=-layout.half_width),
            HalfPlane("right wall", 1, normal=(0.0, 1.0), offset=-layout.half_width),
            *(_barrier(i, region) for i, region in enumerate(layout.regions)),
        ),
        reference=PointReference(tuple(layout.goal)),
        task="reach",
        v_max=V_MAX,
    )


def _barrier(slot: int, region: Array) -> Barrier:
    x, y, vx, vy, shape, radius, aspect, angle = region.tolist()
    name, priority = f"region {slot + 1}", PRIORITIES[slot]
    if shape == _DISC:
        return Disc(name, priority, (x, y), radius, (vx, vy))
    if shape == _ELLIPSE:
        return Ellipse(name, priority, (x, y), (radius, aspect * radius), angle, (vx, vy))
    turn = angle + 2.0 * np.pi * np.arange(int(shape)) / shape
    corners = np.column_stack([x + radius * np.cos(turn), y + radius * np.sin(turn)])
    return ConvexPolygon(name, priority, tuple(map(tuple, corners)), (vx, vy))


@njit(cache=True)
def _lay_out(uniform: Array, moving: bool, goal: Array, regions: Array) -> float:
    """Write the goal and the regions; return the hall's half width."""
    half_width = 2.2 + 0.6 * uniform[0]
    length = 8.5 + 1.5 * uniform[1]
    goal[0], goal[1] = length, 1.2 * (2.0 * uniform[2] - 1.0)
    conflict = uniform[3] < CONFLICT_SHARE
    clear = 1.0 + 0.4 if conflict else START_CLEARANCE - 0.5 * GAP
    first, last = clear + (0.5 * GAP if conflict else 0.0), length - 0.6

    # which regions have a stretch of their own, and in which order
    order, n = np.empty(len(PRIORITIES), dtype=np.int64), 0
    for slot in range(len(PRIORITIES)):
        in_play = slot in (0, _FIRST_OF_2) or uniform[4 + slot] < 0.5
        if in_play and not (conflict and slot in (_FIRST_OF_2, _OF_3)):
            place = int(n * uniform[9 + 7 * slot])
            order[n], order[place], n = order[place], slot, n + 1

    for slot in range(len(PRIORITIES)):  # out of play: beyond a wall
        region = regions[slot]
        side = 1.0 if slot % 2 == 0 else -1.0
        region[_X], region[_Y], region[_RADIUS] = 0.5 * length, side * (half_width + 2.0), 0.5
        region[_ASPECT] = 1.0

    stretch = (last - first) / n
    for k in range(n):
        slot = order[k]
        region, chance = regions[slot], uniform[10 + 7 * slot : 16 + 7 * slot]
        radius = min(1.1, 0.5 * (stretch - GAP)) * (0.7 + 0.3 * chance[0])
        free = stretch - GAP - 2.0 * radius
        x = first + k * stretch + 0.5 * GAP + radius + free * chance[1]
        straight = goal[1] * x / length
        reach = half_width - GAP - radius
        y = min(max(straight + 0.5 * (2.0 * chance[2] - 1.0) * radius, -reach), reach)
        region[_X], region[_Y], region[_RADIUS] = x, y, radius
        region[_SHAPE] = (_DISC, _ELLIPSE, 3 + int(4.0 * chance[5]))[int(3.0 * chance[3])]
        region[_ASPECT], region[_ANGLE] = 0.5 + 0.5 * chance[5], 2.0 * np.pi * chance[4]
        if moving and PRIORITIES[slot] > 1:
            speed, heading = MAX_DRIFT * uniform[9 + 7 * slot], 2.0 * np.pi * chance[0]
            region[_VX], region[_VY] = speed * np.cos(heading), speed * np.sin(heading)

    if conflict:
        inner, outer = regions[_OF_3], regions[_FIRST_OF_2]
        heading = 2.0 * np.pi * uniform[10 + 7 * _OF_3]
        depth = 0.3 + 0.2 * uniform[11 + 7 * _OF_3]
        distance = 0.1 + 0.1 * uniform[12 + 7 * _OF_3]  # below the depth: the rows exclude another
        inner[_RADIUS] = 0.6 + 0.2 * uniform[13 + 7 * _OF_3]
        outer[_RADIUS] = 0.4 + 0.2 * uniform[14 + 7 * _OF_3]
        back, ahead = depth - inner[_RADIUS], distance + outer[_RADIUS]
        inner[_X], inner[_Y] = back * np.cos(heading), back * np.sin(heading)
        outer[_X], outer[_Y] = ahead * np.cos(heading), ahead * np.sin(heading)
    return half_width


@njit(cache=True)
def write(half_width: float, regions: Array, kind: NDArray[np.int64], parameters: Array) -> None:
    """Write a layout's walls and regions as `BarrierSet` holds them, without building a scene.

    Args:
        half_width: of the hall [m].
        regions: (5, 8) as in `Layout`.
        kind: (m,) which kernel evaluates each barrier.
        parameters: (m, 19) what it reads; entries beyond the seven barriers stay.
    """
    for wall in range(2):
        kind[wall] = layout.half_plane(parameters[wall], (0.0, 2.0 * wall - 1.0), -half_width)
    for slot in range(regions.shape[0]):
        region, c = regions[slot], parameters[2 + slot]
        center, velocity = (region[_X], region[_Y]), (region[_VX], region[_VY])
        shape, radius, angle = region[_SHAPE], region[_RADIUS], region[_ANGLE]
        if shape == _DISC:
            kind[2 + slot] = layout.disc(c, velocity, center, radius)
        elif shape == _ELLIPSE:
            semi_axes = (radius, region[_ASPECT] * radius)
            kind[2 + slot] = layout.ellipse(c, velocity, center, semi_axes, angle)
        else:
            vertices = np.empty((int(shape), 2))
            for i in range(int(shape)):
                turn = angle + 2.0 * np.pi * i / shape
                vertices[i, 0] = center[0] + radius * np.cos(turn)
                vertices[i, 1] = center[1] + radius * np.sin(turn)
            kind[2 + slot] = layout.convex_polygon(c, velocity, vertices)
