"""How a foot travels from lift-off to its foothold."""

import numpy as np
from numba import njit

from hcbf_gym.locomotion.state import Array

SWING_HEIGHT = 0.07  # [m] apex above the higher of lift-off and touchdown


@njit(cache=True)
def minimum_jerk_step(
    position: float,
    velocity: float,
    acceleration: float,
    target: float,
    remaining: float,
    dt: float,
) -> tuple[float, float, float]:
    """Return position, velocity and acceleration one tick later on the minimum-jerk way.

    The way is the quintic from the present state to rest at `target` in `remaining` seconds; taken
    anew every tick, it follows a moving target without a jump in position, velocity or
    acceleration. Within the last ticks, where the quintic stiffens, it is run to its end unchanged
    by a constant-velocity step.

    Source: T. Flash and N. Hogan, J. Neuroscience 5 (1985).
    """
    T = remaining
    if 2.0 * dt >= T:
        return position + velocity * dt, velocity, 0.0
    gap = target - position - velocity * T - 0.5 * acceleration * T * T
    rate = -velocity - acceleration * T
    c3 = 10.0 * gap / T**3 - 4.0 * rate / T**2 - 0.5 * acceleration / T
    c4 = -15.0 * gap / T**4 + 7.0 * rate / T**3 + acceleration / T**2
    c5 = 6.0 * gap / T**5 - 3.0 * rate / T**4 - 0.5 * acceleration / T**3
    return (
        position
        + velocity * dt
        + 0.5 * acceleration * dt**2
        + c3 * dt**3
        + c4 * dt**4
        + c5 * dt**5,
        velocity + acceleration * dt + 3.0 * c3 * dt**2 + 4.0 * c4 * dt**3 + 5.0 * c5 * dt**4,
        acceleration + 6.0 * c3 * dt + 12.0 * c4 * dt**2 + 20.0 * c5 * dt**3,
    )


@njit(cache=True)
def swing_height(
    lift_off: float, touchdown: float, progress: float, duration: float
) -> tuple[float, float, float]:
    """Return height, its velocity and acceleration: two quintic halves that meet at the apex.

    Args:
        lift_off: height where the foot left the ground [m].
        touchdown: height where it shall land [m].
        progress: share of the swing done, in [0, 1].
        duration: of the swing [s].
    """
    apex = max(lift_off, touchdown) + SWING_HEIGHT
    if progress < 0.5:
        start, end, s = lift_off, apex, 2.0 * progress
    else:
        start, end, s = apex, touchdown, 2.0 * progress - 1.0
    rate = 2.0 / duration
    rise = end - start
    return (
        start + rise * s**3 * (10.0 - 15.0 * s + 6.0 * s * s),
        rise * rate * 30.0 * s * s * (1.0 - s) ** 2,
        rise * rate * rate * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
    )


@njit(cache=True)
def swing_foot(
    state: Array,
    target: Array,
    lift_off: float,
    touchdown: float,
    progress: float,
    remaining: float,
    duration: float,
    dt: float,
) -> Array:
    """Return (3, 3) the foot's desired position, velocity and acceleration one tick later.

    Args:
        state: (3, 3) the same, now; rows are position, velocity, acceleration.
        target: (2,) foothold [m].
        lift_off: height where the foot left the ground [m].
        touchdown: height where it shall land [m].
        progress: share of the swing done now.
        remaining: until touchdown [s].
        duration: of the swing [s].
        dt: tick [s].
    """
    following = np.empty((3, 3))
    for axis in range(2):
        p, v, a = minimum_jerk_step(
            state[0, axis], state[1, axis], state[2, axis], target[axis], remaining, dt
        )
        following[0, axis], following[1, axis], following[2, axis] = p, v, a
    z, dz, ddz = swing_height(lift_off, touchdown, progress, duration)
    following[0, 2], following[1, 2], following[2, 2] = z, dz, ddz
    return following
