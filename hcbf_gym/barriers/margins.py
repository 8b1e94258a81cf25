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

Any model ẋ = f(x) + g(x)u and any h(x) reserve the same. Let p be the position in x, a = ∇h with
‖a_p‖ ≥ 1 where h reads p, e_v the difference of ṗ between body and model under one input, and
V = (∂f/∂x) P (∂f/∂x)ᵀ the covariance of the drift, which is P_vv of a double integrator. Then

.. math::
    m = ‖a_p‖ (d + ρ) + \min(‖a_p‖\,\mathrm{cap}, \dots) + \max(0, a·(x - x_b)) + κ σ(a, P),
    \qquad \dot m = κ σ(a, V),

with σ(a, C) = √(aᵀ C a) beside a wall, and ‖a_p‖ √λ(C_pp) + √(a_rᵀ C_rr a_r) elsewhere, r the rest
of x. Where g is not the same everywhere (a heading that is not known), a hold adds T κ Σ σ(a, W_j)
to m, W_j the covariance of g_j(x) u_j for the largest u_j. An h that is not convex adds what it may
lose in second order.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Integers, Record
from hcbf_gym.barriers import kernels, layout, zone
from hcbf_gym.barriers.shapes import convex_polygon, half_plane
from hcbf_gym.compilation import kernel
from hcbf_gym.models.plant import Uncertainty

UNIT = 1.0 + 1e-9
"""A slope below it is taken for 1: that of a distance is 1 but for rounding, which no m shows."""

SHORT = 1e-4
"""By how much h − m [m], ψ [m/s] and a speed limit may be missed: all return to 0 without end."""

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


class Unknown(NamedTuple):
    """What is not known of a state, as the row of any h reads it.

    Attributes:
        off: (n,) x − x_b, the state that the rows read less the body's.
        lead: (n_p,) the body's position minus the model's.
        slip: (1 + S, n_p) the body's ṗ minus the model's: of the drift, then of each input at its
            largest.
        state: (n, n) P.
        drift: (k, k) V of the position, k = n_p, or of all of x, k = n.
        growth: g, by how much V of the position grows until the next sample.
        turns: (S, n, n) the covariance of g(x)u, of each input at its largest; none where g is the
            same everywhere.
    """

    off: Array
    lead: Array
    slip: Array
    state: Array
    drift: Array
    growth: float
    turns: Array


class Several(NamedTuple):
    """The same of N plants, with a leading N, and what else their rows read.

    Attributes:
        x: (N, n) as the rows read it.
        time: (N,) [s].
        lag: (N, n) the body's state minus the model's.
        off: as `Unknown` has it, and the fields below.
    """

    x: Array
    time: Array
    lag: Array
    off: Array
    slip: Array
    state: Array
    drift: Array
    growth: Array
    turns: Array


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
    vector = np.zeros((3, 4))
    off, gradient = vector[0], vector[1]
    certain = is_exact(covariance)
    for j in range(4):
        off[j] = x[j] - model[j] - lag[j]
        vector[2, j] = lag[j]
        certain = certain and lag[j] == 0.0 and (j > 1 or off[j] == 0.0)
    lead, slip, drifting = vector[2, :2], vector[2:, 2:], covariance[2:, 2:]
    turns = covariance.reshape(1, 4, 4)[:0]
    unknown = Unknown(off, lead, slip, covariance, drifting, growth, turns)
    drift = quickening = 0.0
    if not certain:
        drift, quickening = _growing(settings, unknown, gradient, 1.0, False, period)
    speeding = speed_growth(settings, covariance, growth, period)
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
        if certain:
            out[MARGIN, k] = settings.distance + settings.body
        else:
            jet = kernels.jet(kind[k], parameters[k], x[0], x[1], t)
            gradient[0], gradient[1] = jet[1], jet[2]
            straight = kind[k] == half_plane.CODE
            m, rate, later, used, _ = of_row(settings, unknown, gradient, straight, period)
            out[MARGIN, k], out[RATE, k], out[QUICKENING, k], out[LEANING, k] = m, rate, later, used
        if kind[k] == convex_polygon.CODE:
            out[LEANING, k] += convex_polygon.used(parameters[k])


@kernel(error_model="numpy")
def of_row(
    settings: Uncertainty | Record, unknown: Unknown, gradient: Array, straight: bool, period: float
) -> tuple[float, float, float, float, float]:
    """Return m, ṁ, m̈, leaning and ‖a_p‖ of one row; see above.

    Args:
        settings: as `derive` takes them.
        unknown: of the state.
        gradient: (n,) ∇h; a is written to it.
        straight: whether ∇h is the same everywhere.
        period: T [s]; 0 where it is not known.
    """
    placed, n = unknown.lead.size, gradient.size
    steep2 = ahead = lead = faster = turned = 0.0
    for j in range(placed):
        steep2 += gradient[j] * gradient[j]
    steep = np.sqrt(steep2)
    if 0.0 < steep < UNIT:
        for j in range(placed):
            gradient[j] /= steep
        steep = 1.0
    for j in range(n):
        ahead += gradient[j] * unknown.off[j]
    for j in range(placed):
        lead += gradient[j] * unknown.lead[j]
    for s in range(unknown.slip.shape[0]):
        away = 0.0
        for j in range(placed):
            away += gradient[j] * unknown.slip[s, j]
        faster += abs(away) if s > 0 else -away
    tracking = settings.per_velocity * max(0.0, faster) + settings.per_lead * max(0.0, lead)
    cap = steep * settings.cap
    deviation = _deviation(unknown.state, 0.0, gradient, placed, steep, straight)
    for s in range(unknown.turns.shape[0]):
        turned += _deviation(unknown.turns[s], 0.0, gradient, placed, steep, straight)
    margin = steep * (settings.distance + settings.body)
    margin += min(tracking, cap) + max(0.0, ahead)
    margin += settings.confidence * (deviation + period * turned)
    rate, quickening = _growing(settings, unknown, gradient, steep, straight, period)
    return margin, rate, quickening, cap - abs(cap - tracking), steep


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


@kernel(error_model="numpy")
def speed_growth(
    settings: Uncertainty | Record, covariance: Array, growth: float, period: float
) -> float:
    """Return how fast the margin of a speed limit grows at most [m/s²]."""
    if period == 0.0 or is_exact(covariance):
        return 0.0
    variance = _largest(covariance, 2)
    later, now = np.sqrt(variance + growth), np.sqrt(variance)
    return settings.confidence * (later - now) / period


@kernel(error_model="numpy")
def is_fast(limit: float, x: Array, lag: Array) -> bool:
    """Return whether a body is faster than a limit, by more than rounding.

    Args:
        limit: L [m/s].
        x: (n,) of the model, with the velocity in x[2:4].
        lag: (n,) the body's state minus the model's.
    """
    vx, vy = x[2] + lag[2], x[3] + lag[3]
    return vx * vx + vy * vy > (limit + SHORT) ** 2


@kernel(error_model="numpy")
def _growing(
    settings: Uncertainty | Record,
    unknown: Unknown,
    gradient: Array,
    steep: float,
    straight: bool,
    period: float,
) -> tuple[float, float]:
    """Return ṁ = κ σ(a, V + g) and m̈, by how much more it is at the next sample, over T."""
    c, placed, growth = unknown.drift, unknown.lead.size, unknown.growth
    if is_exact(unknown.state):
        return 0.0, 0.0
    rate = settings.confidence * _deviation(c, growth, gradient, placed, steep, straight)
    if growth == 0.0 or period == 0.0:
        return rate, 0.0
    later = settings.confidence * _deviation(c, 2.0 * growth, gradient, placed, steep, straight)
    return rate, (later - rate) / period


@kernel(error_model="numpy")
def _deviation(
    c: Array, growth: float, gradient: Array, placed: int, steep: float, straight: bool
) -> float:
    """Return σ(a, C), with C_pp greater by `growth` in every direction.

    Args:
        c: (k, k) C, of the first k states.
        growth: g.
        gradient: (n,) a.
        placed: n_p.
        steep: ‖a_p‖.
        straight: whether a is the same everywhere.
    """
    first = 0 if straight else placed
    variance = steep * steep * growth if straight else 0.0
    for j in range(first, c.shape[0]):
        for q in range(first, c.shape[0]):
            variance += gradient[j] * c[j, q] * gradient[q]
    deviation = np.sqrt(max(0.0, variance))
    return deviation if straight else deviation + steep * np.sqrt(worst(c, placed) + growth)


@kernel(error_model="numpy")
def is_exact(covariance: Array) -> bool:
    """Return whether a covariance is zero: no deviation is, so nothing is correlated."""
    deviates = 0.0
    for j in range(covariance.shape[0]):
        deviates += covariance[j, j]
    return deviates == 0.0


@kernel(error_model="numpy")
def worst(covariance: Array, size: int) -> float:
    """Return the variance of the worst direction of the first states; beyond two a bound of it.

    Args:
        covariance: (k, k).
        size: how many states.
    """
    if size == 2:
        return _largest(covariance, 0)
    most = 0.0
    for j in range(size):
        row = 0.0
        for q in range(size):
            row += abs(covariance[j, q])
        most = max(most, row)
    return most


@kernel(error_model="numpy")
def _largest(covariance: Array, i: int) -> float:
    """Return the largest eigenvalue of the block (2, 2) of the covariance that starts at (i, i)."""
    return _greater(covariance[i, i], covariance[i, i + 1], covariance[i + 1, i + 1])


@kernel(error_model="numpy")
def _greater(xx: float, xy: float, yy: float) -> float:
    """Return the larger eigenvalue of a symmetric matrix (2, 2), 0 where it is negative."""
    half = 0.5 * (xx - yy)
    return max(0.0, 0.5 * (xx + yy) + np.sqrt(half * half + xy * xy))
