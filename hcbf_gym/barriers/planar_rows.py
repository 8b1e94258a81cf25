"""Rows of planar double integrators made apart from a filter, and those of users' own barriers."""

from functools import cache

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import Barrier, PlanarBarrier
from hcbf_gym.barriers.general import GeneralRows
from hcbf_gym.barriers.kinks import Kinks
from hcbf_gym.barriers.rows import ALPHA2_PSI, DIP, PSI, WIDTH, B, CbfRows, H, RowSettings
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.models.reduced_order import DoubleIntegrator


def planar_rows(
    scenes: BarrierSet,
    x: Array,
    t: Array,
    settings: RowSettings,
    margin: Array | float = 0.0,
    margin_rate: Array | float = 0.0,
    quickening: Array | float = 0.0,
) -> CbfRows:
    """Return the rows of N states, each field with a leading axis N.

    Args:
        scenes: their barriers.
        x: (N, 4) positions [m] and velocities [m/s].
        t: (N,) times [s].
        settings: α₁, α₂, and whether u is held.
        margin: (N, m) what each row reserves between h and zero; or one number [m] for strict rows
            on the position, while a speed limit reserves its own.
        margin_rate: (N, m) its rate of change, as far as it is known.
        quickening: (N, m) the rate of that of rows on the position.
    """
    shape = scenes.kind.shape
    reserved = np.asarray(margin, dtype=np.float64)
    if not reserved.ndim:
        reserved = scenes.keeps_margin * reserved + scenes.own_margin
    kept = np.empty((3, *shape))
    kept[0], kept[1], kept[2] = reserved, margin_rate, quickening
    a, out = np.empty((*shape, 2)), np.empty((4, *shape))
    _core.planar_rows(scenes.kind, scenes.parameters, kept, x, t, settings.packed, a, out)
    for (i, k), barrier in scenes.own.items():
        row = np.zeros(WIDTH + 2)
        write_own_row(barrier, x[i], float(t[i]), settings, kept[:, i, k].tolist(), row)
        a[i, k], out[:, i, k] = row[WIDTH:], row[:4]  # as `B` …
    return CbfRows(a, out[B], out[H], scenes.priority, out[ALPHA2_PSI])


def write_own_row(
    barrier: Barrier,
    x: Array,
    t: float,
    settings: RowSettings,
    reserved: tuple[float, float, float],
    out: Array,
    kinks: Kinks | None = None,
) -> None:
    """Write the row of a user's own barrier, which Python evaluates.

    It is that of a held input where the settings hold it and the barrier has a core (see
    `PlanarBarrier.core`). Else it is the usual one, which reserves ½ ū T² more of an input that is
    held: by so much h may dip between two samples.

    Args:
        barrier: of any class.
        x: (4,) position [m] and velocity [m/s].
        t: time [s].
        settings: α₁, α₂, and whether u is held.
        reserved: m between h and zero, its rate of change, and the rate of that.
        out: (WIDTH + 2,) see `rows.MARGIN`; its margin is left as it is.
        kinks: as `GeneralRows` takes it.
    """
    out[DIP] = 0.0
    if (
        settings.held
        and isinstance(barrier, PlanarBarrier)
        and _write_held_row(barrier, x, t, settings.packed, reserved, out)
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
    packed: Array,
    reserved: tuple[float, float, float],
    out: Array,
) -> bool:
    """Write the row for a held input, and return whether there is one: the barrier has a core."""
    w = barrier.frame_velocity
    q, r = x[:2] - w * t, x[2:] - w
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
    turn, distance = float(np.sqrt(max(0.0, bending))), float(core.distance)
    b, alpha2_psi, psi, lost = _core.held_row(kept, rate, quickening, speed, turn, distance, packed)
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
