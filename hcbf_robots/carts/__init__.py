"""Two simulated carts, and the controllers that turn their commands into actuators' inputs."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from hcbf_gym.arrays import Array

FOLDER = Path(__file__).parent  # of the carts' contracts, MJCF files and responses

WHEEL_RADIUS = 0.1  # r, of the differential cart [m]
HALF_TRACK = 0.17  # b, half of the distance between its wheels [m]


def differential(model: mujoco.MjModel, period: float) -> Callable[[Array], Array]:
    """Return a controller: (v, ω) → rates (v ∓ ω b)/r of the left and the right wheel [rad/s]."""
    rates_of = np.array([[1.0, -HALF_TRACK], [1.0, HALF_TRACK]]) / WHEEL_RADIUS
    return lambda command: rates_of @ command


def holonomic(model: mujoco.MjModel, period: float) -> Callable[[Array], Array]:
    """Return a controller that passes (v_x, v_y, ω) to the velocity servos of the base."""
    return lambda command: command.copy()
