"""The estimator: from the true state, through the sensors, to the robot's estimate."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, packed, record_type
from hcbf_gym.errors import InvalidInputError, finite_array, finite_float
from hcbf_gym.estimation import sensors
from hcbf_gym.estimation.sensors import Sensors
from hcbf_gym.locomotion.leg import LegGeometry
from hcbf_gym.locomotion.state import STATE_SIZE
from hcbf_gym.models.constants import GRAVITY

AXIS = 5
"""Entries of an axis's state [p, v, d, a, s]: position, velocity, drift of the fix, error of the
acceleration, slip of the feet."""
P, V, D, A, S = range(AXIS)

SETTINGS = record_type("estimation_tick.Settings")

SETTLING = 0.01
"""Time of contact after which a foot's leg measures the trunk's velocity [s]."""

SLIPPING = 0.005
"""Standard deviation of the slow slip of stance feet in the simulation itself [m/s]: some 0.6 mm in
a stance of 0.13 s."""

STANDING = 1.0
"""Time for which fixes were averaged at rest when an episode begins [s]."""

_DIAGONAL, _ACROSS = np.arange(4), np.array([2, 3, 0, 1])  # of position against velocity

BLOCK = 64  # ticks whose noise is drawn at once


class PlanarEstimate(NamedTuple):
    """The estimate of the trunk in the plane.

    Attributes:
        x: (4,) position [m] and velocity [m/s].
        covariance: (4, 4) of x.
        yaw: heading [rad].
    """

    x: Array
    covariance: Array
    yaw: float


class Estimator:
    """A position fix, fused with accelerometer and leg odometry, its delay bridged by replay.

    Args:
        legs: lengths of the legs.
        foot_radius: [m].
        source: a preset's name ("motion-capture", "lidar", "uwb"), a plain dict of `Sensors`'
            fields, or `Sensors`.
        timestep: between two ticks [s].

    Raises:
        UnknownNameError: on an unknown preset.
        InvalidInputError: on an unknown field or a number out of range.
    """

    def __init__(
        self,
        legs: LegGeometry,
        foot_radius: float,
        source: str | Mapping[str, object] | Sensors = "lidar",
        timestep: float = 0.002,
    ) -> None:
        self.sensors = sensors.make(source)
        dt = finite_float("timestep", timestep, minimum=0.0, exclusive=True)
        delay = round(self.sensors.delay / dt)
        settings = _settings(self.sensors, legs, foot_radius, dt, delay)
        self._compiled = _core.EstimationTick(packed(settings, SETTINGS))
        self._yaw_error = self.sensors.yaw
        self._rng: np.random.Generator | None = None
        self._drawn = BLOCK

    def reset(self, truth: Array, rng: np.random.Generator) -> Array:
        """Begin an episode; return the estimate (41,) as `tick` does.

        Args:
            truth: (41,) the vector of the true `RobotState`, at rest.
            rng: draws all errors of the episode.
        """
        truth = finite_array("truth", truth, (STATE_SIZE,))
        self._rng = rng
        self._drawn = BLOCK
        estimate = np.empty(STATE_SIZE)
        self._compiled.start(truth, self._next_noise(), estimate)
        return estimate

    def tick(self, truth: Array) -> Array:
        """Advance by one tick; return (41,) the vector of the estimated `RobotState`.

        Orientation, rates, joints and contacts are as sensed; the trunk's planar position and
        velocity are the estimate's; its height and vertical velocity are the truth's.

        Args:
            truth: (41,) the vector of the true `RobotState` after the tick.

        Raises:
            InvalidInputError: before the first reset.
        """
        estimate = np.empty(STATE_SIZE)
        self._compiled.tick(truth, self._next_noise(), estimate)
        return estimate

    @property
    def estimate(self) -> PlanarEstimate:
        """The estimate after the latest tick."""
        mean = self._compiled.mean
        of_axis, mixed = self._compiled.covariance[:2, :2]
        turned = self._yaw_error * mean[:2, 2:].ravel()
        covariance = np.outer(turned, turned)
        covariance[_DIAGONAL, _DIAGONAL] += of_axis[0], of_axis[0], mixed[1], mixed[1]
        covariance[_DIAGONAL, _ACROSS] += of_axis[1]
        return PlanarEstimate(mean[:2, :2].ravel(), covariance, self._compiled.yaw)

    def _next_noise(self) -> int:
        if self._rng is None:
            raise InvalidInputError("estimator: got a tick, expected a reset first")
        if self._drawn >= BLOCK:
            self._compiled.use(self._rng.standard_normal((BLOCK, _core.NOISES)))
            self._drawn = 0
        self._drawn += 1
        return self._drawn - 1


def _settings(
    chosen: Sensors, legs: LegGeometry, foot_radius: float, dt: float, delay: int
) -> tuple[Any, ...]:
    """Return the fields of a `SETTINGS` record."""
    from scipy.special import ndtri  # wheels have no feet

    half_band = 0.5 / dt  # [Hz] that readings at this rate let through
    keep_drift, keep_rotation, keep_slip = np.exp(
        -dt / np.array([chosen.drift_time, chosen.orientation_time, chosen.slip_time])
    ).tolist()
    keep, variance = np.ones(AXIS), np.zeros(AXIS)
    keep[[D, A, S]] = keep_drift, keep_rotation, keep_slip
    variance[[D, A, S]] = (
        chosen.drift**2,
        (GRAVITY * chosen.tilt) ** 2,
        chosen.slip**2 + SLIPPING**2,
    )
    model = (dt, keep, variance, chosen.noise**2)
    errors = (
        dt,
        chosen.noise,
        chosen.drift,
        keep_drift,
        [chosen.tilt, chosen.tilt, chosen.yaw],
        keep_rotation,
        chosen.slip,
        keep_slip,
        chosen.gyroscope * np.sqrt(half_band),
        chosen.accelerometer * np.sqrt(half_band),
        chosen.encoder,
        np.sqrt(2.0) * chosen.encoder / dt,
        ndtri(1.0 - chosen.contact),
    )
    period = max(round(1.0 / (chosen.rate * dt)), 1)
    settled = max(round(SETTLING / dt), 1)
    fixes = max(chosen.rate * STANDING, 1.0)
    first = chosen.noise**2 / fixes
    return model, errors, legs, foot_radius, settled, period, delay, first
