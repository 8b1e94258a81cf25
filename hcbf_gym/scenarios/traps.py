"""Random traps: U shapes, corners and dead ends on the straight line, open towards the start.

A policy that heads for the goal walks in and stays. Each of the two traps, one strict and one of
rank 2, has its own stretch of the hall, and leaves `PASSAGE` on one side at least: a path that
enters nothing exists by construction.
"""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.scenarios import hall
from hcbf_gym.scenarios.scene import Scene

PASSAGE = 1.0
"""Least passage beside a trap, and between the two [m]."""
THICKNESS = 0.3
"""Of the walls that a trap is built of [m]."""
RANKS = (1, 1, 1, 2, 2, 2)
"""Of the walls of the two traps."""
KINDS = ("u", "corner", "dead end")

BOTTOMS = (2.6, 5.7)
"""Distance of the traps' far ends from the start [m], before the hall is stretched."""

_WIDTH, _LENGTH, _GOAL, _ORDER = range(4)
_KIND, _ACROSS, _TILT, _SPAN, _DEPTH, _SIDE = range(6)


def draw(generator: np.random.Generator, scene: Scene) -> None:
    """Fill a scene of two walls and two traps; as many numbers decide every scene."""
    hall.check_count(scene, hall.WALLS + len(RANKS), exact=True)
    scene.ranks[hall.WALLS :] = RANKS
    goal = scene.goal
    drawn = generator.random(4)
    chances = generator.random((2, 6))
    half_width = 2.9 + 0.4 * drawn[_WIDTH]
    stretching = 1.0 + 0.1 * drawn[_LENGTH]
    length = 6.8 * stretching
    goal[0], goal[1] = length, 1.0 * (2.0 * drawn[_GOAL] - 1.0)
    regions = hall.build(scene, length, half_width)
    for k in range(2):
        slot = 3 * k if drawn[_ORDER] < 0.5 else 3 - 3 * k
        trap = regions[slot : slot + 3]
        back = stretching * BOTTOMS[k]
        kind = KINDS[int(3.0 * chances[k, _KIND])]
        if kind == "dead end":
            _dead_end(trap, chances[k], back, goal, half_width)
        else:
            _catch(trap, chances[k], back, goal, kind == "u")


def _catch(trap: Array, chance: Array, back: float, goal: Array, square: bool) -> None:
    """Write a U, or a corner of two walls, around the straight line; its bottom is at `back`."""
    tilt = 0.3 * (2.0 * chance[_TILT] - 1.0)
    span = 0.6 + 0.3 * chance[_SPAN]
    depth = 0.8 + 0.5 * chance[_DEPTH]
    y = goal[1] * back / goal[0] + 0.3 * (2.0 * chance[_ACROSS] - 1.0)
    cos, sin = np.cos(tilt), np.sin(tilt)
    if square:
        _wall(trap[0], (back + span * sin, y - span * cos), (back - span * sin, y + span * cos))
    for k in range(2):
        side = 2.0 * k - 1.0
        inner = side * span if square else 0.0
        near = (back - inner * sin, y + inner * cos)
        far = (
            back - depth * cos - side * span * sin,
            y - depth * sin + side * span * cos,
        )
        _wall(trap[1 + k], near, far)


def _dead_end(trap: Array, chance: Array, back: float, goal: Array, half_width: float) -> None:
    """Write a wall from one side of the hall across the straight line, with a hook at its end."""
    side = 1.0 if chance[_SIDE] < 0.5 else -1.0
    end = goal[1] * back / goal[0] - side * (0.6 + 0.3 * chance[_SPAN])
    depth = 0.7 + 0.4 * chance[_DEPTH]
    _wall(trap[0], (back, side * (half_width + 0.3)), (back, end))
    _wall(trap[1], (back, end), (back - depth, end))


def _wall(region: Array, near: hall.Point, far: hall.Point) -> None:
    hall.wall(region, near, far, THICKNESS, beyond=0.5 * THICKNESS)
