"""Random crossings: a hall with three lanes of discs that move across it, faster than the robot.

A lane is so long that discs arrive during a whole episode and none jumps. All discs of a lane have
one speed and one rank, and every scene has lanes of both ranks.
"""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.scenarios import hall
from hcbf_gym.scenarios.scene import DISC, RADIUS, SHAPE, Scene, X, Y

LANES = (2.0, 4.0, 6.0)  # x at which the lanes cross the hall [m]
RANKS = ((1, 1, 2), (1, 2, 1), (2, 1, 1), (1, 2, 2), (2, 1, 2), (2, 2, 1))  # of the three lanes
DISCS = 12  # in each lane
SPEED = (0.9, 1.5)  # range of a lane's speed [m/s]
GAP = (2.2, 4.5)  # range of the distance between the centres of two discs of a lane [m]
DISC_RADIUS = 0.5  # [m]
HALF_WIDTH, LENGTH = 3.0, 8.0  # half of the hall's width, and x of the goal [m]
CHANGE_CHANCE = 0.01  # of another speed after a control step, where intentions are hidden
HIDDEN = (0.2, 1.5)  # range of a lane's speed after such a change [m/s]


def draw(generator: np.random.Generator, scene: Scene) -> None:
    """Fill a scene of two walls and three lanes; every scene takes as many random numbers."""
    hall.check_count(scene, hall.WALLS + len(LANES) * DISCS, exact=True)
    by_ranks, by_start, *rest = generator.random(2 + len(LANES) * (2 + DISCS)).tolist()
    scene.start[1] = 0.5 * HALF_WIDTH * (2.0 * by_start - 1.0)
    scene.goal[:] = LENGTH, 0.0
    hall.build(scene, LENGTH, HALF_WIDTH)
    ranks = RANKS[int(len(RANKS) * by_ranks)]
    for k, (by_side, by_speed, *by_gaps) in enumerate(np.reshape(rest, (len(LANES), -1))):
        lane = _lane(k)
        direction = 1.0 if by_side < 0.5 else -1.0  # of the lane's motion along y
        behind_first = np.cumsum(GAP[0] + (GAP[1] - GAP[0]) * np.array(by_gaps)) - GAP[0]
        discs = scene.shapes[lane]
        discs[:, SHAPE], discs[:, X], discs[:, RADIUS] = DISC, LANES[k], DISC_RADIUS
        discs[:, Y] = direction * (HALF_WIDTH - behind_first)
        scene.ranks[lane] = ranks[k]
        scene.velocities[lane, 1] = direction * (SPEED[0] + (SPEED[1] - SPEED[0]) * by_speed)


def redraw(generator: np.random.Generator, velocities: Array) -> None:
    """Change the speed of a lane at a control step's end, on average every two seconds.

    The lane's direction stays. `velocities` (m, 2) [m/s] are those of all shapes.
    """
    for k, (chance, speed) in enumerate(generator.random((len(LANES), 2)).tolist()):
        if chance < CHANGE_CHANCE:
            along = velocities[_lane(k), 1]
            along[:] = np.sign(along) * (HIDDEN[0] + (HIDDEN[1] - HIDDEN[0]) * speed)


def _lane(k: int) -> slice:
    """Return the rows of lane k's discs in a scene's arrays."""
    first = hall.WALLS + k * DISCS
    return slice(first, first + DISCS)
