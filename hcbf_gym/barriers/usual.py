"""From barriers to rows: keeping h(x, t) ≥ 0 is a condition linear in the input."""

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.barriers.shapes import Barrier, SpeedLimit
from hcbf_gym.models.reduced_order import ReducedOrderModel

Array = NDArray[np.float64]


def cbf_rows(
    model: ReducedOrderModel,
    barriers: tuple[Barrier, ...],
    x: Array,
    t: float,
    alpha1: ClassK,
    alpha2: ClassK,
    margin: float = 0.0,
) -> CbfRows:
    """Return the rows ``a·u ≥ b`` that keep every barrier at the state x.

    At relative degree 2 ``ψ = ḣ + α₁(h)``, at relative degree 1 ``ψ = h``; the row is
    ``ψ̇(x, u) ≥ −α₂(ψ)``, that is ``a = L_g ψ`` and ``b = −α₂(ψ) − L_f ψ − ∂ψ/∂t``.

    Args:
        model: ẋ = f(x) + g(x)u.
        barriers: m safety conditions.
        x: (n,) state.
        t: time [s].
        alpha1: α₁, applied to h at relative degree 2.
        alpha2: α₂, applied to ψ.
        margin: what strict rows (priority 1) on the position keep between h and zero [m].

    Source: section II-C of the paper with the high-order form for L_g h = 0.
    """
    a, b, h, alpha2_psi = [], [], [], []
    drift, input_matrix, drift_jacobian = model.f(x), model.g(x), model.f_jacobian(x)
    for barrier in barriers:
        jet = barrier.jet(x, t)
        if isinstance(barrier, SpeedLimit):
            kept = barrier.margin
        else:
            kept = margin if barrier.priority == 1 else 0.0
        psi: float = jet.h - kept
        gradient, rate = jet.gradient, jet.rate
        if model.relative_degree(barrier.reads_position) == 2:
            slope = alpha1.derivative(psi)
            h_dot = float(jet.gradient @ drift) + jet.rate
            gradient = (
                jet.hessian @ drift
                + drift_jacobian.T @ jet.gradient
                + jet.gradient_rate
                + slope * jet.gradient
            )
            rate = jet.gradient_rate @ drift + jet.rate_rate + slope * jet.rate
            psi = h_dot + alpha1(psi)
        a.append(gradient @ input_matrix)
        b.append(-alpha2(psi) - gradient @ drift - rate)
        h.append(jet.h)
        alpha2_psi.append(alpha2(psi))
    priority = np.array([barrier.priority for barrier in barriers])
    return CbfRows(np.array(a), np.array(b), np.array(h), priority, np.array(alpha2_psi))
