"""The sensors of a robot, with the errors of each."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hcbf_gym.errors import choose, finite_float
from hcbf_gym.records import build, check_mapping

DEGREE = float(np.pi / 180.0)
MAX_DELAY = 1.0
"""The age of the oldest fix that the estimator can use [s]."""
LEAST = 1e-6
"""The least positive number; a quotient by it stays finite."""
RANGES = {
    "rate": (LEAST, 1e4),  # [Hz]
    "noise": (LEAST, 100.0),  # [m]
    "delay": (0.0, MAX_DELAY),
    "drift": (0.0, 100.0),  # [m]
    "drift_time": (LEAST, 1e6),  # [s]
    "yaw": (0.0, float(np.pi)),  # [rad]
    "tilt": (LEAST, float(np.pi)),  # [rad]
    "orientation_time": (LEAST, 1e6),  # [s]
    "gyroscope": (0.0, 10.0),  # [rad/s/√Hz]
    "accelerometer": (0.0, 100.0),  # [m/s²/√Hz]
    "encoder": (0.0, float(np.pi)),  # [rad]
    "slip": (LEAST, 100.0),  # [m/s]
    "slip_time": (LEAST, 1e6),  # [s]
    "contact": (0.0, 0.5),
}
"""Field → least and greatest number; a greater one is taken for a mistake in its unit."""


@dataclass(frozen=True)
class Sensors:
    """A position fix, an inertial unit, joint encoders and contact switches.

    Slow errors (drift, orientation, slip) are first-order Gauss–Markov processes: zero mean, the
    standard deviation given, correlation exp(−t/τ). All else is white. `docs/estimation.md` has
    the source of every default.

    Args:
        rate: rate of the position fixes [Hz].
        noise: standard deviation of a fix along each axis [m].
        delay: time from the measurement of a fix to its arrival [s].
        drift: standard deviation of the fixes' slow error along each axis [m].
        drift_time: τ of the drift [s].
        yaw: standard deviation of the heading's slow error [rad].
        tilt: standard deviation of the slow error of roll and pitch [rad].
        orientation_time: τ of yaw and tilt [s].
        gyroscope: noise density [rad/s/√Hz].
        accelerometer: noise density [m/s²/√Hz].
        encoder: standard deviation of a joint's angle [rad]; its rate follows from two readings.
        slip: standard deviation of the slow error of leg odometry along each axis [m/s].
        slip_time: τ of the slip [s].
        contact: probability that a foot's contact is reported wrongly, at every reading.

    Raises:
        InvalidInputError: on a number out of range.
    """

    rate: float = 20.0
    noise: float = 0.02
    delay: float = 0.04
    drift: float = 0.0
    drift_time: float = 5.0
    yaw: float = 1.0 * DEGREE
    tilt: float = 0.5 * DEGREE
    orientation_time: float = 5.0
    gyroscope: float = 0.004 * DEGREE
    accelerometer: float = 100e-6 * 9.81
    encoder: float = 0.06 * DEGREE / 9.1
    slip: float = 0.03
    slip_time: float = 0.2
    contact: float = 0.002

    def __post_init__(self) -> None:
        for name, (least, most) in RANGES.items():
            number = finite_float(name, getattr(self, name), minimum=least, maximum=most)
            object.__setattr__(self, name, number)


PRESETS: dict[str, Sensors] = {
    "motion-capture": Sensors(
        rate=100.0,
        noise=0.001,
        delay=0.007,
        drift=0.002,
        drift_time=10.0,
        yaw=0.3 * DEGREE,
    ),
    "lidar": Sensors(drift=0.01),
    "uwb": Sensors(rate=10.0, noise=0.05, delay=0.05, drift=0.08),
}
"""Three usual sources of position fixes; "lidar" matches scans against a map."""


def make(source: str | Mapping[str, object] | Sensors) -> Sensors:
    """Return the sensors that a preset's name or a plain dict of fields describes.

    Fields that a dict leaves out are those of `Sensors()`: fixes of 2 cm at 20 Hz, 40 ms late.

    Raises:
        UnknownNameError: if no preset has the name; the message lists them.
        InvalidInputError: on an unknown field or a number out of range.
    """
    if isinstance(source, Sensors):
        return source
    if isinstance(source, str):
        return choose("estimation preset", source, PRESETS)
    check_mapping("estimation", source)
    return build("estimation", Sensors, source)
