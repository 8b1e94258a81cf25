r"""Rows of any model, compiled, for N states at once.

A jet says how h bends, the model how the state moves. With ψ_0 = h − m, whose rate is ∂h/∂t − ṁ,

.. math::
    ψ_1 = \dot ψ_0 + α_1(ψ_0), \qquad
    ∇ψ_1 = ∇²h f + (∂f/∂x)ᵀ ∇h + ∂∇h/∂t + α_1'(ψ_0) ∇h.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import class_k, kernels, layout, speed_limit
from hcbf_gym.barriers.barrier import Jet
from hcbf_gym.barriers.layout import CUSTOM, SPEED_LIMIT
from hcbf_gym.barriers.relative_degree import VANISHED
from hcbf_gym.barriers.row_kernels import ALPHA2_PSI, PSI, B, H
from hcbf_gym.compilation import kernel

MARGIN, RATE, QUICKENING, LEANING, REACH, FAST, DIP, CONDITIONING, PLACED, WIDTH = range(4, 14)
"""Where a row that is made for any model has its numbers, behind those of `row_kernels`: those of
`margins.of_models`, what it reserves besides, how well it is conditioned, and 1 where its barrier
reads the position. a (n_u,) follows."""

ELSEWHERE = -1
"""The kind of a barrier whose row is made elsewhere: a function."""


class Scene(NamedTuple):
    """The barriers of N scenes.

    Attributes:
        kind: (N, m) as `layout` has it, `NONE` behind a shorter scene; or `ELSEWHERE`.
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


def jet_width(n: int) -> int:
    """Return how many numbers a jet has."""
    return 3 + 2 * n + n * n


def pack(jet: Jet, out: Array) -> None:
    """Write a jet of n states into an array (jet_width,), as `rows` reads it."""
    n = np.size(jet.gradient)
    out[0], out[1], out[2] = jet.h, jet.rate, jet.rate_rate
    out[3 : 3 + n], out[3 + n : 3 + 2 * n] = jet.gradient, jet.gradient_rate
    out[3 + 2 * n :] = np.ravel(jet.hessian)


@kernel(error_model="numpy")
def write_rows(
    scene: Scene,
    jets: Array,
    state: tuple[Array, Array],
    terms: Terms,
    alphas: Array,
    out: Array,
) -> bool:
    """Write the rows ``a·u ≥ b`` of N states, and return whether a ψ_1 of one is below zero.

    Args:
        scene: the barriers.
        jets: (N, m, jet_width) of users' own barriers; (N, 0, jet_width) where there are none.
        state: x (N, n) and t (N,) [s].
        terms: of the model.
        alphas: (2, 4) α₁ and α₂.
        out: (N, m, WIDTH + n_u) with m, ṁ and m̈, see `MARGIN`; the rest is written.
    """
    (x, t), f = state, terms.f
    count, m = scene.kind.shape
    gradient, turned = np.empty(x.shape[1]), np.empty(x.shape[1])
    lags = False
    for i in range(count):
        steer = (terms.g[i] * terms.g[i]).sum()
        for k in range(m):
            kind = scene.kind[i, k]
            if kind == ELSEWHERE or kind == layout.NONE:
                continue
            row = out[i, k]
            if kind == CUSTOM:
                h, rate, bent = _own_jet(jets[i, k], f[i], gradient, turned)
            else:
                h, rate, bent = _jet(
                    kind, scene.parameters[i, k], x[i], t[i], f[i], gradient, turned
                )
            psi, rate = h - row[MARGIN], rate - row[RATE]
            if scene.degree[i, k] == 2:
                slope, along_f = class_k.slope(alphas[0], psi), 0.0
                for j in range(gradient.size):
                    along_f += gradient[j] * f[i, j]
                h_dot = along_f + rate
                rate = bent - row[QUICKENING] + slope * rate
                for j in range(gradient.size):
                    for q in range(gradient.size):
                        turned[j] += terms.jacobian[i, q, j] * gradient[q]
                for j in range(gradient.size):
                    gradient[j] = turned[j] + slope * gradient[j]
                psi = h_dot + class_k.value(alphas[0], psi)
                lags |= psi < 0.0
            along = whole = 0.0
            for j in range(gradient.size):
                along += gradient[j] * f[i, j]
                whole += gradient[j] * gradient[j]
            row[CONDITIONING] = _in_inputs(gradient, terms.g[i], whole * steer, row[WIDTH:])
            alpha2_psi = class_k.value(alphas[1], psi)
            row[B], row[H] = -alpha2_psi - along - rate, h
            row[ALPHA2_PSI], row[PSI] = alpha2_psi, psi
    return lags


@kernel(error_model="numpy")
def take_rows(made: Array, degrees: Integers, alpha2: Array, out: Array) -> bool:
    """Write rows of functions, and return whether a ψ_1 of one is below zero.

    Args:
        made: (N, m, n_u + 5) a, b, h, α₂(ψ), conditioning and early inputs.
        degrees: (m,) of the functions.
        alpha2: (4,) α₂.
        out: (N, m, WIDTH + n_u) written to.
    """
    lags = False
    n_u = made.shape[2] - 5
    for i in range(made.shape[0]):
        for k in range(made.shape[1]):
            one, row = made[i, k], out[i, k]
            row[B], row[H], row[ALPHA2_PSI] = one[n_u], one[n_u + 1], one[n_u + 2]
            if degrees[k] == 2:
                row[B] += row[QUICKENING]
            row[PSI] = class_k.inverse(alpha2, one[n_u + 2])
            row[CONDITIONING] = one[n_u + 3]
            row[WIDTH:] = one[:n_u]
            lags |= degrees[k] == 2 and row[PSI] < 0.0
    return lags


@kernel(error_model="numpy", inline="always")
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


@kernel(error_model="numpy", inline="always")
def _own_jet(jet: Array, f: Array, gradient: Array, turned: Array) -> tuple[float, float, float]:
    """Write and return the same of a user's own barrier, whose jet (jet_width,) was packed."""
    n = f.size
    bent = jet[2]
    for j in range(n):
        gradient[j], turned[j] = jet[3 + j], jet[3 + n + j]
        bent += jet[3 + n + j] * f[j]
        for q in range(n):
            turned[j] += jet[3 + (2 + j) * n + q] * f[q]
    return jet[0], jet[1], bent


@kernel(error_model="numpy", inline="always")
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
        a[j] = 0.0
        for q in range(gradient.size):
            a[j] += gradient[q] * g[q, j]
        reached += a[j] * a[j]
    share = np.sqrt(reached / size) if size > 0.0 else 0.0
    if share > VANISHED:
        return share
    a[:] = 0.0
    return 0.0
