"""The record between barriers and programs: linear rows in the input, ``a·u ≥ b``."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class CbfRows(NamedTuple):
    """The barrier conditions of one state, ``a_k·u ≥ b_k``, or of N states with a leading axis.

    With ``ψ`` the barrier at its relative degree, ``a = L_g ψ`` and ``b = −α₂(ψ) − L_f ψ``, so
    that ``a·u − b = ψ̇(x, u) + α₂(ψ)``.

    Attributes:
        a: (m, n_u) ``L_g ψ_k``, the row's gradient in the input.
        b: (m,) the row's lower bound.
        h: (m,) the barriers' values h_k, which the weight λ_δ(h) reads.
        priority: (m,) int, 1 is the highest and strict; rows of one priority are one stage.
        alpha2_psi: (m,) α₂(ψ_k), from which R-CBF-QP's ``epsilon="known"`` takes its least slack.
    """

    a: NDArray[np.float64]
    b: NDArray[np.float64]
    h: NDArray[np.float64]
    priority: NDArray[np.int64]
    alpha2_psi: NDArray[np.float64] | None = None
