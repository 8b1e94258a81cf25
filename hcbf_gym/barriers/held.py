r"""Rows for an input that is held between two samples, so that h ≥ 0 holds in between, too.

The usual row asks for :math:`\dot ψ ≥ −k ψ` at the sample, with :math:`ψ = \dot h + α_1(h)`, and
may let h dip before the next one. Where h is a convex function of the position seen from the
barrier's frame (a half-plane, or the distance from a convex region), its tangent bounds it from
below. With :math:`w = ∇h·u`, the velocity r in that frame, and u held for T, the double integrator
has

.. math::
    h(τ) & ≥ q(τ) = h + \dot h τ + ½ w τ², \\
    \dot h(T) & ≥ \dot h + w T − ν, \\
    ν & = ½ T u_{max} \min(κ_+ ℓ, 2) − κ_- \max(0, ‖r_⊥‖ − ½ u_{max} T)² T, \qquad
    ℓ = ‖r‖ T + ½ u_{max} T²,

where ℓ is how far it gets, κ₋ and κ₊ bound the curvature of h on the way, and r_⊥ is the part of r
along the level set. The row asks for :math:`ψ(T) ≥ (1 − kT) ψ` in terms of these bounds; it is
linear in u because a chord bounds α₁ from below. Where ψ ≥ 0 at one sample, it is so at the next,
and h ≥ 0 in between, as long as :math:`α_1'(0) T ≤ 1` and :math:`kT ≤ 1`: no margin is needed.
"""

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.barriers.class_k import LinearClassK, LogClassK
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import InvalidInputError

Array = NDArray[np.float64]


def disc_curvature(h: Array, radius: Array, reach: Array) -> tuple[Array, Array]:
    """Return bounds κ₋, κ₊ (…, m) on the curvature of the distance from a disc during one step.

    Along a straight move from the distance d of the centre, the curvature times the square of the
    transverse move is ``d² / d(s)³``, with d(s) between d − ℓ and d + ℓ.

    Args:
        h: (…, m) distance from the disc [m].
        radius: (…, m) its radius [m]; infinite for a half-plane.
        reach: (…, m) ℓ [m].
    """
    distance = np.maximum(h + radius, 1e-9)
    flat = np.isinf(distance)
    safe = np.where(flat, 1.0, distance)
    low = np.where(flat, 0.0, safe**2 / (safe + reach) ** 3)
    return low, np.where(flat, 0.0, 1.0 / np.maximum(safe - reach, 1e-9))


def reach(relative_velocity: Array, dt: float, u_max: float) -> Array:
    """Return ℓ (…, m), how far each barrier's frame sees the robot get in one step [m]."""
    return np.linalg.norm(relative_velocity, axis=-1) * dt + 0.5 * u_max * dt**2


def hold_rows(
    h: Array,
    gradient: Array,
    relative_velocity: Array,
    curvature: tuple[Array, Array],
    priority: NDArray[np.int64],
    alpha1: LinearClassK | LogClassK,
    alpha2: LinearClassK,
    dt: float,
    u_max: float,
) -> CbfRows:
    """Return rows that keep convex barriers of the double integrator while u is held.

    Args:
        h: (…, m) barrier values [m].
        gradient: (…, m, 2) ∇h, of norm 1 at most.
        relative_velocity: (…, m, 2) r, of the robot in each barrier's frame [m/s].
        curvature: κ₋ and κ₊, each (…, m) [1/m]; 0 and infinity where nothing is known.
        priority: (…, m) 1 is the highest.
        alpha1: α₁.
        alpha2: α₂ = k ψ.
        dt: T, how long u is held [s].
        u_max: the largest norm of an input [m/s²].

    Raises:
        InvalidInputError: if the sampling is too slow for α₁ or α₂.
    """
    steepest = max(alpha1.derivative(0.0), alpha2.gain)
    if steepest * dt > 1.0:
        raise InvalidInputError(
            f"dt: got {dt} s with class-K slopes up to {steepest} 1/s, expected their product <= 1"
        )
    h_dot = np.sum(gradient * relative_velocity, axis=-1)
    low, high = curvature
    turn = np.minimum(high * reach(relative_velocity, dt, u_max), 2.0)
    square = np.sum(relative_velocity**2, axis=-1)
    slope2 = np.maximum(np.sum(gradient**2, axis=-1), 1e-18)
    along = np.sqrt(np.maximum(square - h_dot**2 / slope2, 0.0))
    nu = 0.5 * dt * u_max * turn - low * np.maximum(0.0, along - 0.5 * u_max * dt) ** 2 * dt

    half = 0.5 * u_max * dt**2  # |q(T) − h − ḣ T| is no larger
    end = h + h_dot * dt
    chord = np.minimum(_slope(alpha1, end - half), _slope(alpha1, end + half))
    psi = h_dot + _value(alpha1, h)
    wanted = (1.0 - alpha2.gain * dt) * psi - h_dot + nu
    promised = _value(alpha1, end - half) + chord * half
    b = (wanted - promised) / (dt + 0.5 * chord * dt**2)
    return CbfRows(gradient, b, h, priority, alpha2.gain * psi)


def _value(alpha: LinearClassK | LogClassK, h: Array) -> Array:
    if isinstance(alpha, LinearClassK):
        return alpha.gain * h
    return np.sign(h) * alpha.phi1 * np.log1p(alpha.phi2 * np.abs(h) / alpha.phi3)


def _slope(alpha: LinearClassK | LogClassK, h: Array) -> Array:
    if isinstance(alpha, LinearClassK):
        return np.full(h.shape, alpha.gain)
    return alpha.phi1 * alpha.phi2 / (alpha.phi2 * np.abs(h) + alpha.phi3)
