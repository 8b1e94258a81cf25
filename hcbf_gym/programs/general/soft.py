"""Stages of the general cascades that pay for rows: with a price on u, and without."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.programs.exact import projection
from hcbf_gym.programs.general.dense import back_substitute, rows_of_image, unit_rows, whiten
from hcbf_gym.programs.general.qp import QpProblem
from hcbf_gym.programs.planar import least_cost as planar
from hcbf_gym.programs.tolerances import DEPENDENT, GRADED, PULL, SETTLED, ZERO_GRADIENT

if TYPE_CHECKING:
    from hcbf_gym.programs.general.polyhedron import SolverInputs

Array = NDArray[np.float64]


class SoftRows(NamedTuple):
    """Rows that a stage pays for instead of meeting: ``Σ w_k δ_k²`` with ``a_k u + δ_k ≥ t_k``.

    Attributes:
        a: (s, n_u) gradients.
        target: (s,) t_k.
        weight: (s,) w_k above 0.
        least: (s,) the least δ_k, or None for the equality ``a_k u + δ_k = t_k``.
    """

    a: Array
    target: Array
    weight: Array
    least: Array | None


def trade(inputs: "SolverInputs", soft: SoftRows, u_nominal: Array | None = None) -> Array:
    """Return ``argmin ‖u − u*‖² + Σ w_k δ_k²`` over the inputs.

    Args:
        inputs: what to choose from.
        soft: the rows.
        u_nominal: (n_u,) another u* than that of the inputs.

    Raises:
        SolverError: if nobody finds it.
    """
    point, basis = inputs.point, inputs.basis
    if not basis.shape[1]:
        return point
    desired = inputs.u_nominal if u_nominal is None else u_nominal
    centre, root = basis.T @ (desired - point), np.sqrt(soft.weight)
    a, target = root[:, None] * (soft.a @ basis), root * (soft.target - soft.a @ point)
    if soft.least is None:
        return point + basis @ _trade_equalities(inputs, centre, a, target)
    return point + basis @ _trade_inequalities(inputs, centre, a, target, root * soft.least)


def _trade_equalities(inputs: "SolverInputs", centre: Array, a: Array, target: Array) -> Array:
    """Eliminate δ: ``‖z − c‖² + ‖a z − t‖²`` is a distance in ``y = R z``."""
    factor, y_centre = whiten(a, target, centre)
    rows, lower = inputs.reduced()
    problem = QpProblem(y_centre, *unit_rows(rows_of_image(rows, factor), lower, 0.0))
    return back_substitute(factor, inputs.solver.must(problem))


def _trade_inequalities(
    inputs: "SolverInputs", centre: Array, a: Array, target: Array, least: Array
) -> Array:
    """Project (c, 0) on the (z, s) with ``s_k = √w_k δ_k``, ``a z + s ≥ t`` and ``s ≥ s_min``."""
    rows, lower = inputs.reduced()
    hard, free, count = lower.size, centre.size, target.size
    norm = np.sqrt(np.einsum("ij,ij->i", a, a) + 1.0)
    matrix = np.zeros((hard + 2 * count, free + count))
    matrix[:hard, :free] = rows
    matrix[hard : hard + count, :free] = a / norm[:, None]
    matrix[range(hard, hard + count), range(free, free + count)] = 1.0 / norm
    matrix[range(hard + count, hard + 2 * count), range(free, free + count)] = 1.0
    below = np.concatenate((lower, target / norm, least))
    problem = QpProblem(np.concatenate((centre, np.zeros(count))), matrix, below)
    return inputs.solver.must(problem)[:free]


def least_cost(inputs: "SolverInputs", soft: SoftRows) -> Array:
    """Return a minimiser of ``Σ w_k δ_k²`` over the inputs.

    In at most two free directions exactly, on a polygon; else by proximal points. Where rows differ
    too much in steepness, or proximal points do not settle, in rational arithmetic.

    Raises:
        SolverError: if nobody finds it.
    """
    a = soft.a @ inputs.basis
    slope = np.sqrt(np.einsum("ij,ij->i", a, a))
    norm = np.sqrt(np.einsum("ij,ij->i", soft.a, soft.a))
    steers = slope > np.maximum(DEPENDENT * norm, ZERO_GRADIENT)
    if not steers.any():
        return inputs.nearest()
    least = None if soft.least is None else soft.least[steers]
    soft = SoftRows(soft.a[steers], soft.target[steers], soft.weight[steers], least)
    u = _on_polygon(inputs, soft) if a.shape[1] <= 2 else _proximal(inputs, soft)
    return _exactly(inputs, soft) if u is None else u


def _on_polygon(inputs: "SolverInputs", soft: SoftRows) -> Array | None:
    """Minimise in one or two free directions; None where rows are too steep beside others."""
    rows, lower = inputs.reduced()
    free = inputs.basis.shape[1]
    pad = ((0, 0), (0, 2 - free))
    target = soft.target - soft.a @ inputs.point
    least = np.zeros(target.size) if soft.least is None else soft.least
    table = np.column_stack((np.pad(soft.a @ inputs.basis, pad), target, soft.weight, least))
    one_sided = soft.least is not None
    x, y, fits = planar.least_cost(table, one_sided, np.pad(rows, pad), lower, inputs.radius)
    return inputs.point + inputs.basis @ np.array([x, y][:free]) if fits else None


def _proximal(inputs: "SolverInputs", soft: SoftRows) -> Array | None:
    """Iterate ``u_{j+1} = argmin Σ w_k δ_k² + ε ‖u − u_j‖²``; None unless it settles."""
    steepness = np.sqrt(soft.weight) * np.linalg.norm(soft.a @ inputs.basis, axis=1)
    if steepness.max() > GRADED * steepness.min():
        return None
    steep = soft._replace(weight=soft.weight * (PULL / steepness.max() ** 2))
    u = inputs.nearest()
    for _ in range(20):
        previous, u = u, trade(inputs, steep, u)
        if np.abs(u - previous).max() <= SETTLED * (1.0 + np.abs(u).max()):
            return u
    return None


def _exactly(inputs: "SolverInputs", soft: SoftRows) -> Array:
    """Minimise in rational arithmetic."""
    inputs.solver.fallbacks += 1
    target = soft.target - soft.a @ inputs.point
    stage = projection.Stage(soft.a @ inputs.basis, target, soft.weight, soft.least)
    z = projection.least_cost(stage, inputs.centre(), *inputs.reduced())
    return inputs.point + inputs.basis @ z
