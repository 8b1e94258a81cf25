"""A polyhedron in the free directions that the stages so far leave, for any number of inputs.

It is kept as a point, an orthonormal basis of the directions that are still free, and
inequalities. A stage that pins a row removes a direction from the basis instead of adding an
equality, so that no later stage can be infeasible through rounding.
"""

from typing import NamedTuple, Self

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.general.qp import QpProblem, Solver
from hcbf_gym.programs.tolerances import DEPENDENT, MET, ZERO_GRADIENT


class Remaining(NamedTuple):
    """``{u : u = point + basis z, a u ≥ b}``.

    Attributes:
        u_nominal: (n_u,) u*.
        solver: who answers.
        point: (n_u,) a point of the affine subspace; a member of the set once rows are pinned.
        basis: (n_u, r) orthonormal free directions.
        a: (k, n_u) rows of norms from 1/2 to 1.
        b: (k,) their lower bounds.
        radius: the largest norm of an input in U.
        known: (n_u,) the member nearest u*, where it is known already.
    """

    u_nominal: Array
    solver: Solver
    point: Array
    basis: Array
    a: Array
    b: Array
    radius: float
    known: Array | None = None

    @classmethod
    def of(cls, input_set: InputSet, u_nominal: Array, solver: Solver) -> Self:
        """Return U."""
        n_u = input_set.n_u
        (a, b) = input_set.halfspaces()
        return cls(u_nominal, solver, np.zeros(n_u), np.eye(n_u), a, b, input_set.radius)

    def nearest(self) -> Array:
        """Return ``argmin ‖u − u*‖²``.

        Raises:
            SolverError: if nobody finds it.
        """
        if self.known is not None:
            return self.known
        rows, lower = self.reduced()
        z = self.solver.must(QpProblem(self.centre(), rows, lower))
        return self.point + self.basis @ z

    def attempt(self) -> Array | None:
        """Return the member nearest u*, or None where there is none."""
        if not self.basis.shape[1]:
            return self.point if (self.a @ self.point >= self.b - MET).all() else None
        rows, lower = self.reduced()
        z = self.solver.attempt(QpProblem(self.centre(), rows, lower))
        return None if z is None else self.point + self.basis @ z

    def intersect(self, a: Array, b: Array) -> Self:
        """Keep those that meet ``a u ≥ b``, rows of any length; there may be none."""
        level, bound = _core.level_rows(a, b, ZERO_GRADIENT)
        rows, bounds = np.concatenate((self.a, level)), np.concatenate((self.b, bound))
        return self._replace(a=rows, b=bounds, known=None)

    def centre(self) -> Array:
        """Return u* in the coordinates z of the free directions."""
        return self.basis.T @ (self.u_nominal - self.point)

    def reduced(self) -> tuple[Array, Array]:
        """Return the inequalities in the coordinates z of the free directions.

        A row that none of those directions changes is a constant and left out.
        """
        n_u, free = self.basis.shape
        if free == n_u:  # nothing is pinned yet: z = u
            return self.a, self.b
        lower = self.b - self.a @ self.point
        return _core.unit_rows(self.a @ self.basis, lower, DEPENDENT)
