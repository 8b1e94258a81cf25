r"""The estimator: simulates the sensors of a true state, and estimates the state from them.

One Kalman filter serves both axes of the plane: they have the same model and the same noise, so
that they share one covariance. The state of an axis is [p, v, d, a, s]: position [m], velocity
[m/s], drift of the position fix [m], error of the measured acceleration [m/s²] and slip of the
stance feet [m/s]. With the timestep Δ, the measured acceleration α and white noises w,

.. math::
    v' = v + Δ (α + w_α - a), \quad p' = p + Δ v', \quad e' = k e + \sqrt{1 - k^2} σ w_e

for each slow error e of d, a, s, with k = exp(-Δ/τ) and its standard deviation σ. Both corrections
measure a sum of two entries: a fix z = p + d + w, and the leg odometry z = v + s + w. The equations
are in `core/include/hcbf/kalman.hpp`, and a whole tick is in `estimation_tick.hpp`.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Record, Records, record_type, words_of
from hcbf_gym.errors import InvalidInputError, finite_array, finite_float
from hcbf_gym.estimation.sensors import Sensors, make
from hcbf_gym.locomotion.leg import LegGeometry
from hcbf_gym.locomotion.state import STATE_SIZE
from hcbf_gym.models.constants import GRAVITY

AXIS = 5
"""The number of entries of an axis's state [p, v, d, a, s]."""
P, V, D, A, S = range(AXIS)

SETTINGS = record_type("estimation_tick.Settings")

SETTLING = 0.01
"""The time of contact after which a foot's leg measures the trunk's velocity [s]."""
SLIPPING = 0.005
"""Standard deviation of the slow slip of stance feet in the simulation itself [m/s]: some 0.6 mm in
a stance of 0.13 s."""
STANDING = 1.0
"""Time for which fixes were averaged at rest when an episode begins [s]."""
BLOCK = 64
"""The number of ticks whose noise is drawn at once."""


class PlanarEstimate(NamedTuple):
    """The estimate of the trunk in the plane.

    Attributes:
        x: (4,) position x, y [m] and velocity x, y [m/s].
        covariance: (4, 4) of the error of x.
        yaw: heading [rad].
    """

    x: Array
    covariance: Array
    yaw: float


class Estimator:
    """A position fix, fused with accelerometer and leg odometry, its delay bridged by replay.

    Args:
        legs: lengths of the legs.
        foot_radius: radius of the feet [m].
        source: a preset's name ("motion-capture", "lidar", "uwb"), a plain dict of `Sensors`'
            fields, or `Sensors`.
        timestep: time between two ticks [s].

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
        self.sensors = make(source)
        dt = finite_float("timestep", timestep, minimum=0.0, exclusive=True)
        settings = _settings(self.sensors, legs, foot_radius, dt)
        self._compiled = _core.EstimationTick(words_of(settings))
        self._yaw_error = self.sensors.yaw
        self._rng: np.random.Generator | None = None
        self._used = BLOCK  # rows of the drawn noise; all are used, so that a block is drawn

    def reset(self, truth: Array, rng: np.random.Generator) -> Array:
        """Begin an episode; return the estimate (41,), as `tick` does.

        Args:
            truth: (41,) the vector of the true `RobotState`, at rest.
            rng: the generator of all errors of the episode.
        """
        truth = finite_array("truth", truth, (STATE_SIZE,))
        self._rng = rng
        self._used = BLOCK
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
        r"""The estimate after the latest tick.

        Its covariance is :math:`P ⊗ I_2 + σ_ψ^2 g g^⊤`: the covariance P (2, 2) of position and
        velocity along either axis, and the heading's standard deviation σ_ψ [rad] times the
        derivative g (4,) of x by an error of the heading, which turns what was measured.
        """
        mean, axis = self._compiled.mean, self._compiled.covariance
        by_heading = self._yaw_error * mean[:2, 2:].ravel()  # σ_ψ g: columns 2 and 3 are g's x, y
        pp, pv, vv = axis[P, P], axis[P, V], axis[V, V]
        covariance = np.outer(by_heading, by_heading)
        covariance += (
            (pp, 0.0, pv, 0.0),
            (0.0, pp, 0.0, pv),
            (pv, 0.0, vv, 0.0),
            (0.0, pv, 0.0, vv),
        )
        return PlanarEstimate(mean[:2, :2].ravel(), covariance, self._compiled.yaw)

    def _next_noise(self) -> int:
        """Return the row of the drawn noise for the next tick; draw a block if all are used."""
        if self._rng is None:
            raise InvalidInputError("estimator: got a tick, expected a reset first")
        if self._used >= BLOCK:
            self._compiled.use(self._rng.standard_normal((BLOCK, _core.NOISES)))
            self._used = 0
        self._used += 1
        return self._used - 1


def _settings(sensors: Sensors, legs: LegGeometry, foot_radius: float, dt: float) -> Records:
    """Return the record (1,) of `SETTINGS` for sensors that are read every dt [s]."""
    record = np.zeros(1, dtype=SETTINGS)
    record["legs"] = legs
    _set_noise(record["errors"][0], record["model"][0], sensors, dt)
    record["foot_radius"] = foot_radius
    record["settled"] = max(round(SETTLING / dt), 1)  # the next three count ticks
    record["period"] = max(round(1.0 / (sensors.rate * dt)), 1)
    record["delay"] = round(sensors.delay / dt)
    fixes_at_rest = max(sensors.rate * STANDING, 1.0)
    record["start"] = sensors.noise**2 / fixes_at_rest  # the variance of their mean
    return record


def _set_noise(errors: Record, model: Record, sensors: Sensors, dt: float) -> None:
    """Write the errors of the simulated sensors, and the noise that the Kalman filter assumes.

    The densities of white noise n [unit/√Hz] become σ = n √(1 / 2Δ), as a reading every Δ has the
    band up to 1/(2Δ). A joint's rate is the difference of two angles over Δ, hence √2 σ/Δ.
    """
    from scipy.special import ndtri  # imported here: robots without feet start faster

    half_band = 0.5 / dt  # [Hz]
    times = np.array([sensors.drift_time, sensors.orientation_time, sensors.slip_time])
    keep_drift, keep_rotation, keep_slip = np.exp(-dt / times).tolist()

    errors["timestep"] = dt
    errors["fix"] = sensors.noise
    errors["drift"] = sensors.drift
    errors["keep_drift"] = keep_drift
    errors["rotation"] = sensors.tilt, sensors.tilt, sensors.yaw
    errors["keep_rotation"] = keep_rotation
    errors["slip"] = sensors.slip
    errors["keep_slip"] = keep_slip
    errors["gyroscope"] = sensors.gyroscope * np.sqrt(half_band)
    errors["accelerometer"] = sensors.accelerometer * np.sqrt(half_band)
    errors["angle"] = sensors.encoder
    errors["rate"] = np.sqrt(2.0) * sensors.encoder / dt
    errors["contact"] = ndtri(
        1.0 - sensors.contact
    )  # the quantile that a normal number exceeds with this probability

    model["timestep"] = dt
    model["fix"] = sensors.noise**2
    model["keep"] = 1.0, 1.0, keep_drift, keep_rotation, keep_slip
    from_tilt = (
        GRAVITY * sensors.tilt
    ) ** 2  # a tilt error leaves a part of gravity in the acceleration
    from_slip = sensors.slip**2 + SLIPPING**2
    model["variance"] = 0.0, 0.0, sensors.drift**2, from_tilt, from_slip
