"""Pendulum-v1 behind the filter: no torque takes the pole more than 20 degrees from upright.

The pole can stay where the largest torque can still stop it in time. From the angle θ the speed
towards the limit may be √(c² + 2 E(θ)) − c, where E is the work that the braking torque does until
the limit, gravity's work taken off, and c what one sample costs.
pip install -c constraints.txt -e ".[examples]"
"""

import gymnasium as gym
import jax.numpy as jnp
import numpy as np

import hcbf_gym
from hcbf_gym import models
from hcbf_gym.barriers import Function

LIMIT = 0.35  # of the angle [rad]
T, GRAVITY, GAIN, TORQUE = 0.05, 15.0, 3.0, 2.0  # θ̈ = 15 sin θ + 3 u, |u| ≤ 2
C = 0.5 * T * GAIN * TORQUE

pendulum = models.ControlAffine(
    f=lambda x: jnp.array([x[1], GRAVITY * jnp.sin(x[0])]),
    g=lambda x: jnp.array([[0.0], [GAIN]]),
    n=2,
    n_u=1,
)


def stops_before(side):
    """Return h: by how much the speed towards a side's limit is below what can be stopped."""

    def h(x, t):
        angle, speed = side * x[0], side * x[1]
        work = GAIN * TORQUE * (LIMIT - angle) + GRAVITY * (np.cos(LIMIT) - jnp.cos(angle))
        return jnp.sqrt(C * C + 2.0 * jnp.maximum(work, 0.0)) - C - speed

    return h


barriers = (Function("right", 1, stops_before(1.0)), Function("left", 1, stops_before(-1.0)))


def make(**options):
    """Return the pendulum behind the filter; a reset starts within the limit."""
    plant = hcbf_gym.Plant(
        model=pendulum,
        barriers=barriers,
        state=lambda env, observation, info: env.state,
        period=T,
    )
    env = gym.make("Pendulum-v1", **options)
    return hcbf_gym.wrappers.SafetyFilter(env, "lex-cbf-qp", plant=plant, alpha2=8.0, margin=0.0)
