"""CBF-QP: every row is hard (paper, section II-C)."""

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.programs.general.qp import Solver
from hcbf_gym.programs.general.stage import meet
from hcbf_gym.programs.program import Array, Program


class CbfQp(Program):
    r"""CBF-QP: :math:`\min_{u ∈ U} ‖u^⋆ − u‖²` subject to :math:`a_k u ≥ b_k` for all k.

    Where the rows conflict it has no solution and says so: the status is VIOLATED whatever the
    priority of the row that is missed, and u violates the rows least, ``min Σ δ_k²``.
    """

    def strict(self, rows: CbfRows) -> NDArray[np.bool_]:
        """Return that no row may be relaxed."""
        return np.ones(rows.b.shape, dtype=bool)

    def decide(self, u_nominal: Array, rows: CbfRows, solver: Solver) -> tuple[Array, None]:
        """Solve CBF-QP."""
        return meet(self._admissible, rows.a, rows.b, u_nominal, solver)[1], None
