"""The least cost of relaxed rows in one or two free directions, for the general programs."""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel
from hcbf_gym.programs.planar import stages
from hcbf_gym.programs.planar.polygon import cut
from hcbf_gym.programs.planar.records import FEASIBLE, Cost, Line, Workspace, make_workspace
from hcbf_gym.programs.planar.soft import keep_least


@kernel(error_model="numpy")
def least_cost(
    soft: Array, one_sided: bool, rows: Array, lower: Array, radius: float
) -> tuple[float, float]:
    """Return a minimiser z of ``Σ w_k δ_k²`` over ``rows z ≥ lower``.

    Args:
        soft: (s, 5) of each relaxed row a, t_k, w_k and the least δ_k.
        one_sided: whether ``a_k z + δ_k ≥ t_k``; equal if not.
        rows: (k, 2) rows, of norms from 1/2 to 1, of a nonempty set of diameter 2 `radius` at most.
        lower: (k,) their bounds.
        radius: the largest norm of an input.
    """
    w = make_workspace(radius, 4 + lower.size, soft.shape[0])
    size = 4.0 * radius
    corners = w.polygons[FEASIBLE]
    corners[0, 0], corners[0, 1], corners[1, 0], corners[1, 1] = -size, -size, size, -size
    corners[2, 0], corners[2, 1], corners[3, 0], corners[3, 1] = size, size, -size, size
    count = 4
    for k in range(lower.size):
        count = cut(corners, count, Line(rows[k, 0], rows[k, 1], lower[k]), radius)
    _load(soft, w)
    cost = Cost(w.rows, 0.0, 0.0, 0.0)
    if one_sided:
        _, x, y = keep_least(corners, count, cost, w)
        return x, y
    return stages.draw(count, cost, w)


@kernel(error_model="numpy")
def _load(soft: Array, w: Workspace) -> None:
    for k in range(soft.shape[0]):
        row = w.rows[k]
        row.ax, row.ay, row.b, row.target = soft[k, 0], soft[k, 1], soft[k, 2], soft[k, 2]
        row.norm = np.hypot(row.ax, row.ay)
        row.weight, row.least = soft[k, 3], soft[k, 4]
