"""Rows of a user's own barriers for the double integrator, which Python evaluates one by one."""

from functools import cache

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import Barrier, PlanarBarrier
from hcbf_gym.barriers.general import GeneralRows
from hcbf_gym.barriers.general_kernels import DIP, WIDTH
from hcbf_gym.barriers.kinks import Kinks
from hcbf_gym.barriers.rows import ALPHA2_PSI, PSI, B, H, RowSettings
from hcbf_gym.models.reduced_order import DoubleIntegrator


def write_own_row(
    barrier: Barrier,
    x: Array,
    t: float,
    settings: RowSettings,
    reserved: tuple[float, float, float],
    out: Array,
    kinks: tuple[Kinks, int] | None = None,
) -> None:
    """Write a barrier's row.

    It is that of a held input where the settings say so and the barrier knows its core (see
    `PlanarBarrier.core`). Else it is the usual one, which keeps ½ ū T² more of an input that is
    held: by so much h may dip between two samples.

    Args:
        barrier: of any class.
        x: (4,) position [m] and velocity [m/s].
        t: time [s].
        settings: α₁, α₂, and whether u is held.
        reserved: m between h and zero, its rate of change, and the rate of that.
        out: (WIDTH + 2,) see `general_kernels.MARGIN`; its margin is left as it is.
        kinks: as `GeneralRows` takes it.
    """
    out[DIP] = 0.0
    if isinstance(barrier, PlanarBarrier) and _write_held_row(
        barrier, x, t, settings, reserved, out
    ):
        return
    margin, margin_rate, quickening = reserved
    dip = _core.row_half_step(settings.packed) if settings.held and barrier.reads_position else 0.0
    row = usual(settings)([barrier], x, t, np.array([margin + dip]), margin_rate, kinks)
    assert row.alpha2_psi is not None
    h, alpha2_psi = float(row.h[0]), float(row.alpha2_psi[0])
    kept = h - margin
    psi = settings.alpha2.inverse(alpha2_psi) + settings.alpha1(kept) - settings.alpha1(kept - dip)
    out[WIDTH:], out[DIP] = row.a[0], dip
    out[[B, H, ALPHA2_PSI, PSI]] = float(row.b[0]) + quickening, h, alpha2_psi, psi


def _write_held_row(
    barrier: PlanarBarrier,
    x: Array,
    t: float,
    settings: RowSettings,
    reserved: tuple[float, float, float],
    out: Array,
) -> bool:
    """Write the row for a held input, and return whether there is one: the barrier has a core."""
    if not settings.held:
        return False
    w, packed = barrier.frame_velocity, settings.packed
    q = x[:2] - w * t
    r = x[2:] - w
    speed = float(np.linalg.norm(r))
    core = barrier.core(q, _core.row_reach(speed, packed))
    if core is None:
        return False
    margin, margin_rate, quickening = reserved
    h, gradient, hessian = barrier.planar_jet(q)
    if not np.isfinite(np.sum(gradient) + np.sum(hessian)):
        return False  # a kink, which the usual row looks beside
    bending = core.distance * float(r @ hessian @ r) if core.is_point else 0.0
    kept = float(h) - margin - _core.row_beside_core(float(core.radius), packed)
    rate = float(gradient @ r) - margin_rate
    b, alpha2_psi, psi, lost = _core.held_row(
        kept,
        rate,
        quickening,
        speed,
        float(np.sqrt(max(0.0, bending))),
        float(core.distance),
        packed,
    )
    if psi < 0.0:
        most = _core.row_support(packed, float(gradient[0]), float(gradient[1]))
        b = max(b, _core.row_late(kept, rate, lost, most))
    out[WIDTH:] = gradient
    out[[B, H, ALPHA2_PSI, PSI]] = b, float(h), alpha2_psi, psi
    return True


@cache
def usual(settings: RowSettings) -> GeneralRows:
    """Return what makes the rows of one instant."""
    packed = settings.packed
    return GeneralRows(
        DoubleIntegrator(),
        settings.alpha1,
        settings.alpha2,
        lambda a: _core.row_support(packed, float(a[0]), float(a[1])),
    )
