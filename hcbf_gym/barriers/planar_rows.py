"""CBF rows of planar double integrators, for built-in shapes and users' own barriers.

`planar_rows` makes all rows of N states without a filter. A compiled filter makes the rows of
built-in shapes itself, and takes each row of a user's own barrier from `write_own_row`.
"""

from functools import cache
from typing import NamedTuple, cast

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import (
    Barrier,
    PlanarBarrier,
    planar_jet_of,
    reads_planar_jet,
    velocity_of,
)
from hcbf_gym.barriers.general import GeneralRows
from hcbf_gym.barriers.kinks import Kinks
from hcbf_gym.barriers.rows import ALPHA2_PSI, DIP, PSI, WIDTH, B, CbfRows, H, RowSettings
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import reals
from hcbf_gym.models.reduced_order import DoubleIntegrator


class Reserved(NamedTuple):
    """What a row reserves between h and zero: the margin m, in the unit of h, and its rates."""

    margin: float  # m
    rate: float  # ṁ [1/s]
    quickening: float  # m̈ [1/s²]


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
        scenes: N scenes of m barriers.
        x: (N, 4) positions [m] and velocities [m/s].
        t: (N,) times [s].
        settings: α₁, α₂, and whether u is held.
        margin: (N, m) what each row reserves between h and zero. One number [m] is reserved by the
            strict rows on the position, while a speed limit reserves its own margin.
        margin_rate: (N, m) d margin/dt.
        quickening: (N, m) d² margin/dt² of rows on the position.
    """
    shape = scenes.kind.shape
    margins = np.asarray(margin, dtype=np.float64)
    if not margins.ndim:
        margins = scenes.keeps_margin * margins + scenes.own_margin
    reserved = np.empty((3, *shape))  # as the fields of `Reserved`
    reserved[0], reserved[1], reserved[2] = margins, margin_rate, quickening
    a, columns = np.empty((*shape, 2)), np.empty((4, *shape))  # columns B, H, ALPHA2_PSI and PSI
    _core.planar_rows(scenes.kind, scenes.parameters, reserved, x, t, settings.packed, a, columns)
    for (i, k), barrier in scenes.own.items():
        row = np.zeros(WIDTH + 2)
        row_reserved = Reserved(*reserved[:, i, k].tolist())
        write_own_row(barrier, x[i], float(t[i]), settings, row_reserved, row)
        a[i, k], columns[:, i, k] = row[WIDTH:], row[: len(columns)]
    return CbfRows(a, columns[B], columns[H], scenes.priority, columns[ALPHA2_PSI])


def write_own_row(
    barrier: Barrier,
    x: Array,
    t: float,
    settings: RowSettings,
    reserved: Reserved,
    out: Array,
    kinks: Kinks | None = None,
) -> None:
    """Write the row of a user's own barrier, which Python evaluates.

    It is the row for a held input if the settings hold u and the barrier has a core (see
    `PlanarBarrier.core`). If not, it is the row of one instant. If u is held all the same, that row
    reserves ½ ū T² more, because h may dip by so much between two samples.

    Args:
        barrier: a user's own.
        x: (4,) position [m] and velocity [m/s].
        t: time [s].
        settings: α₁, α₂, and whether u is held.
        reserved: the margin of this row.
        out: (WIDTH + 2,) the row, whose margin columns are left as they are; see `rows.MARGIN`.
        kinks: evaluates derivatives at a kink; None for one that warns anew.
    """
    out[DIP], packed, held = 0.0, settings.packed, settings.held
    if held and reads_planar_jet(type(barrier)):
        planar = cast("PlanarBarrier", barrier)
        if _write_held_row(planar, x, t, packed, reserved, out):
            return
    dip = _core.row_half_step(packed) if held and barrier.reads_position else 0.0
    row = instant_rows(settings)([barrier], x, t, [reserved.margin + dip], reserved.rate, kinks)
    assert row.alpha2_psi is not None
    h, alpha2_psi = float(row.h[0]), float(row.alpha2_psi[0])
    net = h - reserved.margin
    psi = settings.alpha2.inverse(alpha2_psi) + settings.alpha1(net) - settings.alpha1(net - dip)
    out[WIDTH:], out[DIP] = row.a[0], dip
    out[[B, H, ALPHA2_PSI, PSI]] = float(row.b[0]) + reserved.quickening, h, alpha2_psi, psi


def _write_held_row(
    barrier: PlanarBarrier, x: Array, t: float, packed: Array, reserved: Reserved, out: Array
) -> bool:
    """Write the row for a held input; return False if the barrier has no core or is at a kink."""
    w = velocity_of(barrier)
    q = x[:2] - w * t  # the position in the barrier's frame
    v = x[2:] - w  # the velocity in it
    speed = float(np.linalg.norm(v))
    core = barrier.core(q, _core.row_reach(speed, packed))
    if core is None:
        return False
    h, gradient, hessian = planar_jet_of(barrier, q)
    distance, radius = float(reals("core", core.distance)), float(reals("core", core.radius))
    if not np.isfinite(np.sum(gradient) + np.sum(hessian)):
        return False
    net = h - reserved.margin - _core.row_beside_core(radius, packed)
    rate = float(gradient @ v) - reserved.rate
    sideways = 0.0  # the speed around the core; around a point v·∇²h·v is sideways²/distance
    if core.is_point:
        sideways = float(np.sqrt(max(0.0, distance * float(v @ hessian @ v))))
    b, alpha2_psi, psi, loss = _core.held_row(
        net, rate, reserved.quickening, speed, sideways, distance, packed
    )
    if psi < 0.0:  # too late for α₂: request at least what still stops at the margin, if U can
        greatest = _core.row_support(packed, float(gradient[0]), float(gradient[1]))
        b = max(b, _core.row_late(net, rate, loss, greatest))
    out[WIDTH:] = gradient
    out[[B, H, ALPHA2_PSI, PSI]] = b, h, alpha2_psi, psi
    return True


@cache
def instant_rows(settings: RowSettings) -> GeneralRows:
    """Return an object that makes rows of one instant, which do not cover the time between two."""
    packed = settings.packed
    return GeneralRows(
        DoubleIntegrator(),
        settings.alpha1,
        settings.alpha2,
        lambda a: _core.row_support(packed, float(a[0]), float(a[1])),
    )
