"""The arrays of a random scene, and its barriers."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import Barrier, ConvexPolygon, Disc, Ellipse, HalfPlane
from hcbf_gym.barriers.set import BarrierSet

HALF_PLANE = -1
"""Code of a half-plane in `Scene.shapes`; codes from 3 on are polygons of so many corners."""
DISC = 0
"""Code of a disc."""
ELLIPSE = 1
"""Code of an ellipse."""
BOX = 2
"""Code of a box."""
SHAPE, X, Y, RADIUS, ASPECT, ANGLE = range(6)
"""Columns of `Scene.shapes`."""


class Scene(NamedTuple):
    """The arrays of a random scene of m shapes, or with a leading axis those of N.

    Attributes:
        shapes: (m, 6) code; centre x, y [m]; circumradius, or half the length of a box [m]; ratio
            of the other semi-axis or side to it; angle [rad]. Of a half plane: code, unit normal
            into the allowed side, and n·p on the wall [m]. NaN until they are filled.
        ranks: (m,) 1 is the highest and strict, as at first; no rank may be left out.
        velocities: (m, 2) [m/s], zero at first; a half plane has none.
        start: (2,) [m], the origin at first.
        goal: (2,) [m], NaN until it is filled.
    """

    shapes: Array
    ranks: Integers
    velocities: Array
    start: Array
    goal: Array

    @classmethod
    def unfilled(cls, *shape: int) -> "Scene":
        """Return a scene of (m,) shapes, or (N, m)."""
        many, shapes = shape[:-1], np.full((*shape, 6), np.nan)
        shapes[..., ASPECT], shapes[..., ANGLE] = 1.0, 0.0
        start, goal = np.zeros((*many, 2)), np.full((*many, 2), np.nan)
        return cls(shapes, np.ones(shape, dtype=np.int64), np.zeros((*shape, 2)), start, goal)

    def one(self, i: int) -> "Scene":
        """Return scene `i` of N; what is written to it is written here."""
        return Scene(*(array[i] for array in self))


def write(scene: Scene, i: int, into: BarrierSet) -> None:
    """Write a scene into environment `i` of a set, without an object for a barrier."""
    m = len(scene.ranks)
    kind, parameters = into.kind[i], into.parameters[i]
    rows = zip(scene.shapes.tolist(), scene.velocities.tolist(), parameters, strict=False)
    for k, (row, velocity, c) in enumerate(rows):
        code, x, y, radius, aspect, angle = row
        if code == HALF_PLANE:
            kind[k] = _core.half_plane_write(c, (x, y), radius)
        elif code == DISC:
            kind[k] = _core.disc_write(c, velocity, (x, y), radius)
        elif code == ELLIPSE:
            kind[k] = _core.ellipse_write(c, velocity, (x, y), (radius, aspect * radius), angle)
        else:
            kind[k] = _core.convex_polygon_write(c, velocity, corners(row))
    into.priority[i, :m], into.keeps_margin[i, :m] = scene.ranks, scene.ranks == 1
    into.changed(i)


def barrier(name: str, rank: int, row: Sequence[float], velocity: Any) -> Barrier:
    """Return a row of `Scene.shapes` as an object."""
    code, x, y, radius, aspect, angle = row
    if code == HALF_PLANE:
        return HalfPlane(name, rank, (x, y), radius)
    if code == DISC:
        return Disc(name, rank, (x, y), radius, velocity)
    if code == ELLIPSE:
        return Ellipse(name, rank, (x, y), (radius, aspect * radius), angle, velocity)
    return ConvexPolygon(name, rank, tuple(map(tuple, corners(row))), velocity)


def corners(row: Sequence[float]) -> Array:
    """Return (k, 2) the corners of a polygon or box, counter-clockwise."""
    code, x, y, radius, aspect, angle = row
    if code == BOX:
        cos, sin = np.cos(angle), np.sin(angle)
        other = aspect * radius
        box = np.empty((4, 2))
        for i, (along, across) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
            box[i, 0] = x + along * radius * cos - across * other * sin
            box[i, 1] = y + along * radius * sin + across * other * cos
        return box
    regular = np.empty((int(code), 2))
    for i in range(len(regular)):
        turn = angle + 2.0 * np.pi * i / code
        regular[i, 0], regular[i, 1] = x + radius * np.cos(turn), y + radius * np.sin(turn)
    return regular
