"""Stages of the general cascades that pay for rows: with a price on u, and without."""

from collections.abc import Callable

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.programs.general import rational
from hcbf_gym.programs.general.qp import QpProblem
from hcbf_gym.programs.general.rational import SoftRows
from hcbf_gym.programs.general.remaining import Remaining
from hcbf_gym.programs.tolerances import DEPENDENT, GRADED_FOR_SOLVERS, PULL, SETTLED, ZERO_GRADIENT


def trade(inputs: Remaining, soft: SoftRows) -> Array:
    """Return ``argmin ‖u − u*‖² + Σ w_k δ_k²`` over the inputs.

    Args:
        inputs: what to choose from.
        soft: the rows.

    Raises:
        SolverError: if nobody finds it.
    """
    return trader(inputs, soft)(inputs.u_nominal)


def trader(inputs: Remaining, soft: SoftRows) -> Callable[[Array], Array]:
    """Return the function of u* that `trade` is: what does not depend on u* is computed once."""
    point, basis = inputs.point, inputs.basis
    if not basis.shape[1]:
        return lambda u_nominal: point
    root = np.sqrt(soft.weight)
    a = root[:, None] * (soft.a @ basis)
    target = root * (soft.target - soft.a @ point)
    least = None if soft.least is None else root * soft.least
    choose = _equalities(inputs, a, target) if least is None else _soft(inputs, a, target, least)
    return lambda u_nominal: point + basis @ choose(basis.T @ (u_nominal - point))


def _equalities(inputs: Remaining, a: Array, target: Array) -> Callable[[Array], Array]:
    """Eliminate δ: ``‖z − c‖² + ‖a z − t‖²`` is a distance in ``y = R z``."""
    rows, lower = inputs.reduced()

    def nearest(centre: Array) -> Array:
        factor, y_centre = _core.whiten(a, target, centre)
        image = _core.image_of_rows(rows, factor)
        y = inputs.solver.must(QpProblem(y_centre, *_core.unit_rows(image, lower, 0.0)))
        return _core.back_substitute(factor, y)

    return nearest


def _soft(inputs: Remaining, a: Array, target: Array, least: Array) -> Callable[[Array], Array]:
    """Project (c, 0) on the (z, s) with ``s_k = √w_k δ_k``, ``a z + s ≥ t`` and ``s ≥ s_min``."""
    matrix, below = _core.with_slack(*inputs.reduced(), a, target, least)
    nothing = np.zeros(target.size)

    def nearest(centre: Array) -> Array:
        problem = QpProblem(np.concatenate((centre, nothing)), matrix, below)
        return inputs.solver.must(problem)[: centre.size]

    return nearest


def least_cost(inputs: Remaining, soft: SoftRows) -> Array:
    """Return a minimiser of ``Σ w_k δ_k²`` over the inputs.

    In at most two free directions on a polygon, else by proximal points. Where rows differ too much
    in steepness, or proximal points do not settle, in rational arithmetic.

    Raises:
        SolverError: if nobody finds it.
    """
    norm, slope = _core.steepness(soft.a, inputs.basis)
    counts = slope > np.maximum(DEPENDENT * norm, ZERO_GRADIENT)
    if soft.least is not None:  # a row that pays for no input of U
        counts &= soft.target - soft.least > -norm * inputs.radius
    if not counts.any():
        return inputs.nearest()
    least = None if soft.least is None else soft.least[counts]
    soft = SoftRows(soft.a[counts], soft.target[counts], soft.weight[counts], least)
    if inputs.basis.shape[1] <= 2:
        return _on_polygon(inputs, soft)
    steep = np.sqrt(soft.weight) * slope[counts]
    graded = steep.max() > GRADED_FOR_SOLVERS * steep.min()
    u = None if graded else _proximal(inputs, soft, steep.max())
    return _exactly(inputs, soft) if u is None else u


def _on_polygon(inputs: Remaining, soft: SoftRows) -> Array:
    """Minimise in one or two free directions."""
    rows, lower = inputs.reduced()
    free = inputs.basis.shape[1]
    pad = ((0, 0), (0, 2 - free))
    target = soft.target - soft.a @ inputs.point
    least = np.zeros(target.size) if soft.least is None else soft.least
    table = np.column_stack((np.pad(soft.a @ inputs.basis, pad), target, soft.weight, least))
    one_sided = soft.least is not None
    z = _core.least_cost(table, one_sided, np.pad(rows, pad), lower, inputs.radius)
    return inputs.point + inputs.basis @ np.array(z[:free])


def _proximal(inputs: Remaining, soft: SoftRows, steepest: float) -> Array | None:
    """Iterate ``u_{j+1} = argmin Σ w_k δ_k² + ε ‖u − u_j‖²``; None unless it settles."""
    steep = soft._replace(weight=soft.weight * (PULL / steepest**2))
    nearest_to = trader(inputs, steep)
    u = inputs.nearest()
    for _ in range(20):
        previous = u
        u = nearest_to(u)
        if np.abs(u - previous).max() <= SETTLED * (1.0 + np.abs(u).max()):
            return u
    return None


def _exactly(inputs: Remaining, soft: SoftRows) -> Array:
    """Minimise in rational arithmetic."""
    inputs.solver.fallbacks += 1
    binding = _core.steepness(inputs.a, inputs.basis)[1] > DEPENDENT
    return rational.least_cost(
        soft,
        inputs.centre(),
        inputs.a[binding],
        inputs.b[binding],
        rational.Affine(inputs.point, inputs.basis),
    )
