r"""Rows of the double integrator for an input that is held: h ≥ 0 between two samples, too.

The readable form of `row_kernels`. `docs/rows.md` derives it; in short, with T the period, r the
velocity in the barrier's frame, m the margin and ṁ its rate, and H convex with ‖∇H‖ ≤ 1,

.. math::
    h(τ) - m(τ) & ≥ (h - m) + (\dot h - \dot m) τ + ½ a·u τ², \\
    \dot h(T) & ≥ \dot h + a·u T - ν,

and the row asks for :math:`ψ(T) ≥ ψ - T α₂(ψ)` in terms of these bounds. It is linear in u because
a chord bounds α₁ from below.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.barriers.barrier import Barrier, Core, PlanarBarrier
from hcbf_gym.barriers.general import GeneralRows, margins
from hcbf_gym.barriers.rows import CbfRows, RowSettings
from hcbf_gym.barriers.shapes import SpeedLimit
from hcbf_gym.models.reduced_order import DoubleIntegrator

Array = NDArray[np.float64]
Row = tuple[Array, float, float, float]


def held_rows(
    barriers: Sequence[Barrier],
    x: Array,
    t: float,
    settings: RowSettings,
    margin: Array | float = 0.0,
    margin_rate: Array | float = 0.0,
) -> CbfRows:
    """Return the rows ``a·u ≥ b`` that preserve every barrier while u is held.

    A barrier that knows no core (see `PlanarBarrier.core`) has its usual row.

    Args:
        barriers: m safety conditions.
        x: (4,) position [m] and velocity [m/s].
        t: time [s].
        settings: α₁, α₂, T and the largest norm of an input.
        margin: (m,) what each row reserves between h and zero; one number [m] is for strict rows
            (priority 1) on the position, while a speed limit has its own.
        margin_rate: (m,) its rate of change.
    """
    kept = margins(barriers, margin)
    rates = np.broadcast_to(np.asarray(margin_rate, dtype=np.float64), (len(barriers),))
    made = [
        _row(barrier, x, t, settings, float(m), float(rate))
        for barrier, m, rate in zip(barriers, kept, rates, strict=True)
    ]
    a, b, h, alpha2_psi = (np.array(column) for column in zip(*made, strict=True))
    return CbfRows(a, b, h, np.array([barrier.priority for barrier in barriers]), alpha2_psi)


def _row(
    barrier: Barrier, x: Array, t: float, settings: RowSettings, margin: float, rate: float
) -> Row:
    if isinstance(barrier, SpeedLimit):
        return _speed_row(barrier, x, settings, margin, rate)
    if isinstance(barrier, PlanarBarrier):
        w = barrier.frame_velocity
        position, velocity = x[:2] - w * t, x[2:] - w
        core = barrier.core(position, reach(velocity, settings))
        if core is not None:
            return _position_row(barrier, core, position, velocity, settings, margin, rate)
    usual = usual_rows(settings)([barrier], x, t, np.array([margin]), rate)
    assert usual.alpha2_psi is not None
    return usual.a[0], float(usual.b[0]), float(usual.h[0]), float(usual.alpha2_psi[0])


@cache
def usual_rows(settings: RowSettings) -> GeneralRows:
    """Return what makes the usual rows of the double integrator, for barriers of any class."""
    return GeneralRows(DoubleIntegrator(), settings.alpha1, settings.alpha2)


def _position_row(
    barrier: PlanarBarrier,
    core: Core,
    q: Array,
    r: Array,
    settings: RowSettings,
    margin: float,
    margin_rate: float,
) -> Row:
    period, half = _period(settings), _half(settings)
    alpha1, alpha2 = settings.alpha1, settings.alpha2
    h, gradient, hessian = barrier.planar_jet(q)
    kept = h - margin - max(0.0, half - core.radius)
    rate = float(gradient @ r) - margin_rate
    psi = rate + alpha1(kept)

    bending = max(0.0, core.distance * float(r @ hessian @ r)) if core.is_point else 0.0
    nu = turning(core.distance, float(np.sqrt(bending)), reach(r, settings), settings)
    end = kept + rate * period
    chord = min(alpha1.derivative(end - half), alpha1.derivative(end + half))
    promised = alpha1(end - half) + chord * half
    b = (psi - period * alpha2(psi) - rate + nu - promised) / (period + 0.5 * chord * period**2)
    if kept >= 0.0 and end >= 0.0:
        b = max(b, -2.0 * end / period**2)
    return gradient, b, h, alpha2(psi)


def turning(distance: float, sideways: float, reach: float, settings: RowSettings) -> float:
    """Return ν, by how much ḣ(T) may fall short of ḣ + a·u T as the gradient turns [m/s].

    Args:
        distance: from the region's core [m]; infinite where the gradient does not turn.
        sideways: the speed across the direction from the core [m/s]; 0 where nothing is known.
        reach: ℓ, how far the robot gets in one period [m].
        settings: T and the largest norm of an input.
    """
    if np.isinf(distance):
        return 0.0
    period, u_max = _period(settings), _u_max(settings)
    mean = max(_half(settings), 0.5 * (distance + max(distance - reach, 0.0)))
    loss = u_max**2 * period**3 / (16.0 * mean)
    across = max(0.0, sideways - 0.5 * u_max * period)
    gain = distance**2 / (distance + reach) ** 3 * across**2 * period
    return loss - max(0.0, float(np.sqrt(gain) - np.sqrt(loss))) ** 2


def _speed_row(
    barrier: SpeedLimit, x: Array, settings: RowSettings, margin: float, margin_rate: float
) -> Row:
    period, velocity = _period(settings), x[2:]
    jet = barrier.jet(x)
    kept = jet.h - margin
    alpha2_psi = settings.alpha2(kept)
    cost = _u_max(settings) ** 2 * period / (2.0 * barrier.v_max)
    b = max(-alpha2_psi, cost - kept / period) if kept >= 0.0 else cost - alpha2_psi
    b = min(b, float(velocity @ velocity) / (barrier.v_max * period))
    return jet.gradient[2:], b + margin_rate, jet.h, alpha2_psi


def reach(relative_velocity: Array, settings: RowSettings) -> float:
    """Return ℓ, how far the barrier's frame sees the robot get in one period [m]."""
    return float(np.linalg.norm(relative_velocity)) * _period(settings) + _half(settings)


def _period(settings: RowSettings) -> float:
    assert settings.period is not None
    return settings.period


def _u_max(settings: RowSettings) -> float:
    assert settings.u_max is not None
    return settings.u_max


def _half(settings: RowSettings) -> float:
    """Return ½ u_max T², how far the input alone moves the robot in one period [m]."""
    return 0.5 * _u_max(settings) * _period(settings) ** 2
