"""EH-CBF-QP: one H-CBF-QP after the other, each level pinned before the next (paper, III-D)."""

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.programs.general.qp import Solver
from hcbf_gym.programs.general.stage import SoftRows, meet, relax, required
from hcbf_gym.programs.hierarchical import HierarchicalCbfQp, signed_delta
from hcbf_gym.programs.program import Array


class ExplicitHierarchicalCbfQp(HierarchicalCbfQp):
    r"""EH-CBF-QP as printed; the rows of one priority are one stage.

    For each priority p = 2, 3, …

    .. math::
        \min_{u ∈ U,\, δ} λ_u ‖u^⋆ − u‖² + \sum_{k ∈ p} λ_{δ_k} δ_k² \quad \text{s.t.}\quad
        & a_i u ≥ b_i \;(\text{priority } 1), \\
        & a_i u + δ_i^⋆ = a_i û_i \;(\text{priorities } 2 … p−1), \\
        & a_k u + δ_k = a_k û_k \;(\text{priority } p).

    The equalities hold whether or not a row is near its bound: in the plane two of them leave
    nothing to decide.
    """

    def decide(self, u_nominal: Array, rows: CbfRows, solver: Solver) -> tuple[Array, Array]:
        """Solve the cascade."""
        strict = rows.priority == 1
        target, weight = self.targets(u_nominal, rows, solver), self.weight(rows)
        feasible, u = meet(self._admissible, rows.a[strict], rows.b[strict], u_nominal, solver)
        for priority in range(2, rows.priority.max(initial=1) + 1):
            if not feasible.basis.shape[1]:
                break  # nothing is left to decide
            level = rows.priority == priority
            soft = SoftRows(rows.a[level], target[level], weight[level], None)
            u = required(relax(feasible, u_nominal, soft, self.lambda_u, solver))
            feasible = feasible.pin(rows.a[level], u)
        return u, signed_delta(rows, target, u)
