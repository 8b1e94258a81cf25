"""Random traps: U shapes, corners and dead ends on the straight line, open towards the start.

A policy that heads for the goal walks in and stays. Each of the two traps, one strict and one of
rank 2, has its own stretch of the hall, and leaves `PASSAGE` on one side at least: a path that
enters nothing exists by construction.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.scenarios import hall
from hcbf_gym.scenarios.scene import Scene

PASSAGE = 1.0  # least passage beside a trap, and between the two [m]
THICKNESS = 0.3  # of the walls that a trap is built of [m]
RANKS = (1, 1, 1, 2, 2, 2)  # of the walls of the two traps
KINDS = ("u", "corner", "dead end")
BOTTOMS = (2.6, 5.7)  # x of the traps' far ends [m], before the hall is stretched


class TrapDraw(NamedTuple):
    """Random numbers in [0, 1) that decide a trap."""

    kind: float
    across: float  # position off the straight line, of a U or a corner
    tilt: float  # angle of a U or a corner
    span: float  # half of its width; of a dead end, how far it crosses the straight line
    depth: float  # length of the walls, or of a dead end's hook, towards the start
    side: float  # side of the hall from which a dead end comes


def draw(generator: np.random.Generator, scene: Scene) -> None:
    """Fill a scene of two walls and two traps; every scene takes as many random numbers."""
    hall.check_count(scene, hall.WALLS + len(RANKS), exact=True)
    scene.ranks[hall.WALLS :] = RANKS
    by_width, by_length, by_goal, by_order = generator.random(4).tolist()
    half_width, stretching = 2.9 + 0.4 * by_width, 1.0 + 0.1 * by_length
    length = 6.8 * stretching
    scene.goal[:] = length, 1.0 * (2.0 * by_goal - 1.0)
    regions = hall.build(scene, length, half_width)
    strict, relaxed = regions[:3], regions[3:]
    traps = (strict, relaxed) if by_order < 0.5 else (relaxed, strict)
    for trap, bottom, numbers in zip(traps, BOTTOMS, generator.random((2, 6)), strict=True):
        chance = TrapDraw(*numbers.tolist())
        kind = KINDS[int(3.0 * chance.kind)]
        if kind == "dead end":
            _dead_end(trap, chance, stretching * bottom, scene.goal, half_width)
        else:
            _catch(trap, chance, stretching * bottom, scene.goal, has_bottom=kind == "u")


def _catch(trap: Array, chance: TrapDraw, back: float, goal: Array, has_bottom: bool) -> None:
    """Write a corner of two walls around the straight line, open towards the start, or a U.

    Its far end is at x = `back` [m]. A U has a bottom, a third wall that joins the two.
    """
    tilt = 0.3 * (2.0 * chance.tilt - 1.0)
    span, depth = 0.6 + 0.3 * chance.span, 0.8 + 0.5 * chance.depth
    y = goal[1] * back / goal[0] + 0.3 * (2.0 * chance.across - 1.0)
    cos, sin = np.cos(tilt), np.sin(tilt)
    if has_bottom:
        _wall(trap[0], (back + span * sin, y - span * cos), (back - span * sin, y + span * cos))
    for wall, side in ((trap[1], -1.0), (trap[2], 1.0)):
        at_bottom = side * span if has_bottom else 0.0
        near = (back - at_bottom * sin, y + at_bottom * cos)
        far = (back - depth * cos - side * span * sin, y - depth * sin + side * span * cos)
        _wall(wall, near, far)


def _dead_end(trap: Array, chance: TrapDraw, back: float, goal: Array, half_width: float) -> None:
    """Write a wall from one side of the hall across the straight line, with a hook at its end."""
    side = 1.0 if chance.side < 0.5 else -1.0
    end = goal[1] * back / goal[0] - side * (0.6 + 0.3 * chance.span)
    depth = 0.7 + 0.4 * chance.depth
    _wall(trap[0], (back, side * (half_width + 0.3)), (back, end))
    _wall(trap[1], (back, end), (back - depth, end))


def _wall(region: Array, near: hall.Point, far: hall.Point) -> None:
    """Write a trap's wall from one point to another, whose ends overlap those of other walls."""
    hall.wall(region, near, far, THICKNESS, beyond=0.5 * THICKNESS)
