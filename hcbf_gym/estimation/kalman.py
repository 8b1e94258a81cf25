"""The Kalman filter of one axis of the plane; x and y differ in their means alone.

Both axes have the same model and the same noise, so that they share one covariance. The state of an
axis is [p, v, d, a, s]: position, velocity, drift of the fix, error of the acceleration, slip of
the feet.

The filter is linear in what comes in, and its gains do not depend on that. So the same steps, taken
on the derivatives of what comes in, give the derivative of the estimate: columns beyond the axes.
"""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel

AXIS = 5  # entries of an axis's state
P, V, D, A, S = range(AXIS)

MODEL = np.dtype(
    (
        np.record,
        [
            ("timestep", "f8"),  # [s]
            ("keep", "f8", AXIS),  # e^(−dt/τ) of the slow errors; 1 for position and velocity
            ("variance", "f8", AXIS),  # of the slow errors in the long run
            ("fix", "f8"),  # variance of a fix's white noise [m²]
        ],
    )
)


@kernel()
def predict(model: np.record, x: Array, cov: Array, acceleration: Array, var_acc: float) -> None:
    """Move an estimate on by one tick under a measured acceleration.

    ``v' = v + dt (acc − a)``, ``p' = p + dt v'``, as the physics integrates; the slow errors decay
    and are driven so that their variance stays what it is in the long run.

    Args:
        model: a `MODEL` record.
        x: (5, k) means of both axes, and derivatives of them, changed in place.
        cov: (5, 5) covariance of either axis, changed in place.
        acceleration: (k,) as measured, in the world [m/s²], and derivatives of it.
        var_acc: variance of its white noise [m²/s⁴].
    """
    dt = model.timestep
    square = dt * dt
    for axis in range(x.shape[1]):
        acc = acceleration[axis] - x[A, axis]
        x[V, axis] += dt * acc
        x[P, axis] += dt * x[V, axis]
        for i in range(D, AXIS):
            x[i, axis] *= model.keep[i]
    # F cov, then (F cov) Fᵀ, row by row and column by column
    for j in range(AXIS):
        cov[P, j] += dt * cov[V, j] - square * cov[A, j]
        cov[V, j] -= dt * cov[A, j]
        for i in range(D, AXIS):
            cov[i, j] *= model.keep[i]
    for i in range(AXIS):
        cov[i, P] += dt * cov[i, V] - square * cov[i, A]
        cov[i, V] -= dt * cov[i, A]
        for j in range(D, AXIS):
            cov[i, j] *= model.keep[j]
    cov[P, P] += square * square * var_acc
    cov[P, V] += square * dt * var_acc
    cov[V, P] += square * dt * var_acc
    cov[V, V] += dt * dt * var_acc
    for i in range(D, AXIS):
        cov[i, i] += (1.0 - model.keep[i] ** 2) * model.variance[i]


@kernel()
def correct(x: Array, cov: Array, first: int, second: int, z: Array, variance: float) -> None:
    """Take in a measurement z (k,) of the sum of two entries of the state, on both axes.

    Args:
        x: (5, k) means of both axes, and derivatives of them, changed in place.
        cov: (5, 5), changed in place.
        first: one entry that z shows.
        second: the other.
        z: (k,) along x and y, and derivatives of it.
        variance: of the white noise of z.
    """
    shown = cov[:, first] + cov[:, second]
    innovation_variance = shown[first] + shown[second] + variance
    for axis in range(x.shape[1]):
        surprise = (z[axis] - x[first, axis] - x[second, axis]) / innovation_variance
        for i in range(AXIS):
            x[i, axis] += shown[i] * surprise
    for i in range(AXIS):
        for j in range(AXIS):
            cov[i, j] -= shown[i] * shown[j] / innovation_variance
