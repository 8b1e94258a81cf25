r"""What a row reserves between h and zero, from what is uncertain at this moment.

For a barrier on the position with the unit normal n = ∇h/‖∇h‖,

.. math::
    m = d + k_v \max(0, -n·e_v) + k_p \max(0, n·e_p) + \max(0, n·(p - b)) + κ\sqrt{n^T P n} + ρ,

where e = (e_p, e_v) is the body's state minus the reduced-order model's (the tracking error), p the
position that the row reads, b the body's, P the covariance of the estimated position, and ρ what
the body reaches beyond its centre. The first three parts stand for the reduced-order model, which
says that the body moves at the model's velocity: a body that moves faster towards the region will
get there by k_v e_v more, and one whose model has run ahead of it will be drawn after it. The
fourth is for rows that read the model's own position: as h is convex with ‖∇h‖ ≤ 1, a body that is
nearer has no less than that of h. A speed limit reserves d_s + k_s ‖e_v‖ + κ √λ [m/s], with λ the
largest eigenvalue of the velocity's covariance: a body that does not follow may overshoot, too, and
one that follows needs little.

The margin moves. The estimate's part grows at most at the rate

.. math:: \dot m ≤ κ\, n^T P_{pv} n / \sqrt{n^T P n},

which stands in the row; the tracking error's part decays where the model is right, and is bounded
by `cap`, so that one sample can take at most that much away.
"""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.barriers import kernels, layout, shapes
from hcbf_gym.models.plant import Uncertainty

if TYPE_CHECKING:
    from hcbf_gym.barriers.set import BarrierSet

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def derive(
    settings: Uncertainty,
    kind: NDArray[np.int64],
    parameters: Array,
    x: Array,
    t: float,
    model: Array,
    lag: Array,
    covariance: Array,
    margin: Array,
    rate: Array,
    leaning: Array,
) -> None:
    """Write the margins (m,) of one state's rows, and the rates (m,) at which they grow at most.

    Args:
        settings: the formula's numbers, d, k_v, k_p, cap, κ, ρ, d_s and k_s in this order.
        kind: (m,) which kernel evaluates each barrier.
        parameters: (m, WIDTH) what it reads.
        x: (4,) position [m] and velocity [m/s], as the rows read them.
        t: time [s].
        model: (4,) the reduced-order model's own state.
        lag: (4,) the body's state minus the reduced-order model's.
        covariance: (4, 4) of x.
        margin: (m,) to be written [m]; of a speed limit [m/s].
        rate: (m,) to be written [m/s].
        leaning: (m,) to be written: the tracking error's part of the margin, less what `cap` cuts
            off of it [m].
    """
    ahead_x, ahead_y = x[0] - model[0] - lag[0], x[1] - model[1] - lag[1]  # of the body
    certain = ahead_x == 0.0 and ahead_y == 0.0
    certain = certain and _is_zero(lag) and _is_zero(covariance.ravel())
    for k in range(kind.size):
        rate[k] = leaning[k] = 0.0
        if kind[k] == layout.SPEED_LIMIT or kind[k] == layout.ZONES or kind[k] == layout.ZONE:
            margin[k] = of_speed(settings, lag, covariance)
            continue
        if kind[k] == layout.CUSTOM or kind[k] == layout.MAPPED:  # whose gradient is not known here
            margin[k] = most(settings, x, model, lag, covariance)
            leaning[k] = settings.cap
            continue
        if certain and shapes.IS_DISTANCE[kind[k]]:  # ∇h is a unit vector, whatever it is
            margin[k] = settings.distance + settings.body
            continue
        jet = kernels.jet(kind[k], parameters[k], x[0], x[1], t)
        steepness = np.sqrt(jet[1] * jet[1] + jet[2] * jet[2])
        nx, ny = jet[1] / steepness, jet[2] / steepness
        ahead = max(0.0, nx * ahead_x + ny * ahead_y)
        lead = max(0.0, nx * lag[0] + ny * lag[1])
        faster = max(0.0, -nx * lag[2] - ny * lag[3])
        tracking = settings.per_velocity * faster + settings.per_lead * lead
        variance = _along(covariance, 0, 0, nx, ny)
        known = settings.confidence * np.sqrt(max(0.0, variance))
        if known > 0.0:
            drift = settings.confidence**2 * _along(covariance, 0, 2, nx, ny) / known
            rate[k] = max(0.0, drift) * steepness
        leaning[k] = (settings.cap - abs(settings.cap - tracking)) * steepness
        total = settings.distance + min(tracking, settings.cap) + ahead + known + settings.body
        margin[k] = total * steepness


@njit(cache=True, error_model="numpy")
def most(settings: Uncertainty, x: Array, model: Array, lag: Array, covariance: Array) -> float:
    """Return what a row on the position with ‖∇h‖ ≤ 1 reserves at most [m]; see `derive`."""
    ahead_x, ahead_y = x[0] - model[0] - lag[0], x[1] - model[1] - lag[1]
    ahead = np.sqrt(ahead_x * ahead_x + ahead_y * ahead_y)
    spread = settings.confidence * np.sqrt(max(0.0, covariance[0, 0] + covariance[1, 1]))
    return settings.distance + settings.cap + ahead + spread + settings.body


@njit(cache=True, error_model="numpy")
def of_speed(settings: Uncertainty, lag: Array, covariance: Array) -> float:
    """Return what the row of a speed limit reserves [m/s]; see `derive`."""
    slip = np.sqrt(lag[2] * lag[2] + lag[3] * lag[3])
    sure = settings.speed + settings.speed_per_velocity * slip
    return sure + fastest_drift(settings, covariance)


@njit(cache=True, error_model="numpy")
def fastest_drift(settings: Uncertainty, covariance: Array) -> float:
    """Return κ √λ, the greatest error of the estimated speed, and rate of any margin [m/s]."""
    if covariance[2, 2] == 0.0 and covariance[3, 3] == 0.0:
        return 0.0
    return settings.confidence * np.sqrt(_largest(covariance))


@njit(cache=True, error_model="numpy")
def _is_zero(values: Array) -> bool:
    """Tell whether all are zero; Numba's own `any` takes longer than the margins themselves."""
    zero = True
    for value in values:
        zero = zero and value == 0.0
    return zero


def derive_all(
    settings: Uncertainty,
    scenes: "BarrierSet",
    x: Array,
    t: Array,
    model: Array,
    lag: Array,
    covariance: Array,
) -> tuple[Array, Array]:
    """Return the margins (N, m) of N states' rows and their rates (N, m); see `derive`.

    Args:
        settings: the formula's numbers, d, k_v, k_p, cap, κ, ρ, d_s and k_s in this order.
        scenes: N scenes, whose speed limits may reserve something by themselves.
        x: (N, 4) states.
        t: (N,) times [s].
        model: (N, 4) states of the reduced-order models.
        lag: (N, 4) tracking errors.
        covariance: (N, 4, 4) of the states.
    """
    numbers = Uncertainty(*map(float, settings))
    margin, rate, leaning = np.zeros((3, *scenes.kind.shape))
    for i in range(len(x)):
        state = x[i], t[i], model[i], lag[i], covariance[i]
        out = margin[i], rate[i], leaning[i]
        derive(numbers, scenes.kind[i], scenes.parameters[i], *state, *out)
    return margin + scenes.own_margin, rate


@njit(cache=True, error_model="numpy")
def _largest(covariance: Array) -> float:
    """Return the largest eigenvalue of the velocity's block (2, 2) of the covariance."""
    xx, xy, yy = covariance[2, 2], covariance[2, 3], covariance[3, 3]
    half = 0.5 * (xx - yy)
    return max(0.0, 0.5 * (xx + yy) + np.sqrt(half * half + xy * xy))


@njit(cache=True, error_model="numpy")
def _along(covariance: Array, i: int, j: int, nx: float, ny: float) -> float:
    """Return nᵀ C n of the block C (2, 2) of the covariance that starts at (i, j)."""
    xx, xy = covariance[i, j], covariance[i, j + 1]
    yx, yy = covariance[i + 1, j], covariance[i + 1, j + 1]
    return nx * (xx * nx + xy * ny) + ny * (yx * nx + yy * ny)
