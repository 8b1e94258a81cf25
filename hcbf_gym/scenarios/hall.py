"""A random scene as numbers: a hall along +x between two strict walls, and ranked regions in it.

A layout becomes a `Scenario`, or goes straight into the arrays of a `BarrierSet`, fifty times
faster; a test holds the two together.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import Barrier, ConvexPolygon, Disc, Ellipse, HalfPlane
from hcbf_gym.scenarios.references import PointReference
from hcbf_gym.scenarios.scenario import Scenario

V_MAX = 1.0
"""Strict cap on the speed [m/s], low enough for the walking robot to follow."""

DISC, ELLIPSE, BOX = 0, 1, 2  # a shape above is a regular polygon of that many corners
X, Y, VX, VY, SHAPE, RADIUS, ASPECT, ANGLE = range(8)


class Layout(NamedTuple):
    """A random scene as numbers.

    Attributes:
        half_width: of the hall [m].
        goal: (2,) [m].
        regions: (k, 8) centre [m], velocity [m/s], shape, circumradius, or half the length of a box
            [m], ratio of the other semi-axis or side to it, angle [rad].
        priorities: of the k regions; the walls are strict.
        start: (2,) [m].
    """

    half_width: float
    goal: Array
    regions: Array
    priorities: tuple[int, ...]
    start: tuple[float, float] = (0.0, 0.0)

    def scenario(self, name: str) -> Scenario:
        """Return the scene as a `Scenario` of the given name."""
        walls = (("left wall", -1.0), ("right wall", 1.0))
        ranked = enumerate(zip(self.priorities, self.regions, strict=True))
        return Scenario(
            name=name,
            barriers=(
                *(HalfPlane(wall, 1, (0.0, side), -self.half_width) for wall, side in walls),
                *(_barrier(f"region {k + 1}", rank, region) for k, (rank, region) in ranked),
            ),
            reference=PointReference(tuple(self.goal)),
            start=self.start,
            task="reach",
            v_max=V_MAX,
        )

    def write(self, kind: Integers, parameters: Array) -> None:
        """Write the barriers (m,), (m, 19) as a `BarrierSet` holds them, without a `Scenario`."""
        write(self.half_width, self.regions, kind, parameters)


def _barrier(name: str, priority: int, region: Array) -> Barrier:
    x, y, vx, vy, shape, radius, aspect, angle = region.tolist()
    if shape == DISC:
        return Disc(name, priority, (x, y), radius, (vx, vy))
    if shape == ELLIPSE:
        return Ellipse(name, priority, (x, y), (radius, aspect * radius), angle, (vx, vy))
    return ConvexPolygon(name, priority, tuple(map(tuple, corners(region))), (vx, vy))


def hide(regions: Array, length: float, half_width: float) -> None:
    """Put every region out of play: a disc beyond a wall, beside the middle of the hall."""
    for k in range(regions.shape[0]):
        side = 1.0 if k % 2 == 0 else -1.0
        regions[k] = 0.0
        regions[k, X], regions[k, Y] = 0.5 * length, side * (half_width + 2.0)
        regions[k, RADIUS], regions[k, ASPECT] = 0.5, 1.0


def room_beside(way: Array, x: float, y: float, clear: float, clear_ends: float) -> float:
    """Return the greatest circumradius that a region at (x, y) may have beside a way [m].

    Args:
        way: (k, 2) the points that it joins [m].
        x: of the region [m].
        y: of the region [m].
        clear: what stays free on both sides of the way [m].
        clear_ends: what stays free around its first and its last point [m].
    """
    last = way.shape[0] - 1
    from_start = np.hypot(x - way[0, 0], y - way[0, 1])
    from_goal = np.hypot(x - way[last, 0], y - way[last, 1])
    room = min(from_start, from_goal) - clear_ends
    for k in range(last):
        ex, ey = way[k + 1, 0] - way[k, 0], way[k + 1, 1] - way[k, 1]
        ox, oy = x - way[k, 0], y - way[k, 1]
        along = min(max((ox * ex + oy * ey) / (ex * ex + ey * ey), 0.0), 1.0)
        room = min(room, np.hypot(ox - along * ex, oy - along * ey) - clear)
    return room


def corners(region: Array) -> Array:
    """Return (k, 2) the corners of a polygon or box, counter-clockwise."""
    x, y, radius, angle = region[X], region[Y], region[RADIUS], region[ANGLE]
    if region[SHAPE] == BOX:
        cos = np.cos(angle)
        sin = np.sin(angle)
        other = region[ASPECT] * radius
        box = np.empty((4, 2))
        for i, (along, across) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
            box[i, 0] = x + along * radius * cos - across * other * sin
            box[i, 1] = y + along * radius * sin + across * other * cos
        return box
    regular = np.empty((int(region[SHAPE]), 2))
    for i in range(len(regular)):
        turn = angle + 2.0 * np.pi * i / region[SHAPE]
        regular[i, 0], regular[i, 1] = x + radius * np.cos(turn), y + radius * np.sin(turn)
    return regular


def write(half_width: float, regions: Array, kind: Integers, parameters: Array) -> None:
    """Write a layout's walls and regions as `BarrierSet` holds them, without building a scene.

    Args:
        half_width: of the hall [m].
        regions: (k, 8) as in `Layout`.
        kind: (m,) which kernel evaluates each barrier.
        parameters: (m, 19) what it reads; entries beyond the walls and the regions stay.
    """
    for wall in range(2):
        kind[wall] = _core.half_plane_write(parameters[wall], (0.0, 2.0 * wall - 1.0), -half_width)
    for k in range(regions.shape[0]):
        region = regions[k]
        c = parameters[2 + k]
        center, velocity = (region[X], region[Y]), (region[VX], region[VY])
        shape, radius = region[SHAPE], region[RADIUS]
        if shape == DISC:
            kind[2 + k] = _core.disc_write(c, velocity, center, radius)
        elif shape == ELLIPSE:
            semi_axes = (radius, region[ASPECT] * radius)
            kind[2 + k] = _core.ellipse_write(c, velocity, center, semi_axes, region[ANGLE])
        else:
            kind[2 + k] = _core.convex_polygon_write(c, velocity, corners(region))
