"""A boat among buoys in gusts that its model does not know: `hcbf certify boat.py:certify`.

The margins are not typed in: calibration measures what gusts and drag take.
"""

import gymnasium as gym
import numpy as np

import hcbf_gym
from hcbf_gym import barriers, models

T, U = 0.05, models.Ball(3.0)  # [s], [m/s²]
DRAG, GUST = 0.1, 0.5  # [1/s], [m/s²]


class Boat(gym.Env):
    action_space = gym.spaces.Box(-3.0, 3.0, (2,), dtype=np.float64)
    observation_space = gym.spaces.Box(-np.inf, np.inf, (4,), dtype=np.float64)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        draw = self.np_random.uniform
        at = [(draw(2.0, 4.0), angle + draw(0.0, 1.0)) for angle in (0.0, 2.1, 4.2)]
        self.buoys = [
            barriers.Disc(f"buoy {k}", 1, (r * np.cos(a), r * np.sin(a)), draw(0.3, 0.8))
            for k, (r, a) in enumerate(at)
        ] + [barriers.SpeedLimit("speed", 1, 1.5)]
        self.x = np.zeros(4)
        return self.x.copy(), self.infos([self.x])

    def step(self, action):
        path = []
        for _ in range(10):  # physics at 200 Hz
            gust = GUST * self.np_random.normal(size=2)
            self.x[2:] += T / 10.0 * (action - DRAG * self.x[2:] + gust)
            self.x[:2] += T / 10.0 * self.x[2:]
            path.append(self.x.copy())
        return self.x.copy(), 0.0, False, False, self.infos(path)

    def infos(self, path):
        return {"min_h": np.array([min(b.h(x) for x in path) for b in self.buoys])}


def certify():
    plant = hcbf_gym.Plant(
        model=models.DoubleIntegrator(),
        barriers=lambda env, observation, info: env.buoys,
        state=lambda env, observation, info: env.x.copy(),
        input_set=U,
        period=T,
    )
    return Boat(), plant
