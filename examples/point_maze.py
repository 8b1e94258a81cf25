"""PointMaze of gymnasium-robotics behind the filter: the ball arrives and never touches a wall.

One step of MuJoCo is v⁺ = v + T w, p⁺ = p + T v⁺ with w = (100 a − v) / MASS, so that p − T v / 2
moves exactly as a double integrator does under a held w.
pip install -c constraints.txt -e ".[examples]"
"""

import gymnasium as gym
import gymnasium_robotics
import numpy as np

import hcbf_gym
from hcbf_gym import models
from hcbf_gym.barriers import ConvexPolygon
from hcbf_gym.models import Uncertainty

gym.register_envs(gymnasium_robotics)

T, GAIN, TOP_SPEED = 0.01, 100.0, 5.0  # [s], [N], [m/s]
MASS = 4000.0 / 3.0 * np.pi * 0.1**3 + T  # [kg]; T for the drag, which MuJoCo takes implicitly


def walls(maze):
    """Return a box for each row of wall cells, and for each column of several."""
    grid, barriers = np.array([[cell == 1 for cell in row] for row in maze.maze_map]), []
    for cells, step in ((grid, (0, 1)), (grid.T, (1, 0))):
        for i, line in enumerate(cells):
            edges = np.flatnonzero(np.diff(np.concatenate(([0], line, [0]))))
            for start, end in zip(edges[::2], edges[1::2] - 1, strict=True):
                if start < end or step == (0, 1):
                    ends = [np.array((i, i)) + np.array(step) * (k - i) for k in (start, end)]
                    centers = np.array([maze.cell_rowcol_to_xy(cell) for cell in ends])
                    (x0, y0), (x1, y1) = centers.min(0) - 0.5, centers.max(0) + 0.5
                    corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
                    barriers.append(ConvexPolygon(f"wall {len(barriers)}", 1, vertices=corners))
    return barriers


def make(name="PointMaze_UMaze-v3", guidance="geodesic", **options):
    """Return the maze behind the filter."""
    env = gym.make(name, continuing_task=False, **options)
    ball, maze = env.unwrapped, env.unwrapped.maze

    def velocity():
        return np.clip(ball.data.qvel, -TOP_SPEED, TOP_SPEED)  # as the environment does

    plant = hcbf_gym.Plant(
        model=models.DoubleIntegrator(),
        barriers=walls(maze),
        state=lambda *_: np.concatenate((ball.data.qpos - 0.5 * T * velocity(), velocity())),
        input_set=models.Box.symmetric((GAIN - TOP_SPEED) / MASS),  # at every speed
        to_action=lambda w: ((MASS * w + velocity()) / GAIN).astype(np.float32),
        from_action=lambda action: (GAIN * np.array(action, dtype=float) - velocity()) / MASS,
        period=T,
        goal=lambda *_: ball.goal,
        extent=np.array([[-1, -1], [1, 1]]) * (maze.x_map_center, maze.y_map_center),
        uncertainty=Uncertainty(distance=0.003, body=0.1),  # contacts push from 2 mm on
    )
    return hcbf_gym.wrappers.SafetyFilter(env, "lex-cbf-qp", plant=plant, guidance=guidance)
