"""Two carts that need no policy of anybody's: what turns their commands into motion."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from hcbf_gym.arrays import Array

FOLDER = Path(__file__).parent  # where the carts' contracts and files are

WHEEL_RADIUS = 0.1  # of the differential cart [m]
HALF_TRACK = 0.17  # half of the distance between its wheels [m]


def differential(model: mujoco.MjModel, period: float) -> Callable[[Array], Array]:
    """Return what turns (v, ω) into the rates of the left and the right wheel, (v ∓ ω b)/r."""
    mix = np.array([[1.0, -HALF_TRACK], [1.0, HALF_TRACK]]) / WHEEL_RADIUS
    return lambda command: mix @ command


def holonomic(model: mujoco.MjModel, period: float) -> Callable[[Array], Array]:
    """Return what hands (v_x, v_y, ω) to the base's own servos."""
    return lambda command: command.copy()
