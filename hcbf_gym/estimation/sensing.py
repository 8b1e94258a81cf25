"""What the sensors say of a true state, with all their errors."""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel
from hcbf_gym.locomotion.dynamics import GRAVITY
from hcbf_gym.locomotion.matrices import apply, apply_transposed
from hcbf_gym.locomotion.rotation import rotation_matrix, turned

NOISE = np.dtype(
    (
        np.record,
        [
            ("drift", "f8", 2),
            ("fix", "f8", 2),
            ("rotation", "f8", 3),
            ("gyroscope", "f8", 3),
            ("accelerometer", "f8", 3),
            ("angle", "f8", 12),
            ("rate", "f8", 12),
            ("slip", "f8", 2),
            ("contact", "f8", 4),
        ],
    )
)
NOISES = NOISE.itemsize // 8
"""Standard normal numbers that one tick takes."""

ERRORS = np.dtype(
    (
        np.record,
        [
            ("timestep", "f8"),  # [s]
            ("fix", "f8"),  # σ of a fix's white noise [m]
            ("drift", "f8"),  # σ of its slow error [m]
            ("keep_drift", "f8"),  # e^(−dt/τ)
            ("rotation", "f8", 3),  # σ of the orientation's error about the world's axes [rad]
            ("keep_rotation", "f8"),
            ("slip", "f8"),  # σ of leg odometry's slow error [m/s]
            ("keep_slip", "f8"),
            ("gyroscope", "f8"),  # σ of a reading [rad/s]
            ("accelerometer", "f8"),  # σ of a reading [m/s²]
            ("angle", "f8"),  # σ of a joint's angle [rad]
            ("rate", "f8"),  # σ of a joint's rate [rad/s]
            ("contact", "f8"),  # a standard normal number above it flips a contact
        ],
    )
)

SLOW = np.dtype((np.record, [("drift", "f8", 2), ("rotation", "f8", 3), ("slip", "f8", 2)]))


@kernel()
def start_slow_errors(errors: np.record, slow: np.record, noise: np.record) -> None:
    """Draw the slow errors from their distribution in the long run."""
    slow.drift[:] = errors.drift * noise.drift
    slow.rotation[:] = errors.rotation * noise.rotation
    slow.slip[:] = errors.slip * noise.slip


@kernel()
def move_slow_errors(errors: np.record, slow: np.record, noise: np.record) -> None:
    """Move the slow errors on by one tick: ``e' = k e + √(1 − k²) σ w``."""
    _relax(slow.drift, errors.keep_drift, errors.drift, noise.drift)
    _relax(slow.slip, errors.keep_slip, errors.slip, noise.slip)
    spread = np.sqrt(1.0 - errors.keep_rotation**2)
    for i in range(3):
        slow.rotation[i] *= errors.keep_rotation
        slow.rotation[i] += spread * errors.rotation[i] * noise.rotation[i]


@kernel()
def _relax(value: Array, keep: float, deviation: float, noise: Array) -> None:
    spread = np.sqrt(1.0 - keep**2) * deviation
    for i in range(len(value)):
        value[i] = keep * value[i] + spread * noise[i]


@kernel()
def sense(
    errors: np.record, slow: np.record, noise: np.record, truth: Array, sensed: Array
) -> None:
    """Fill in orientation, rates, joints and contacts as sensors report them.

    Position and velocity of the trunk are copied; no sensor shows them.

    Args:
        errors: an `ERRORS` record.
        slow: a `SLOW` record.
        noise: a `NOISE` record of this tick.
        truth: (41,) the vector of a `RobotState`.
        sensed: (41,) filled in.
    """
    sensed[:] = truth
    sensed[3:7] = turned(truth[3:7], slow.rotation)
    sensed[7:19] += errors.angle * noise.angle
    sensed[22:25] += errors.gyroscope * noise.gyroscope
    sensed[25:37] += errors.rate * noise.rate
    for foot in range(4):
        if noise.contact[foot] > errors.contact:
            sensed[37 + foot] = 0.0 if truth[37 + foot] > 0.0 else 1.0


@kernel()
def planar_acceleration(
    errors: np.record, noise: np.record, truth: Array, before: Array, R_sensed: Array
) -> Array:
    """Return (2,) the acceleration in the world that accelerometer and orientation give [m/s²].

    The accelerometer shows ``f = Rᵀ(v̇ + g e_z) + n``, the mean over the tick; turned back with the
    sensed orientation, an error of tilt leaves a share of gravity in it.

    Args:
        errors: an `ERRORS` record.
        noise: a `NOISE` record of this tick.
        truth: (41,) now.
        before: (3,) true velocity of the trunk a tick ago [m/s].
        R_sensed: (3, 3) trunk → world, as sensed.
    """
    acceleration = (truth[19:22] - before) / errors.timestep
    acceleration[2] += GRAVITY
    force = apply_transposed(rotation_matrix(truth[3:7]), acceleration)
    force += errors.accelerometer * noise.accelerometer
    return apply(R_sensed, force)[:2]
