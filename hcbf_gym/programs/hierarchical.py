"""H-CBF-QP, IH-CBF-QP: lower rows are drawn to what they would get alone (paper, section III)."""

import numpy as np

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.programs.general.qp import Solver
from hcbf_gym.programs.general.stage import ZERO_GRADIENT, SoftRows, meet, relax, required
from hcbf_gym.programs.program import Array, WeightedProgram


class HierarchicalCbfQp(WeightedProgram):
    r"""H-CBF-QP for one relaxed row; with m rows it is IH-CBF-QP, where k runs over all of them.

    .. math::
        \min_{u ∈ U,\, δ} λ_u ‖u^⋆ − u‖² + \sum_k λ_{δ_k} δ_k² \quad \text{s.t.}\quad
        a_i u ≥ b_i \;(\text{priority } 1), \qquad a_k u + δ_k = a_k û_k \;(\text{others}),

    where û_k solves the program of row k alone (:meth:`alone`).
    """

    def decide(self, u_nominal: Array, rows: CbfRows, solver: Solver) -> tuple[Array, Array]:
        """Solve the program."""
        strict = rows.priority == 1
        lower = ~strict
        target = self.targets(u_nominal, rows, solver)
        soft = SoftRows(rows.a[lower], target[lower], self.weight(rows)[lower], None)
        feasible = self._admissible.intersect(rows.a[strict], rows.b[strict])
        u = relax(feasible, u_nominal, soft, self.lambda_u, solver)
        if u is None:
            feasible, _ = meet(self._admissible, rows.a[strict], rows.b[strict], u_nominal, solver)
            u = required(relax(feasible, u_nominal, soft, self.lambda_u, solver))
        return u, signed_delta(rows, target, u)

    def targets(self, u_nominal: Array, rows: CbfRows, solver: Solver) -> Array:
        """Return ``a_k û_k`` (m,) of the relaxed rows, and b_k of those of priority 1.

        û_k is the input nearest u* in U that meets row k or, where none does, violates it least.
        """
        target = rows.b.copy()
        nominal = self.input_set.project(u_nominal)
        value = rows.a @ nominal
        for k in np.flatnonzero(rows.priority > 1):
            if value[k] >= rows.b[k]:
                target[k] = value[k]
                continue
            a, b = rows.a[k], rows.b[k]
            on_row = u_nominal + a * ((b - a @ u_nominal) / max(a @ a, ZERO_GRADIENT**2))
            if b > a @ u_nominal and self.input_set.contains(on_row, 0.0):
                continue  # U does not bind: û_k lies on the row
            alone = meet(self._admissible, a[None], b[None], u_nominal, solver)[1]
            target[k] = a @ alone
        return target


def signed_delta(rows: CbfRows, target: Array, u: Array) -> Array:
    """Return δ_k (m,): ``a_k û_k − a_k u`` of the relaxed rows, the slack of the others."""
    lack = target - rows.a @ u
    return np.where(rows.priority == 1, np.maximum(0.0, lack), lack)
