"""How a foot travels from lift-off to its foothold."""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel

SWING_HEIGHT = 0.055  # [m] of the apex above the foothold
# acceleration at lift-off, in the plane and upwards, as a multiple of distance / time²: a foot that
# starts from rest would move faster in the middle, where its motors give little torque
LIFT_OFF_PLANE, LIFT_OFF_UP = 4.0, 8.0


@kernel()
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
    anew every tick it follows a moving target without a jump in position or velocity. Where two
    ticks or less remain, and the quintic stiffens, the present velocity is retained.

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
        position + dt * (velocity + dt * (0.5 * acceleration + dt * (c3 + dt * (c4 + dt * c5)))),
        velocity + dt * (acceleration + dt * (3.0 * c3 + dt * (4.0 * c4 + dt * 5.0 * c5))),
        acceleration + dt * (6.0 * c3 + dt * (12.0 * c4 + dt * 20.0 * c5)),
    )


@kernel()
def swing_step(
    now: Array, foothold: Array, touchdown: float, remaining: float, duration: float, dt: float
) -> Array:
    """Return (3, 3) a swinging foot's position, velocity and acceleration one tick later.

    In the plane it goes straight to the foothold; upwards first to the apex, reached at half the
    swing, then to the ground. It sets off with the acceleration of `LIFT_OFF_PLANE` and
    `LIFT_OFF_UP`; in the first tick it only rises, or it would slide before it is off the ground.

    Args:
        now: (3, 3) rows position [m], velocity [m/s], acceleration [m/s²].
        foothold: (2,) where it shall land [m].
        touchdown: height of the foot when it lands [m].
        remaining: until touchdown [s].
        duration: of the whole swing [s].
        dt: tick [s].
    """
    lifts_off = remaining > duration - 0.5 * dt
    departs = remaining > duration - 1.5 * dt
    rising = remaining - 0.5 * duration
    following = np.empty((3, 3))
    for axis in range(3):
        if axis < 2 and lifts_off:
            following[:, axis] = now[:, axis]
            continue
        target, time_left = touchdown, remaining
        if axis < 2:
            target = foothold[axis]
        elif rising > 0.0:
            target = touchdown + SWING_HEIGHT
            time_left = rising
        acceleration = now[2, axis]
        if lifts_off or (axis < 2 and departs):
            share = LIFT_OFF_PLANE if axis < 2 else LIFT_OFF_UP
            acceleration = share * (target - now[0, axis]) / time_left**2
        following[0, axis], following[1, axis], following[2, axis] = minimum_jerk_step(
            now[0, axis], now[1, axis], acceleration, target, time_left, dt
        )
    return following
