r"""What a row reserves between h and zero, from what is uncertain at this moment.

For a barrier on the position with the unit normal n = ∇h/‖∇h‖,

.. math::
    m = d + k_v \max(0, -n·e_v) + k_p \max(0, n·e_p) + \max(0, n·(p - b)) + κσ + ρ,

where e = (e_p, e_v) is the body's state minus the reduced-order model's (the tracking error), p the
position that the row reads, b the body's, σ the standard deviation of the estimated position, and ρ
what the body reaches beyond its centre. The first three parts stand for the reduced-order model,
which says that the body moves at the model's velocity: a body that moves faster towards the region
will get there by k_v e_v more, and one whose model has run ahead of it will be drawn after it. The
fourth is for rows that read the model's own position: a body that is nearer has no less than that
of h. As ‖∇h‖ ≤ 1, no part is more than h can lose; none is multiplied by ‖∇h‖, which
rises along the side of an ellipse with no news. A speed limit reserves d_s + k_s ‖e_v‖ + κ √λ(P_vv)
[m/s], with λ the largest eigenvalue: a body that does not follow may overshoot, too, and one that
follows needs little.

With P the covariance of the state, beside a wall σ = √(nᵀ P_pp n). Where n turns as the robot
moves, σ = √λ(P_pp) is that of the worst direction. Over a hold T it grows by no more than

.. math:: \dot m T, \qquad \dot m = κ \sqrt{n^T P_{vv}(T) n} \text{ or } κ \sqrt{λ(P_{vv}(T))},

as deviations add up at most: σ(T) ≤ σ + T σ_v. P_vv(T) ≤ P_vv + g is what the velocity's will be at
the end of the hold, g what it grew by since the last sample. ṁ stands in the row, and so does its
own growth m̈. The tracking error's part decays where the model is right, and is bounded by `cap`, so
that one sample can take at most that much away.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Integers, Record
from hcbf_gym.barriers import kernels, layout, zone
from hcbf_gym.barriers.shapes import convex_polygon, half_plane
from hcbf_gym.compilation import kernel
from hcbf_gym.models.plant import Uncertainty

MARGIN, RATE, QUICKENING, LEANING = range(4)
"""What `derive` writes into the first axis of its output: m, ṁ, m̈, and what of m may be used: the
tracking error's part, less what `cap` cuts off of it, and the errors of what was measured."""


class Known(NamedTuple):
    """What is known of a plant at a sample; compiled code reads a record of these fields as well.

    Attributes:
        x: (4,) position [m] and velocity [m/s], as the rows read them.
        time: [s].
        model: (4,) the reduced-order model's own state.
        lag: (4,) the body's state minus the reduced-order model's.
        covariance: (4, 4) of x.
        growth: g, by how much that of the velocity grows until the next sample [m²/s²].
    """

    x: Array
    time: float
    model: Array
    lag: Array
    covariance: Array
    growth: float


@kernel(error_model="numpy")
def derive(
    settings: Uncertainty | Record,
    kind: Integers,
    parameters: Array,
    known: Known | Record,
    period: float,
    out: Array,
) -> None:
    """Write the margins of one state's rows, and how fast they grow at most.

    Args:
        settings: the formula's numbers, d, k_v, k_p, cap, κ, ρ, d_s and k_s in this order.
        kind: (m,) which kernel evaluates each barrier.
        parameters: (m, WIDTH) what it reads.
        known: of the plant.
        period: T [s]; 0 where it is not known.
        out: (4, m) to be written, m [m], ṁ [m/s], m̈ [m/s²], leaning [m]; of speed limits m in m/s.
    """
    x, t, model, lag = known.x, known.time, known.model, known.lag
    covariance, growth = known.covariance, known.growth
    ahead_x, ahead_y = x[0] - model[0] - lag[0], x[1] - model[1] - lag[1]  # of the body
    exact = is_exact(covariance)
    certain = exact and ahead_x == 0.0 and ahead_y == 0.0
    for k in range(4):
        certain = certain and lag[k] == 0.0
    spread = drift = quickening = speeding = 0.0
    if not exact:
        spread = settings.confidence * np.sqrt(_largest(covariance, 0))
        drift, quickening = _growing(settings, _largest(covariance, 2), growth, period)
        if period > 0.0:
            now = settings.confidence * np.sqrt(_largest(covariance, 2))
            speeding = (drift - now) / period
    for k in range(kind.size):
        out[RATE, k] = out[QUICKENING, k] = out[LEANING, k] = 0.0
        if kind[k] == layout.NONE:
            out[MARGIN, k] = 0.0
            continue
        if kind[k] == layout.SPEED_LIMIT or kind[k] == layout.ZONES or kind[k] == layout.ZONE:
            out[MARGIN, k], out[RATE, k] = of_speed(settings, lag, covariance), speeding
            if kind[k] == layout.ZONE and parameters[k, layout.AWAY] > 0.0:
                out[RATE, k] += zone.BRAKING * drift / parameters[k, layout.V_MAX]
            continue
        if kind[k] == layout.CUSTOM or kind[k] == layout.MAPPED:  # whose gradient is not known here
            out[MARGIN, k] = most(settings, known)
            out[RATE, k], out[QUICKENING, k] = drift, quickening
            out[LEANING, k] = settings.cap
            continue
        out[MARGIN, k] = settings.distance + settings.body
        if kind[k] == convex_polygon.CODE:
            out[LEANING, k] = convex_polygon.used(parameters[k])
        if certain:
            continue
        jet = kernels.jet(kind[k], parameters[k], x[0], x[1], t)
        steepness = np.sqrt(jet[1] * jet[1] + jet[2] * jet[2])
        nx, ny = jet[1] / steepness, jet[2] / steepness
        ahead = max(0.0, nx * ahead_x + ny * ahead_y)
        lead = max(0.0, nx * lag[0] + ny * lag[1])
        faster = max(0.0, -nx * lag[2] - ny * lag[3])
        tracking = settings.per_velocity * faster + settings.per_lead * lead
        deviation = spread
        out[RATE, k], out[QUICKENING, k] = drift, quickening
        if kind[k] == half_plane.CODE and not exact:
            deviation = settings.confidence * np.sqrt(_along(covariance, 0, nx, ny))
            out[RATE, k], out[QUICKENING, k] = _growing(
                settings, _along(covariance, 2, nx, ny), growth, period
            )
        out[LEANING, k] += settings.cap - abs(settings.cap - tracking)
        out[MARGIN, k] += min(tracking, settings.cap) + ahead + deviation


@kernel(error_model="numpy")
def most(settings: Uncertainty | Record, known: Known | Record) -> float:
    """Return what a row on the position with ‖∇h‖ ≤ 1 reserves at most [m]; see `derive`."""
    x, model, lag = known.x, known.model, known.lag
    ahead_x, ahead_y = x[0] - model[0] - lag[0], x[1] - model[1] - lag[1]
    ahead = np.sqrt(ahead_x * ahead_x + ahead_y * ahead_y)
    spread = settings.confidence * np.sqrt(_largest(known.covariance, 0))
    return settings.distance + settings.cap + ahead + spread + settings.body


@kernel(error_model="numpy")
def of_speed(settings: Uncertainty | Record, lag: Array, covariance: Array) -> float:
    """Return what the row of a speed limit reserves [m/s]; see `derive`."""
    slip = np.sqrt(lag[2] * lag[2] + lag[3] * lag[3])
    sure = settings.speed + settings.speed_per_velocity * slip
    return sure + settings.confidence * np.sqrt(_largest(covariance, 2))


@kernel(error_model="numpy")
def fastest_drift(settings: Uncertainty | Record, covariance: Array, growth: float) -> float:
    """Return the greatest ṁ of any row on the position, now and at the next sample [m/s]."""
    if covariance[2, 2] == 0.0 and covariance[3, 3] == 0.0:
        return 0.0
    return settings.confidence * np.sqrt(_largest(covariance, 2) + 2.0 * growth)


@kernel(error_model="numpy")
def growth_of(covariance: Array, before: Array) -> float:
    """Return g, by how much the velocity's variance grew in its worst direction [m²/s²].

    Args:
        covariance: (4, 4) of the state.
        before: (3,) xx, xy and yy of the velocity's at the last sample.
    """
    xx, xy, yy = covariance[2, 2], covariance[2, 3], covariance[3, 3]
    return _greater(xx - before[0], xy - before[1], yy - before[2])


@kernel(error_model="numpy", inline="always")
def _growing(
    settings: Uncertainty | Record, variance: float, growth: float, period: float
) -> tuple[float, float]:
    """Return ṁ = κ√(σ_v² + g) and m̈, by how much more it is at the next sample, over T."""
    rate = settings.confidence * np.sqrt(variance + growth)
    if growth == 0.0 or period == 0.0:
        return rate, 0.0
    later = settings.confidence * np.sqrt(variance + 2.0 * growth)
    return rate, (later - rate) / period


@kernel(error_model="numpy", inline="always")
def is_exact(covariance: Array) -> bool:
    """Return whether a covariance (4, 4) is zero: no deviation is, so nothing is correlated."""
    deviates = covariance[0, 0] + covariance[1, 1] + covariance[2, 2] + covariance[3, 3]
    return deviates == 0.0


@kernel(error_model="numpy")
def _largest(covariance: Array, i: int) -> float:
    """Return the largest eigenvalue of the block (2, 2) of the covariance that starts at (i, i)."""
    return _greater(covariance[i, i], covariance[i, i + 1], covariance[i + 1, i + 1])


@kernel(error_model="numpy")
def _greater(xx: float, xy: float, yy: float) -> float:
    """Return the larger eigenvalue of a symmetric matrix (2, 2), 0 where it is negative."""
    half = 0.5 * (xx - yy)
    return max(0.0, 0.5 * (xx + yy) + np.sqrt(half * half + xy * xy))


@kernel(error_model="numpy")
def _along(covariance: Array, i: int, nx: float, ny: float) -> float:
    """Return nᵀ C n, at least 0, of the block C (2, 2) of the covariance that starts at (i, i)."""
    xx, xy, yy = covariance[i, i], covariance[i, i + 1], covariance[i + 1, i + 1]
    return max(0.0, nx * (xx * nx + xy * ny) + ny * (xy * nx + yy * ny))
