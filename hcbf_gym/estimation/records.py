"""Records that the compiled estimator and Python share; fields as in `core/include/hcbf/`."""

import numpy as np

from hcbf_gym.locomotion.records import LEGS

AXIS = 5
"""Entries of an axis's state [p, v, d, a, s]: position, velocity, drift of the fix, error of the
acceleration, slip of the feet."""
P, V, D, A, S = range(AXIS)

MODEL = np.dtype(
    [
        ("timestep", "f8"),  # [s]
        ("keep", "f8", AXIS),  # e^(−dt/τ) of the slow errors; 1 for position and velocity
        ("variance", "f8", AXIS),  # of the slow errors in the long run
        ("fix", "f8"),  # variance of a fix's white noise [m²]
    ]
)
ERRORS = np.dtype(
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
    ]
)
SETTINGS = np.dtype(
    [
        ("model", MODEL),
        ("errors", ERRORS),
        ("legs", LEGS),
        ("foot_radius", "f8"),  # [m]
        ("settled", "i8"),  # ticks of contact before a foot counts
        ("period", "i8"),  # ticks between fixes
        ("delay", "i8"),  # ticks from a fix to its arrival
        ("start", "f8"),  # variance of the white noise of the first position [m²]
    ]
)
