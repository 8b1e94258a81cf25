"""A family of one's own, as a user's file registers it: two walls and k ponds."""

import numpy as np

from hcbf_gym import scenarios
from hcbf_gym.scenarios import DISC, ELLIPSE, HALF_PLANE, Hooks

PONDS = 4


def draw(generator, scene):
    """A row of ponds of random ranks, of which the last drifts."""
    numbers = generator.random(3 + 4 * PONDS)
    scene.start[:] = 0.2 * numbers[0], 0.1
    scene.goal[:] = 3.0 + numbers[1], numbers[2] - 0.5
    for k, side in enumerate((1.0, -1.0)):
        scene.shapes[k, :4] = HALF_PLANE, 0.0, side, -2.0
    for k in range(PONDS):
        x, y, radius, turn = numbers[3 + 4 * k : 7 + 4 * k]
        shape = DISC if turn < 0.5 else ELLIPSE
        at = 1.2 + 0.9 * k, 2.0 * y - 1.0
        scene.shapes[2 + k] = shape, *at, 0.1 + 0.3 * radius, 0.5 + 0.5 * x, turn
    scene.ranks[3:] = np.where(numbers[10::4] > 0.5, 2, 3)
    scene.ranks[2] = 2
    scene.velocities[-1] = 0.0, 0.1 * numbers[0]


def draw_many(generators, scenes):
    """The same for N: here one after the other."""
    for i, generator in enumerate(generators):
        draw(generator, scenes.one(i))


def observe(x, reference, sensed):
    """Where the goal is, and the least h: four numbers."""
    return np.column_stack([reference[:, :2] - x[:, :2], x[:, 2], sensed[:, :, 0].min(axis=1)])


def reward(moment):
    """The speed towards the goal, without what it takes."""
    return moment.x[:, 0] - moment.before[:, 0] - 0.01 * np.abs(moment.u[:, 0])


def costs(moment):
    """How near the nearest condition came, and how fast the robot is."""
    return np.column_stack([moment.min_h.min(axis=1), np.abs(moment.x[:, 2])])


scenarios.register("tarn", draw, shapes=2 + PONDS, v_max=0.8, draw_many=draw_many)
scenarios.register("tarn-seen", draw, shapes=2 + PONDS, hooks=Hooks(observe, reward, costs))
