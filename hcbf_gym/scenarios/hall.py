"""A hall along +x between two strict walls, in which families of random scenes put regions."""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.scenarios.scene import DISC, HALF_PLANE, RADIUS, Scene

WALLS = 2
"""The first shapes of a scene in a hall."""


def build(scene: Scene, length: float, half_width: float) -> Array:
    """Write the two walls; return the other shapes (m − 2, 6), which are out of play for now.

    Such a region is a disc beyond a wall, beside the middle of the hall.
    """
    for k, side in enumerate((-1.0, 1.0)):
        scene.shapes[k, : RADIUS + 1] = HALF_PLANE, 0.0, side, -half_width
    regions = scene.shapes[WALLS:]
    for k, region in enumerate(regions):
        side = 1.0 if k % 2 == 0 else -1.0
        region[: RADIUS + 1] = DISC, 0.5 * length, side * (half_width + 2.0), 0.5
    return regions


def check_count(scene: Scene, least: int, most: int | None = None) -> None:
    """Refuse scenes of so many shapes, walls included.

    Raises:
        InvalidInputError: if a family cannot fill them.
    """
    m = len(scene.ranks)
    if m < least or (most is not None and m > most):
        raise InvalidInputError(
            f"shapes: got {m}, expected {least}{'' if most == least else ' or more'}"
        )


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
