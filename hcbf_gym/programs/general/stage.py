"""What the cascades are made of: a feasible set, the nearest point in it, and how a stage locks it.

A feasible set is kept as a point, an orthonormal basis of the directions that are still free, and
inequalities. A stage that pins a row removes a direction from the basis instead of adding an
equality, so that no later stage can be infeasible through rounding.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.errors import SolverError
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.exact import rational
from hcbf_gym.programs.general.dense import (
    back_substitute,
    level_rows,
    rows_of_image,
    unit_rows,
    whiten,
)
from hcbf_gym.programs.general.qp import QpProblem, Solver
from hcbf_gym.programs.planar import stages
from hcbf_gym.programs.planar.soft import NEGLIGIBLE

Array = NDArray[np.float64]

# A row with a smaller gradient is a constant: no input changes its violation.
ZERO_GRADIENT = 1e-12
# A unit row whose part along the free directions is smaller does not bind them.
DEPENDENT = 1e-9
# A row that misses its bound by less, in the input space and relative to 1 + |u|, is met.
MET = 1e-9


class FeasibleSet(NamedTuple):
    """``{u : u = point + basis z, a u ≥ b}``.

    Attributes:
        point: (n_u,) a point of the affine subspace; a member of the set once rows are pinned.
        basis: (n_u, r) orthonormal free directions.
        a: (k, n_u) rows of norms from 1/2 to 1.
        b: (k,) their lower bounds.
        radius: the largest norm of an input in U.
        nonempty: whether the set is known to have a member; if so, a solver that finds none has
            failed.
    """

    point: Array
    basis: Array
    a: Array
    b: Array
    radius: float
    nonempty: bool

    @classmethod
    def of_input_set(cls, input_set: InputSet) -> "FeasibleSet":
        """Return U."""
        return cls(
            np.zeros(input_set.n_u),
            np.eye(input_set.n_u),
            *input_set.halfspaces(),
            input_set.radius,
            True,
        )

    def intersect(self, a: Array, b: Array) -> "FeasibleSet":
        """Return the inputs of this set that meet the rows ``a u ≥ b`` (rows of any length)."""
        level, bound = level_rows(a, b, ZERO_GRADIENT)
        rows, bounds = np.concatenate((self.a, level)), np.concatenate((self.b, bound))
        return FeasibleSet(self.point, self.basis, rows, bounds, self.radius, False)

    def pin(self, a: Array, u: Array) -> "FeasibleSet":
        """Return the inputs of this set on which the rows a (s, n_u) have their value at u.

        u is a member: rounding must not take it out, so no bound stays above its value at u.
        """
        unit, _ = unit_rows(a, np.zeros(len(a)), ZERO_GRADIENT)
        pinned, _ = unit_rows(unit @ self.basis, np.zeros(len(unit)), DEPENDENT)
        bounds = np.minimum(self.b, self.a @ u)
        if not len(pinned):
            return self._replace(b=bounds, nonempty=True)
        if pinned.shape == (1, 2):
            directions = np.array([[-pinned[0, 1]], [pinned[0, 0]]])
        elif pinned.shape[1] == 1:
            directions = np.empty((1, 0))
        else:
            _, singular, orthogonal = np.linalg.svd(pinned)
            directions = orthogonal[int(np.sum(singular > DEPENDENT)) :].T
        return self._replace(point=u, basis=self.basis @ directions, b=bounds, nonempty=True)

    def bound(self, a: Array, b: Array, u: Array) -> "FeasibleSet":
        """Return the inputs of this set on which no row is violated more than at its member u."""
        return self.intersect(a, np.minimum(b, a @ u))._replace(nonempty=True)

    def lock(self, a: Array, b: Array, u: Array) -> "FeasibleSet":
        """Return the minimisers of a stage of which u is one, ``min Σ max(0, b_k − a_k u)²``.

        Each violated row has one value on all of them: it is pinned; the others are met.
        """
        norm = np.maximum(np.sqrt(np.einsum("ij,ij->i", a, a)), ZERO_GRADIENT)
        lack = b - a @ u
        violated = lack > MET * (1.0 + np.abs(u).max()) * norm
        violated &= lack > NEGLIGIBLE * np.linalg.norm(lack[violated])
        return self.bound(a[~violated], b[~violated], u).pin(a[violated], u)


class SoftRows(NamedTuple):
    """Rows that a stage pays for instead of meeting: ``Σ w_k δ_k²`` with ``a_k u + δ_k ≥ t_k``.

    Attributes:
        a: (s, n_u) gradients.
        target: (s,) t_k.
        weight: (s,) w_k = λ_δk / λ_u, above 0.
        least: (s,) the least δ_k, or None for the equality ``a_k u + δ_k = t_k``.
    """

    a: Array
    target: Array
    weight: Array
    least: Array | None


def nearest(feasible: FeasibleSet, u_nominal: Array, solver: Solver) -> Array | None:
    """Return ``argmin ‖u − u*‖²`` over the feasible set, or None where the set is empty."""
    if not feasible.basis.shape[1]:
        return feasible.point
    rows, lower = _reduced(feasible)
    centre = feasible.basis.T @ (u_nominal - feasible.point)
    problem = QpProblem(centre, rows, lower)
    z = solver.must(problem) if feasible.nonempty else solver.attempt(problem)
    return None if z is None else feasible.point + feasible.basis @ z


def trade(feasible: FeasibleSet, u_nominal: Array, soft: SoftRows, solver: Solver) -> Array | None:
    """Return ``argmin ‖u − u*‖² + Σ w_k δ_k²`` over the feasible set, or None where it is empty."""
    if not feasible.basis.shape[1]:
        return feasible.point
    root = np.sqrt(soft.weight)
    a = root[:, None] * (soft.a @ feasible.basis)
    target = root * (soft.target - soft.a @ feasible.point)
    centre = feasible.basis.T @ (u_nominal - feasible.point)
    if soft.least is None:
        z = _trade_equalities(feasible, centre, a, target, solver)
    else:
        z = _trade_inequalities(feasible, centre, a, target, root * soft.least, solver)
    return None if z is None else feasible.point + feasible.basis @ z


def _trade_equalities(
    feasible: FeasibleSet, centre: Array, a: Array, target: Array, solver: Solver
) -> Array | None:
    """Eliminate δ: ``‖z − c‖² + ‖a z − t‖²`` is a distance in ``y = R z``."""
    factor, y_centre = whiten(a, target, centre)
    rows, lower = _reduced(feasible)
    problem = QpProblem(y_centre, *unit_rows(rows_of_image(rows, factor), lower, 0.0))
    y = solver.must(problem) if feasible.nonempty else solver.attempt(problem)
    return None if y is None else back_substitute(factor, y)


def _trade_inequalities(
    feasible: FeasibleSet, centre: Array, a: Array, target: Array, least: Array, solver: Solver
) -> Array | None:
    """Project (c, 0) on the (z, s) with ``s_k = √w_k δ_k``, ``a z + s ≥ t`` and ``s ≥ s_min``."""
    rows, lower = _reduced(feasible)
    hard, free, count = lower.size, centre.size, target.size
    norm = np.sqrt(np.einsum("ij,ij->i", a, a) + 1.0)
    matrix = np.zeros((hard + 2 * count, free + count))
    matrix[:hard, :free] = rows
    matrix[hard : hard + count, :free] = a / norm[:, None]
    matrix[range(hard, hard + count), range(free, free + count)] = 1.0 / norm
    matrix[range(hard + count, hard + 2 * count), range(free, free + count)] = 1.0
    below = np.concatenate((lower, target / norm, least))
    problem = QpProblem(np.concatenate((centre, np.zeros(count))), matrix, below)
    x = solver.must(problem) if feasible.nonempty else solver.attempt(problem)
    return None if x is None else x[:free]


def least_cost(feasible: FeasibleSet, u_start: Array, soft: SoftRows, solver: Solver) -> Array:
    """Return a minimiser of ``Σ w_k δ_k²`` over the feasible set.

    In at most two free directions exactly, on a polygon, in rational arithmetic where rows differ
    too much in steepness. Else by proximal points, which converge to a minimiser:
    ``u_{j+1} = argmin Σ w_k δ_k² + ε‖u − u_j‖²``.
    """
    a = soft.a @ feasible.basis
    slope = np.sqrt(np.einsum("ij,ij->i", a, a))
    norm = np.sqrt(np.einsum("ij,ij->i", soft.a, soft.a))
    steers = slope > np.maximum(DEPENDENT * norm, ZERO_GRADIENT)
    if not steers.any():
        return u_start
    least = None if soft.least is None else soft.least[steers]
    soft = SoftRows(soft.a[steers], soft.target[steers], soft.weight[steers], least)
    if feasible.basis.shape[1] <= 2:
        target = soft.target - soft.a @ feasible.point
        bound = np.zeros(target.size) if least is None else target - least
        graded = stages.is_graded(a[steers], bound, soft.weight, 2.0 * feasible.radius)
        solver.fallbacks += int(graded)
        exact = rational.least_cost if graded else stages.least_cost
        z = exact(a[steers], target, least, soft.weight, *_reduced(feasible), feasible.radius)
        return feasible.point + feasible.basis @ z
    # a stronger pull would leave DAQP no digits for the slacks
    steep = soft._replace(weight=soft.weight * (1e4 / (soft.weight * slope[steers] ** 2).max()))
    u = u_start
    for _ in range(50):
        previous, u = u, required(trade(feasible, u, steep, solver))
        if np.abs(u - previous).max() <= 1e-11 * (1.0 + np.abs(u).max()):
            break
    return u


def meet(
    feasible: FeasibleSet, a: Array, b: Array, u_nominal: Array, solver: Solver
) -> tuple[FeasibleSet, Array]:
    """Meet the rows ``a u ≥ b`` in a nonempty set, or violate them least (``min Σ δ_k²``).

    Returns:
        The inputs that do so, and the one nearest u*.
    """
    met = feasible.intersect(a, b)
    u = nearest(met, u_nominal, solver)
    if u is not None:
        return met._replace(nonempty=True), u
    steer = np.einsum("ij,ij->i", a, a) > ZERO_GRADIENT**2
    a, b = a[steer], b[steer]
    soft = SoftRows(a, b, np.ones(b.size), np.zeros(b.size))
    start = required(nearest(feasible, u_nominal, solver))
    locked = feasible.lock(a, b, least_cost(feasible, start, soft, solver))
    return locked, required(nearest(locked, u_nominal, solver))


def relax(
    feasible: FeasibleSet, u_nominal: Array, soft: SoftRows, lambda_u: float, solver: Solver
) -> Array | None:
    """Return ``argmin λ_u ‖u − u*‖² + Σ λ_k δ_k²``, or None where the feasible set is empty.

    Rows of weight 0 drop out. For λ_u = 0 it is the minimiser of ``Σ λ_k δ_k²`` nearest u*.

    Args:
        feasible: the inputs to choose from.
        u_nominal: (n_u,) u*.
        soft: the relaxed rows, with weights λ_k ≥ 0.
        lambda_u: λ_u ≥ 0.
        solver: who solves it.
    """
    paid = soft.weight > 0.0
    a, target, weight = soft.a[paid], soft.target[paid], soft.weight[paid]
    least = None if soft.least is None else soft.least[paid]
    if not paid.any():
        return nearest(feasible, u_nominal, solver)
    if lambda_u > 0.0:
        return trade(feasible, u_nominal, SoftRows(a, target, weight / lambda_u, least), solver)
    u = nearest(feasible, u_nominal, solver)
    if u is None:
        return None
    feasible = feasible._replace(nonempty=True)
    u = least_cost(feasible, u, SoftRows(a, target, weight, least), solver)
    if least is None:
        return nearest(feasible.pin(a, u), u_nominal, solver)
    root = np.sqrt(weight)
    minimisers = feasible.lock(root[:, None] * a, root * (target - least), u)
    return nearest(minimisers, u_nominal, solver)


def required(u: Array | None) -> Array:
    """Return u.

    Raises:
        SolverError: if it is None, although the problem has a solution by construction.
    """
    if u is None:
        raise SolverError("no solver found the solution of a stage that has one")
    return u


def _reduced(feasible: FeasibleSet) -> tuple[Array, Array]:
    """Return the inequalities in the coordinates z of the free directions.

    A row that none of those directions changes is a constant and left out.
    """
    n_u, free = feasible.basis.shape
    if free == n_u:  # nothing is pinned yet: z = u
        return feasible.a, feasible.b
    lower = feasible.b - feasible.a @ feasible.point
    return unit_rows(feasible.a @ feasible.basis, lower, DEPENDENT)
