"""The result of a program: the input, the violation of each row, and a status."""

from enum import IntEnum
from typing import Any, NamedTuple

from hcbf_gym.arrays import Array


class FilterStatus(IntEnum):
    """How the input relates to the nominal one, to the rows and to the state.

    If several apply, the status is the one named last. NOMINAL: u = u*, and every row is met.
    SAFE: u ≠ u*, and every row is met. RELAXED: a row of priority 2 or lower is violated. VIOLATED:
    a row of priority 1 is violated as little as possible (for ``cbf-qp``: any row). A filter also
    reports it after a reset, an invalid state or a change of barriers, while h − m or ψ of priority
    1 is below zero: every row may then be met, and prove nothing. UNSAFE, of a filter alone: a
    barrier of priority 1 is below zero. BACKUP: the filter brakes; a program, because every solver
    failed, and u is 0.
    """

    NOMINAL = 0
    SAFE = 1
    RELAXED = 2
    VIOLATED = 3
    UNSAFE = 4
    BACKUP = 5


class FilterResult(NamedTuple):
    """The result of a program; for a batch of N states every entry has a leading N.

    Attributes:
        u: (n_u,) the filtered input, in U.
        slack: (m,) violation of each row at u, ``max(0, b_k − a_k·u)``.
        delta: (m,) the program's own relaxation δ_k: R-CBF-QP's ``max(δ_min, slack)``, the
            hierarchical programs' signed ``a_k·(û_k − u)``; elsewhere, and for rows of priority
            1, the slack.
        status: a :class:`FilterStatus`; (N,) integers for a batch.
        fallbacks: how many projections of this call required twice the digits of a double or, with
            a solver by name, the core; 0 for the compiled programs of two inputs.
    """

    u: Array
    slack: Array
    delta: Array
    status: Any
    fallbacks: Any
