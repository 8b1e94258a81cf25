"""A hall along +x between two strict walls, in which families of random scenes put regions."""

from itertools import pairwise

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.scenarios.scene import (
    ANGLE,
    ASPECT,
    BOX,
    DISC,
    ELLIPSE,
    HALF_PLANE,
    RADIUS,
    SHAPE,
    Scene,
    X,
    Y,
)

Point = tuple[float, float]
WALLS = 2  # the first shapes of a scene in a hall


def build(scene: Scene, length: float, half_width: float) -> Array:
    """Write the two walls of a hall; return the other shapes (m − 2, 6).

    Those are out of play until they are written: discs beyond a wall, beside the hall's middle.
    """
    for k, side in enumerate((-1.0, 1.0)):
        scene.shapes[k, : RADIUS + 1] = HALF_PLANE, 0.0, side, -half_width
    regions = scene.shapes[WALLS:]
    for k, region in enumerate(regions):
        side = 1.0 if k % 2 == 0 else -1.0
        region[: RADIUS + 1] = DISC, 0.5 * length, side * (half_width + 2.0), 0.5
    return regions


def wall(region: Array, near: Point, far: Point, thickness: float, beyond: float = 0.0) -> None:
    """Write a box whose axis runs from one point to another, and `beyond` [m] past both.

    The region (6,) is a row of `Scene.shapes`, as in all functions here.
    """
    dx, dy = far[0] - near[0], far[1] - near[1]
    half = 0.5 * np.hypot(dx, dy) + beyond
    region[SHAPE], region[RADIUS], region[ASPECT] = BOX, half, 0.5 * thickness / half
    region[X], region[Y] = 0.5 * (near[0] + far[0]), 0.5 * (near[1] + far[1])
    region[ANGLE] = np.arctan2(dy, dx)


def shape(region: Array, kind: float, turn: float, form: float) -> None:
    """Make a region a disc, an ellipse or a regular polygon, by random numbers in [0, 1).

    `kind` decides which of them, `turn` its angle, `form` its ratio of axes or number of corners.
    """
    polygon = 3 + int(4.0 * form)
    region[SHAPE] = (DISC, ELLIPSE, polygon)[int(3.0 * kind)]
    region[ASPECT], region[ANGLE] = 0.5 + 0.5 * form, 2.0 * np.pi * turn


def check_count(scene: Scene, least: int, exact: bool = False) -> None:
    """Refuse scenes of fewer shapes, walls included, or of more if the count is exact."""
    m = len(scene.ranks)
    if m < least or (exact and m > least):
        expected = f"{least}" if exact else f"{least} or more"
        raise InvalidInputError(f"shapes: got {m}, expected {expected}")


def room_beside(path: Array, x: float, y: float, clear: float, clear_ends: float) -> float:
    """Return the greatest circumradius that a region at (x, y) may have beside a path (k, 2) [m].

    It leaves `clear` [m] on both sides of the path, and `clear_ends` around its ends.
    """
    points, x, y = path.tolist(), float(x), float(y)  # Python's numbers are faster one by one
    (x0, y0), (x1, y1) = points[0], points[-1]
    room = min(np.hypot(x - x0, y - y0), np.hypot(x - x1, y - y1)) - clear_ends
    for (ax, ay), (bx, by) in pairwise(points):
        ex, ey = bx - ax, by - ay  # along the segment
        ox, oy = x - ax, y - ay
        along = min(max((ox * ex + oy * ey) / (ex * ex + ey * ey), 0.0), 1.0)  # nearest point
        room = min(room, np.hypot(ox - along * ex, oy - along * ey) - clear)
    return room
