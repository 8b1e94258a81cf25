"""Random crossings: a hall with three lanes of discs that move across it, faster than the robot.

A lane is so long that discs arrive during a whole episode and none jumps. All discs of a lane have
one speed and one rank, and every scene has lanes of both ranks.
"""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.scenarios import hall
from hcbf_gym.scenarios.scene import DISC, RADIUS, SHAPE, Scene, X, Y

LANES = (2.0, 4.0, 6.0)
"""Where the lanes cross the hall [m]."""
RANKS = ((1, 1, 2), (1, 2, 1), (2, 1, 1), (1, 2, 2), (2, 1, 2), (2, 2, 1))
"""Of the three lanes."""
DISCS = 12
"""Of each lane."""
SPEED = (0.9, 1.5)
"""Of a lane [m/s]."""
GAP = (2.2, 4.5)
"""Between the centres of two discs of a lane [m]."""
SIZE, HALF_WIDTH, LENGTH = 0.5, 3.0, 8.0
"""Radius of the discs, half of the hall's width, and how far the goal is [m]."""
CHANGES = 0.01
"""Chance that a lane whose intentions are hidden has another speed after a control step."""
HIDDEN = (0.2, 1.5)
"""Its speeds then [m/s]."""


def draw(generator: np.random.Generator, scene: Scene) -> None:
    """Fill a scene of two walls and three lanes; as many numbers decide every scene."""
    hall.check_count(scene, hall.WALLS + len(LANES) * DISCS, exact=True)
    rank, start, *drawn = generator.random(2 + len(LANES) * (2 + DISCS)).tolist()
    chances = np.reshape(drawn, (len(LANES), 2 + DISCS))
    scene.start[1], scene.goal[:] = 0.5 * HALF_WIDTH * (2.0 * start - 1.0), (LENGTH, 0.0)
    hall.build(scene, LENGTH, HALF_WIDTH)
    ranks = RANKS[int(len(RANKS) * rank)]
    for k, (side, speed, *gaps) in enumerate(chances):
        lane = _lane(k)
        ahead = 1.0 if side < 0.5 else -1.0
        behind = np.cumsum(GAP[0] + (GAP[1] - GAP[0]) * np.array(gaps)) - GAP[0]
        discs = scene.shapes[lane]
        discs[:, SHAPE], discs[:, X], discs[:, RADIUS] = DISC, LANES[k], SIZE
        discs[:, Y] = ahead * (HALF_WIDTH - behind)
        scene.ranks[lane] = ranks[k]
        scene.velocities[lane, 1] = ahead * (SPEED[0] + (SPEED[1] - SPEED[0]) * speed)


def redraw(generator: np.random.Generator, velocities: Array) -> None:
    """Let lanes change their speeds (m, 2) [m/s] at a step's end, and continue in their direction.

    On average a lane does so every two seconds.
    """
    for k, (chance, speed) in enumerate(generator.random((len(LANES), 2)).tolist()):
        if chance < CHANGES:
            along = velocities[_lane(k), 1]
            along[:] = np.sign(along) * (HIDDEN[0] + (HIDDEN[1] - HIDDEN[0]) * speed)


def _lane(k: int) -> slice:
    """Return where the discs of lane `k` are in a scene."""
    first = hall.WALLS + k * DISCS
    return slice(first, first + DISCS)
