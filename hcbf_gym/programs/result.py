"""What a program returns: the input, what each row pays for it, and how it was found."""

from enum import IntEnum
from typing import Any, NamedTuple

from hcbf_gym.arrays import Array


class FilterStatus(IntEnum):
    """How the input relates to the nominal one, to the rows and to the state.

    Of several that apply, the status is the one named last. NOMINAL: u = u*, every row met.
    SAFE: u ≠ u*, every row met. RELAXED: a row of priority 2 or lower is violated. VIOLATED: a row
    of priority 1 is violated (for ``cbf-qp``: any row); the violation is the least there is. The
    wrapper also reports it where an episode, a state after none, or other barriers begin with
    h − m or ψ of priority 1 below zero, until they are not: every row may be met, and prove
    nothing. UNSAFE, of the wrapper alone: a barrier of priority 1 is below zero. BACKUP: the filter
    brakes; of a program, because every solver failed, and u is 0.
    """

    NOMINAL = 0
    SAFE = 1
    RELAXED = 2
    VIOLATED = 3
    UNSAFE = 4
    BACKUP = 5


class FilterResult(NamedTuple):
    """A program's answer; for a batch of N states every entry has a leading N.

    Attributes:
        u: (n_u,) the filtered input, in U.
        slack: (m,) violation of each row at u, ``max(0, b_k − a_k·u)``.
        delta: (m,) the program's own relaxation δ_k: R-CBF-QP's ``max(δ_min, slack)``, the
            hierarchical programs' signed ``a_k·(û_k − u)``; elsewhere, and for rows of priority
            1, the slack.
        status: a :class:`FilterStatus`; (N,) integers for a batch.
        fallbacks: how many projections of this call took twice a double's digits or, with a solver
            by name, the core; 0 for the compiled programs of two inputs.
    """

    u: Array
    slack: Array
    delta: Array
    status: Any
    fallbacks: Any
