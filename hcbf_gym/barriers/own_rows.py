"""Rows of a user's own barriers for the double integrator, which Python evaluates one by one."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.barriers.barrier import Barrier, PlanarBarrier
from hcbf_gym.barriers.general import GeneralRows
from hcbf_gym.barriers.row_kernels import held_row, reach_of, support
from hcbf_gym.barriers.rows import ALPHA1, ALPHA2, RowSettings
from hcbf_gym.models.reduced_order import DoubleIntegrator

Array = NDArray[np.float64]


def own_row(
    barrier: Barrier,
    x: Array,
    t: float,
    settings: RowSettings,
    margin: float,
    margin_rate: float,
    quickening: float,
) -> tuple[Array, float, float, float]:
    """Return a (2,), b, h and α₂(ψ) of a barrier's row.

    The row is that of a held input where the settings say so and the barrier knows its core (see
    `PlanarBarrier.core`), else the usual one.

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
    usual = _usual(settings)([barrier], x, t, np.array([margin]), margin_rate)
    assert usual.alpha2_psi is not None
    return usual.a[0], float(usual.b[0]) + quickening, float(usual.h[0]), float(usual.alpha2_psi[0])


def _held_row(
    barrier: PlanarBarrier,
    x: Array,
    t: float,
    settings: RowSettings,
    margin: float,
    margin_rate: float,
    quickening: float,
) -> tuple[Array, float, float, float] | None:
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
    b, alpha2_psi, _ = held_row(
        float(h) - margin,
        float(gradient @ r) - margin_rate,
        quickening,
        support(packed, float(gradient[0]), float(gradient[1])),
        speed,
        float(np.sqrt(max(0.0, bending))),
        float(core.distance),
        float(core.radius),
        bool(core.is_point),
        packed[ALPHA1 : ALPHA1 + 4],
        packed[ALPHA2 : ALPHA2 + 4],
        packed,
    )
    return gradient, b, float(h), alpha2_psi


@cache
def _usual(settings: RowSettings) -> GeneralRows:
    return GeneralRows(DoubleIntegrator(), settings.alpha1, settings.alpha2)
