"""Rows of a user's own barriers for the double integrator, which Python evaluates one by one."""

from functools import cache
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import Barrier, PlanarBarrier
from hcbf_gym.barriers.general import GeneralRows
from hcbf_gym.barriers.row_kernels import beside_core, half_step, held_row, late, reach_of, support
from hcbf_gym.barriers.rows import RowSettings
from hcbf_gym.models.reduced_order import DoubleIntegrator


class OwnRow(NamedTuple):
    """A row of a user's own barrier.

    Attributes:
        a: (2,) ∇h.
        b: its lower bound [m/s²].
        h: [m].
        alpha2_psi: α₂(ψ) [m/s²].
        psi: ψ with the margin alone [m/s].
        dip: what the row keeps besides [m].
    """

    a: Array
    b: float
    h: float
    alpha2_psi: float
    psi: float
    dip: float


def own_row(
    barrier: Barrier,
    x: Array,
    t: float,
    settings: RowSettings,
    margin: float,
    margin_rate: float,
    quickening: float,
) -> OwnRow:
    """Return a barrier's row.

    It is that of a held input where the settings say so and the barrier knows its core (see
    `PlanarBarrier.core`). Else it is the usual one, which keeps ½ ū T² more of an input that is
    held: by so much h may dip between two samples.

    Args:
        barrier: of any class.
        x: (4,) position [m] and velocity [m/s].
        t: time [s].
        settings: α₁, α₂, and whether u is held.
        margin: what the row reserves between h and zero.
        margin_rate: its rate of change.
        quickening: the rate of that.
    """
    if settings.held and isinstance(barrier, PlanarBarrier):
        row = _held_row(barrier, x, t, settings, margin, margin_rate, quickening)
        if row is not None:
            return row
    dip = half_step(settings.packed) if settings.held and barrier.reads_position else 0.0
    usual = _usual(settings)([barrier], x, t, np.array([margin + dip]), margin_rate)
    assert usual.alpha2_psi is not None
    h, alpha2_psi = float(usual.h[0]), float(usual.alpha2_psi[0])
    kept = h - margin
    psi = settings.alpha2.inverse(alpha2_psi) + settings.alpha1(kept) - settings.alpha1(kept - dip)
    return OwnRow(usual.a[0], float(usual.b[0]) + quickening, h, alpha2_psi, psi, dip)


def _held_row(
    barrier: PlanarBarrier,
    x: Array,
    t: float,
    settings: RowSettings,
    margin: float,
    margin_rate: float,
    quickening: float,
) -> OwnRow | None:
    """Return the row for a held input, None where the barrier knows no core."""
    w, packed = barrier.frame_velocity, settings.packed
    q = x[:2] - w * t
    r = x[2:] - w
    speed = float(np.linalg.norm(r))
    core = barrier.core(q, reach_of(speed, packed))
    if core is None:
        return None
    h, gradient, hessian = barrier.planar_jet(q)
    bending = core.distance * float(r @ hessian @ r) if core.is_point else 0.0
    kept = float(h) - margin - beside_core(float(core.radius), packed)
    rate = float(gradient @ r) - margin_rate
    b, alpha2_psi, psi, lost = held_row(
        kept,
        rate,
        quickening,
        speed,
        float(np.sqrt(max(0.0, bending))),
        float(core.distance),
        packed,
    )
    if psi < 0.0:
        most = support(packed, float(gradient[0]), float(gradient[1]))
        b = max(b, late(kept, rate, lost, most))
    return OwnRow(gradient, b, float(h), alpha2_psi, psi, 0.0)


@cache
def _usual(settings: RowSettings) -> GeneralRows:
    packed = settings.packed
    return GeneralRows(
        DoubleIntegrator(),
        settings.alpha1,
        settings.alpha2,
        lambda a: support(packed, float(a[0]), float(a[1])),
    )
