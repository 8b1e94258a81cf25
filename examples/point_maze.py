"""PointMaze of gymnasium-robotics behind the filter: the ball never touches a wall.

pip install 'hcbf-gym[examples]'
"""

import gymnasium as gym
import gymnasium_robotics
import numpy as np

import hcbf_gym
from hcbf_gym import models
from hcbf_gym.barriers import ConvexPolygon

gym.register_envs(gymnasium_robotics)

GAIN, DRAG = 100.0 / 4.19, 1.0 / 4.19  # the ball: v̇ = (100 a − v) / 4.19, measured
RADIUS = 0.1  # of the ball [m]


def walls(maze):
    """Return a box for each row of wall cells and each column of several, grown by RADIUS."""
    grid = np.array([[cell == 1 for cell in row] for row in maze.maze_map])
    barriers = []
    for cells, upright in ((grid, False), (grid.T, True)):
        for i, line in enumerate(cells):
            edges = np.flatnonzero(np.diff(np.concatenate(([0], line, [0])).astype(int)))
            for start, end in zip(edges[::2], edges[1::2] - 1, strict=True):
                if upright and start == end:
                    continue
                ends = np.array([(start, i), (end, i)] if upright else [(i, start), (i, end)])
                centers = np.array([maze.cell_rowcol_to_xy(cell) for cell in ends])
                (x0, y0), (x1, y1) = centers.min(0) - 0.5 - RADIUS, centers.max(0) + 0.5 + RADIUS
                corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
                barriers.append(ConvexPolygon(f"wall {len(barriers)}", 1, vertices=corners))
    return barriers


def make(name="PointMaze_UMaze-v3", **options):
    """Return the maze behind the filter."""
    env = gym.make(name, continuing_task=False, **options)
    plant = hcbf_gym.Plant(
        model=models.DoubleIntegrator(drag=DRAG),
        barriers=walls(env.unwrapped.maze),
        state=lambda env, observation, info: observation["observation"],
        input_set=models.Box.symmetric(GAIN),
        to_action=lambda u: (u / GAIN).astype(np.float32),
        from_action=lambda action: GAIN * np.asarray(action, dtype=np.float64),
        period=0.01,
    )
    return hcbf_gym.wrappers.SafetyFilter(env, "lex-cbf-qp", plant=plant, rows="usual", margin=0.01)


def touches(env):
    """Return whether the ball touches a wall now."""
    return any(contact.dist < 0.0 for contact in env.unwrapped.data.contact)


if __name__ == "__main__":
    env = make()
    env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(300):
        env.step(env.action_space.sample())
        assert not touches(env)
