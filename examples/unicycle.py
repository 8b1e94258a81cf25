"""A unicycle of a few lines: a model from two functions, a barrier from one.

pip install 'hcbf-gym[examples]'
"""

import jax.numpy as jnp
import numpy as np

from hcbf_gym import models, programs
from hcbf_gym.barriers import Function, GeneralRows, LinearClassK

AHEAD = 0.2  # the point that the barrier reads lies so far in front of the wheels [m]
DT = 0.02  # [s]

unicycle = models.ControlAffine(
    f=lambda x: 0.0 * x,
    g=lambda x: jnp.array([[jnp.cos(x[2]), 0.0], [jnp.sin(x[2]), 0.0], [0.0, 1.0]]),
    n=3,
    n_u=2,
)
input_set = models.Box([-1.0, -2.0], [1.0, 2.0])  # speed [m/s], turn rate [rad/s]


def pillar(center, radius):
    """Return h: the point ahead stays so far away that the wheels stay out of the disc."""

    def h(x, t):
        dx = x[0] + AHEAD * jnp.cos(x[2]) - center[0]
        dy = x[1] + AHEAD * jnp.sin(x[2]) - center[1]
        return jnp.sqrt(dx * dx + dy * dy) - radius - AHEAD

    return h


barriers = (
    Function("pillar", 1, pillar((1.0, 0.0), 0.5)),
    Function("post", 1, pillar((-0.8, 1.2), 0.4)),
)
rows = GeneralRows(unicycle, LinearClassK(2.0), LinearClassK(2.0))
program = programs.make("lex-cbf-qp", input_set=input_set)


def drive(x, u_nominal):
    """Return the state after one filtered step, and the program's status."""
    result = program(u_nominal, rows(barriers, x, margin=0.02))
    return unicycle.step(x, result.u, DT), result.status


if __name__ == "__main__":
    x = np.array([-1.0, 0.05, 0.0])
    for _ in range(200):
        x, _ = drive(x, np.array([1.0, 0.0]))  # straight at the pillar
    print("distance from the pillar:", np.hypot(x[0] - 1.0, x[1]) - 0.5)
