"""The rows of N planar double integrators, made apart from a filter."""

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.general_kernels import WIDTH
from hcbf_gym.barriers.own_rows import write_own_row
from hcbf_gym.barriers.rows import ALPHA2_PSI, B, CbfRows, H, RowSettings
from hcbf_gym.barriers.set import BarrierSet


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
