"""A unicycle of a few lines: a model from two functions, a barrier from one.

pip install -c constraints.txt -e ".[examples]"
"""

import gymnasium as gym
import jax.numpy as jnp
import numpy as np

import hcbf_gym
from hcbf_gym import models
from hcbf_gym.barriers import Function

AHEAD, T = 0.2, 0.02  # the barriers read the point so far in front of the wheels [m]; [s]

unicycle = models.ControlAffine(
    f=lambda x: 0.0 * x,
    g=lambda x: jnp.array([[jnp.cos(x[2]), 0.0], [jnp.sin(x[2]), 0.0], [0.0, 1.0]]),
    n=3,
    n_u=2,  # speed [m/s] and turn rate [rad/s]; the state is x, y, heading
)


class Drive(gym.Env):
    action_space = gym.spaces.Box(np.array([-1.0, -2.0]), np.array([1.0, 2.0]), dtype=np.float64)
    observation_space = gym.spaces.Box(-np.inf, np.inf, (3,), dtype=np.float64)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = np.array([-1.0, 0.05, 0.0]) if options is None else np.array(options["start"])
        return self.x.copy(), {}

    def step(self, action):
        self.x = unicycle.step(self.x, action, T)
        return self.x.copy(), 0.0, False, False, {}


def outside(center, radius):
    """Return h: the point ahead stays so far away that the wheels stay out of the disc."""

    def h(x, t):
        dx = x[0] + AHEAD * jnp.cos(x[2]) - center[0]
        dy = x[1] + AHEAD * jnp.sin(x[2]) - center[1]
        return jnp.sqrt(dx * dx + dy * dy) - radius - AHEAD

    return h


PILLARS = (((1.0, 0.0), 0.5), ((-0.8, 1.2), 0.4))
plant = hcbf_gym.Plant(
    model=unicycle,
    barriers=[Function(f"pillar {k}", 1, outside(*pillar)) for k, pillar in enumerate(PILLARS)],
    state=lambda env, observation, info: observation,
    period=T,
)


def make():
    return hcbf_gym.wrappers.SafetyFilter(Drive(), "lex-cbf-qp", plant=plant)


class Anywhere(Drive):
    """The same from a random start: what `hcbf certify unicycle.py:certify` draws."""

    def reset(self, *, seed=None, options=None):
        gym.Env.reset(self, seed=seed)
        low, high, clear = (-2.0, -2.0, -np.pi), (3.0, 3.0, np.pi), False
        while not clear:
            start = self.np_random.uniform(low, high)
            clear = min(barrier.h(start) for barrier in plant.barriers) > 0.05
        return super().reset(options={"start": start})


def certify():
    return Anywhere(), plant
