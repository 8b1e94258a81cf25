"""Scene: the arrays of a random scene, and the barriers that they describe."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import Barrier, ConvexPolygon, Disc, Ellipse, HalfPlane
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError, shown

HALF_PLANE = -1
"""Code of a half-plane in `Scene.shapes`; codes from 3 on are polygons of so many corners."""
DISC = 0
"""Code of a disc."""
ELLIPSE = 1
"""Code of an ellipse."""
BOX = 2
"""Code of a box."""
MAX_CORNERS = 8  # of a polygon
SHAPE, X, Y, RADIUS, ASPECT, ANGLE = range(6)
"""Columns of `Scene.shapes`."""


class Scene(NamedTuple):
    """The arrays of a random scene of m shapes, or with a leading axis those of N.

    Attributes:
        shapes: (m, 6) code; centre x, y [m]; circumradius, or half the length of a box [m]; ratio
            of the other semi-axis or side to it; angle [rad]. Of a half plane: code, unit normal
            into the allowed side, and n·p on the wall [m]. NaN until they are filled.
        ranks: (m,) 1 is strict and the highest; no rank may be left out. All are 1 at first.
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
        """Return a scene with the shape (m,) of its ranks, or N scenes with (N, m)."""
        batch, shapes = shape[:-1], np.full((*shape, 6), np.nan)
        shapes[..., ASPECT], shapes[..., ANGLE] = 1.0, 0.0
        start, goal = np.zeros((*batch, 2)), np.full((*batch, 2), np.nan)
        return cls(shapes, np.ones(shape, dtype=np.int64), np.zeros((*shape, 2)), start, goal)

    def one(self, i: int) -> "Scene":
        """Return scene `i` of N as views: a write to its arrays writes to these."""
        return Scene(*(array[i] for array in self))


def write(scene: Scene, i: int, into: BarrierSet) -> None:
    """Write a scene's barriers into scene `i` of a set, without an object for each of them."""
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
            kind[k] = _core.convex_polygon_write(c, velocity, _corners(row))
    into.priority[i, :m], into.keeps_margin[i, :m] = scene.ranks, scene.ranks == 1
    into.changed(i)


def check_filled(family: str, scenes: Scene) -> None:
    """Refuse scenes (N, …) of a family with arrays that are not filled."""
    for name, array in zip(Scene._fields, scenes, strict=True):
        if not np.isfinite(array).all():
            raise InvalidInputError(
                f"family {family!r}: got {shown(array)} for the {name}, expected finite numbers; "
                "draw(generator, scene) must fill all of them"
            )


def check_shapes(family: str, scenes: Scene) -> None:
    """Refuse scenes (N, …) of a family with a code or a size that no shape has."""
    shapes = scenes.shapes
    code, radius, aspect = shapes[..., SHAPE], shapes[..., RADIUS], shapes[..., ASPECT]
    is_code = (code == np.floor(code)) & (code >= HALF_PLANE) & (code <= MAX_CORNERS)
    normal_length = np.hypot(shapes[..., X], shapes[..., Y])
    is_at_rest = (scenes.velocities == 0.0).all(axis=-1)
    is_sound_wall = is_at_rest & (np.abs(normal_length - 1.0) < 1e-9)
    is_sound_region = (radius > 0.0) & (aspect > 0.0)
    is_sound = is_code & np.where(code == HALF_PLANE, is_sound_wall, is_sound_region)
    if not is_sound.all():
        raise InvalidInputError(
            f"family {family!r}: got the shape {shapes[~is_sound][0].tolist()}, expected a code "
            f"from {HALF_PLANE} to {MAX_CORNERS} with a positive radius, or a half plane's unit "
            "normal and no velocity"
        )


def check_ranks(family: str, ranks: Integers) -> None:
    """Refuse a family's ranks (N, m) that are not 1, 2, … in each scene."""
    last = ranks.max(axis=1, initial=0)
    numbers = np.arange(1, last.max(initial=0) + 1)
    is_present = (ranks[:, None] == numbers[:, None]).any(axis=2)
    is_sound = (is_present | (numbers > last[:, None])).all(axis=1) & (ranks >= 1).all(axis=1)
    if not is_sound.all():
        raise InvalidInputError(
            f"family {family!r}: got the ranks {ranks[~is_sound][0].tolist()}, expected 1, 2, … "
            "without a gap"
        )


def barriers_of(scene: Scene) -> tuple[Barrier, ...]:
    """Return the barriers of a scene, with the names "wall 1", … and "region 1", … in order."""
    walls, barriers = 0, []
    for k, row in enumerate(scene.shapes.tolist()):
        is_wall = row[SHAPE] == HALF_PLANE
        walls += is_wall
        name = f"wall {walls}" if is_wall else f"region {k + 1 - walls}"
        barriers.append(_barrier(name, int(scene.ranks[k]), row, scene.velocities[k].tolist()))
    return tuple(barriers)


def _barrier(name: str, rank: int, row: Sequence[float], velocity: Any) -> Barrier:
    """Return the barrier that a row of `Scene.shapes` describes."""
    code, x, y, radius, aspect, angle = row
    if code == HALF_PLANE:
        return HalfPlane(name, rank, (x, y), radius)
    if code == DISC:
        return Disc(name, rank, (x, y), radius, velocity)
    if code == ELLIPSE:
        return Ellipse(name, rank, (x, y), (radius, aspect * radius), angle, velocity)
    return ConvexPolygon(name, rank, tuple(map(tuple, _corners(row))), velocity)


def _corners(row: Sequence[float]) -> Array:
    """Return (k, 2) the corners of a polygon's or box's row, counter-clockwise [m]."""
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
