r"""Rows of any model, compiled, for N states at once.

A jet says how h bends, the model how the state moves. With ψ_0 = h − m, whose rate is ∂h/∂t − ṁ,

.. math::
    ψ_1 = \dot ψ_0 + α_1(ψ_0), \qquad
    ∇ψ_1 = ∇²h f + (∂f/∂x)ᵀ ∇h + ∂∇h/∂t + α_1'(ψ_0) ∇h.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import class_k, kernels, layout, speed_limit
from hcbf_gym.barriers.barrier import Jet
from hcbf_gym.barriers.layout import CUSTOM, SPEED_LIMIT
from hcbf_gym.barriers.relative_degree import VANISHED

B, H, ALPHA2_PSI, CONDITIONING = range(4)
"""What `rows` returns in the first axis of its numbers."""

ELSEWHERE = -1
"""The kind of a barrier whose row is made elsewhere: a function."""


class Scene(NamedTuple):
    """The barriers of N scenes.

    Attributes:
        kind: (N, m) as `layout` has it, or `ELSEWHERE`.
        parameters: (N, m, WIDTH) the blocks of built-in ones.
        degree: (N, m) the derivative of h that an input enters first, 1 or 2.
    """

    kind: Integers
    parameters: Array
    degree: Integers


class Terms(NamedTuple):
    """A model at N states.

    Attributes:
        f: (N, n).
        g: (N, n, n_u).
        jacobian: (N, n, n) ∂f/∂x; (N, 0, 0) where every degree is 1.
    """

    f: Array
    g: Array
    jacobian: Array


def width(n: int) -> int:
    """Return how many numbers a jet has."""
    return 3 + 2 * n + n * n


def pack(jet: Jet, out: Array) -> None:
    """Write a jet of n states into an array (width,), as `rows` reads it."""
    n = np.size(jet.gradient)
    out[0], out[1], out[2] = jet.h, jet.rate, jet.rate_rate
    out[3 : 3 + n], out[3 + n : 3 + 2 * n] = jet.gradient, jet.gradient_rate
    out[3 + 2 * n :] = np.ravel(jet.hessian)


@njit(cache=True, error_model="numpy")
def rows(
    scene: Scene,
    jets: Array,
    state: tuple[Array, Array],
    reserved: Array,
    terms: Terms,
    alphas: Array,
) -> tuple[Array, Array]:
    """Return the rows ``a·u ≥ b`` of N states: a (N, m, n_u), and (4, N, m) the numbers of them.

    Args:
        scene: the barriers.
        jets: (N, m, width) of users' own barriers; (N, 0, width) where there are none.
        state: x (N, n) and t (N,) [s].
        reserved: (2, N, m) what each row reserves between h and zero, and the rate of that.
        terms: of the model.
        alphas: (2, 4) α₁ and α₂.
    """
    (x, t), f = state, terms.f
    count, m = scene.kind.shape
    a, out = np.zeros((count, m, terms.g.shape[2])), np.zeros((4, count, m))
    gradient, turned = np.empty(x.shape[1]), np.empty(x.shape[1])
    for i in range(count):
        steer = (terms.g[i] * terms.g[i]).sum()
        for k in range(m):
            kind = scene.kind[i, k]
            if kind == ELSEWHERE:
                continue
            if kind == CUSTOM:
                h, rate, bent = _own_jet(jets[i, k], f[i], gradient, turned)
            else:
                h, rate, bent = _jet(
                    kind, scene.parameters[i, k], x[i], t[i], f[i], gradient, turned
                )
            psi, rate = h - reserved[0, i, k], rate - reserved[1, i, k]
            if scene.degree[i, k] == 2:
                slope, along_f = class_k.slope(alphas[0], psi), 0.0
                for j in range(gradient.size):
                    along_f += gradient[j] * f[i, j]
                h_dot = along_f + rate
                rate = bent + slope * rate
                for j in range(gradient.size):
                    for q in range(gradient.size):
                        turned[j] += terms.jacobian[i, q, j] * gradient[q]
                for j in range(gradient.size):
                    gradient[j] = turned[j] + slope * gradient[j]
                psi = h_dot + class_k.value(alphas[0], psi)
            along = whole = 0.0
            for j in range(gradient.size):
                along += gradient[j] * f[i, j]
                whole += gradient[j] * gradient[j]
            out[CONDITIONING, i, k] = _in_inputs(gradient, terms.g[i], whole * steer, a[i, k])
            alpha2_psi = class_k.value(alphas[1], psi)
            out[B, i, k], out[H, i, k] = -alpha2_psi - along - rate, h
            out[ALPHA2_PSI, i, k] = alpha2_psi
    return a, out


@njit(cache=True, error_model="numpy", inline="always")
def _jet(
    kind: int, c: Array, x: Array, t: float, f: Array, gradient: Array, turned: Array
) -> tuple[float, float, float]:
    """Write ∇h (n,) and ``∇²h f + ∂∇h/∂t`` (n,) of a built-in barrier.

    Args:
        kind: of the barrier.
        c: (WIDTH,) its block.
        x: (n,) state.
        t: time [s].
        f: (n,) drift.
        gradient: (n,) to be written.
        turned: (n,) to be written.

    Returns:
        h, ∂h/∂t and ``∂∇h/∂t·f + ∂²h/∂t²``.
    """
    gradient[:], turned[:] = 0.0, 0.0
    if kind == SPEED_LIMIT:
        v_max = c[layout.V_MAX]
        for j in range(2, 4):
            gradient[j], turned[j] = -x[j] / v_max, -f[j] / v_max
        return speed_limit.value(v_max, x[2], x[3]), 0.0, 0.0
    h, gx, gy, distance, tx, ty = kernels.jet(kind, c, x[0], x[1], t)
    wx, wy = c[layout.VELOCITY_X], c[layout.VELOCITY_Y]
    gradient[0], gradient[1] = gx, gy
    bend = (tx * (f[0] - wx) + ty * (f[1] - wy)) / distance  # ∇²h = t tᵀ/d
    turned[0], turned[1] = bend * tx, bend * ty
    return h, -(gx * wx + gy * wy), -bend * (tx * wx + ty * wy)


@njit(cache=True, error_model="numpy", inline="always")
def _own_jet(jet: Array, f: Array, gradient: Array, turned: Array) -> tuple[float, float, float]:
    """Write and return the same of a user's own barrier, whose jet (width,) was packed."""
    n = f.size
    bent = jet[2]
    for j in range(n):
        gradient[j], turned[j] = jet[3 + j], jet[3 + n + j]
        bent += jet[3 + n + j] * f[j]
        for q in range(n):
            turned[j] += jet[3 + (2 + j) * n + q] * f[q]
    return jet[0], jet[1], bent


@njit(cache=True, error_model="numpy", inline="always")
def _in_inputs(gradient: Array, g: Array, size: float, a: Array) -> float:
    """Write ``L_g ψ`` (n_u,), and return the row's conditioning ``‖L_g ψ‖ / (‖∇ψ‖ ‖g‖)``.

    A row that no input changes is a constant, of conditioning 0.

    Args:
        gradient: (n,) ∇ψ.
        g: (n, n_u).
        size: ``‖∇ψ‖² ‖g‖²``.
        a: (n_u,) to be written.
    """
    reached = 0.0
    for j in range(a.size):
        for q in range(gradient.size):
            a[j] += gradient[q] * g[q, j]
        reached += a[j] * a[j]
    share = np.sqrt(reached / size) if size > 0.0 else 0.0
    if share > VANISHED:
        return share
    a[:] = 0.0
    return 0.0
