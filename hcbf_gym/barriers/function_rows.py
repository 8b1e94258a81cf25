"""The rows of users' functions, compiled together, by automatic differentiation.

A row has n_u + 5 columns: a (n_u,), b, h, α₂(ψ), its conditioning, and early inputs, the largest
entry of L_g ψ below the relative degree. Conditioning is 0 where a row does not depend on the input
or is not finite, and less than 1 where L_g ψ is small or turns at a kink of h.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.function import Function, Scalar
from hcbf_gym.barriers.relative_degree import VANISHED, Reach, first_reach, samples
from hcbf_gym.models.autodiff import compile64, import_jax, run64
from hcbf_gym.models.reduced_order import ReducedOrderModel

H, EARLY = -4, -1
"""The columns of h and of early inputs, from the end."""

_PROBE = 1e-6  # how far to both sides a kink is looked for, relative to 1 + |x|
_KINK = 1e-2  # least relative turn that counts as one; curvature and rounding stay below


class RowsKernel:
    """The rows of m functions for one model, by the equations of `GeneralRows`.

    Every call returns early inputs, so that its caller finds an input below the relative degree.
    Where a derivative is not finite, the row is not either.

    Args:
        model: ẋ = f(x) + g(x)u, with f and g in jax.numpy (the models of this package are).
        functions: m ≥ 1 conditions.
        alpha1: α₁, applied to every ψ but the last.
        alpha2: α₂, applied to the last ψ.
        compiled: whether JAX compiles the rows, which takes half a second; without it a call
            takes some hundred times as long.

    Raises:
        InvalidInputError: if no input reaches a function, or f, g or h cannot be differentiated.

    Attributes:
        reaches: how inputs reach each of the functions.
    """

    def __init__(
        self,
        model: ReducedOrderModel,
        functions: Sequence[Function],
        alpha1: ClassK,
        alpha2: ClassK,
        compiled: bool = True,
    ) -> None:
        self.model = model
        self.reaches = [reach_of_function(model, function) for function in functions]
        alphas = _traced_class_k(alpha1), _traced_class_k(alpha2)
        kernel = _rows_kernel(model, functions, self.reaches, alphas)
        jax = import_jax("barriers.Function")
        wrap = compile64 if compiled else run64
        many = jax.vmap(kernel)
        self.one = wrap(_packed(kernel, model.n, len(functions)))
        self.many = wrap(lambda *inputs: jax.numpy.stack(many(*inputs)))


def reach_of_function(model: ReducedOrderModel, function: Function) -> Reach:
    """Return how inputs reach a function, by any derivative.

    Raises:
        InvalidInputError: if none does.
    """
    jax = import_jax("barriers.Function")
    h = function.traced
    states, times = samples(model)

    def at_samples(derivative: Callable[[Any, Any], Any]) -> Array:
        return np.array(run64(jax.vmap(derivative))(states, times))

    def levels() -> Iterator[Array]:
        psi: Scalar = h
        for _ in range(model.n):
            yield at_samples(_along_inputs(model, psi)).T
            psi = _lie(model, psi)

    return first_reach(function, model, at_samples(jax.grad(h)), levels())


def _lie(model: ReducedOrderModel, h: Scalar) -> Scalar:
    """Return L_f h + ∂h/∂t."""
    jax = import_jax("barriers.Function")
    return lambda x, t: jax.jvp(h, (x, t), (model.f(x), 1.0))[1]


def _along_inputs(model: ReducedOrderModel, h: Scalar) -> Callable[[Any, Any], list[Any]]:
    """Return L_g h, n_u scalars."""
    jax = import_jax("barriers.Function")

    def lie(x: Any, t: Any) -> list[Any]:
        inputs = model.g(x)
        zero = 0.0 * t
        return [jax.jvp(h, (x, t), (inputs[:, j], zero))[1] for j in range(model.n_u)]

    return lie


def _traced_class_k(alpha: ClassK) -> Callable[[Any], Any]:
    """Return α for JAX, with its slope at 0."""
    jnp = import_jax("barriers.Function").numpy
    kind, *numbers = alpha.parameters().tolist()
    if kind == 0.0:
        return lambda h: numbers[0] * h
    if kind == 2.0:
        a, _, c = numbers
        return lambda h: 2.0 * a * h / (jnp.sqrt(2.0 * a * jnp.abs(h) + c * c) + c)
    phi1, phi2, phi3 = numbers

    def logarithm(h: Any) -> Any:
        sign = jnp.where(h >= 0.0, 1.0, -1.0)
        return sign * phi1 * jnp.log1p(sign * h * (phi2 / phi3))

    return logarithm


def _rows_kernel(
    model: ReducedOrderModel,
    functions: Sequence[Function],
    reaches: Sequence[Reach],
    alphas: tuple[Callable[[Any], Any], Callable[[Any], Any]],
) -> Callable[..., Any]:
    """Return (x, t, margin, rate, parameters) → the columns of m rows, one row behind another.

    Early inputs are NaN where h is not finite, so that one comparison finds both.
    """
    jax = import_jax("barriers.Function")
    jnp = jax.numpy
    barrier = jax.lax.optimization_barrier
    alpha1, alpha2 = alphas
    ends = np.cumsum([function.packed.size for function in functions]).tolist()

    def row(k: int, x: Any, t: Any, margin: Any, rate: Any, parameters: Any) -> list[Any]:
        value = functions[k].of(parameters)
        scale = reaches[k].size
        psi: Scalar = lambda x, s: value(x, s) - margin - rate * (s - t)  # noqa: E731
        early = jnp.zeros(())
        for _ in range(reaches[k].degree - 1):
            early = _largest(jnp, [early, *_along_inputs(model, psi)(x, t)])
            psi = _next(model, psi, alpha1)
        a = _along_inputs(model, psi)(x, t)
        bound = alpha2(psi(x, t))
        b = -bound - _lie(model, psi)(x, t)
        size = _largest(jnp, a)
        h = value(x, t)
        turn = _kink(jnp, value, x, t)
        gone = size <= VANISHED * scale
        conditioning = jnp.where(size < scale, size / scale, 1.0) * (1.0 - turn)
        return [
            *(jnp.where(gone, 0.0, entry) for entry in a),
            b,
            h,
            bound,
            jnp.where(gone | ~jnp.isfinite(size), 0.0, conditioning),
            jnp.where(jnp.isfinite(h), early / scale, jnp.nan),
        ]

    def kernel(x: Any, t: Any, margin: Any, rate: Any, parameters: Any) -> list[Any]:
        t = jnp.asarray(t, dtype=x.dtype)
        own = [
            parameters[end - f.packed.size : end] for f, end in zip(functions, ends, strict=True)
        ]
        # the barriers stop XLA from fusing rows with each other, which costs time and compilation
        rows = (row(k, *barrier((x, t, margin[k], rate[k], own[k]))) for k in range(len(functions)))
        return [entry for entries in rows for entry in entries]

    return kernel


def _packed(kernel: Callable[..., Any], n: int, m: int) -> Callable[[Any], Any]:
    """Return the kernel with one array in, and one out: each costs several microseconds."""
    jnp = import_jax("barriers.Function").numpy

    def packed(inputs: Any) -> Any:
        x, t, margin, rate, parameters = jnp.split(inputs, (n, n + 1, n + 1 + m, n + 1 + 2 * m))
        return jnp.stack(kernel(x, t[0], margin, rate, parameters)).reshape(m, -1)

    return packed


def _largest(jnp: Any, values: Sequence[Any]) -> Any:
    """Return max |v_i|."""
    largest, *others = (jnp.abs(value) for value in values)
    for other in others:
        largest = jnp.where(other > largest, other, largest)
    return largest


def _kink(jnp: Any, h: Scalar, x: Any, t: Any) -> Any:
    """Return how much h turns within `_PROBE` of x: 0 where it is smooth, up to 1 at a kink."""
    probe = _PROBE * (1.0 + jnp.abs(x)) * np.cos(np.arange(1.0, x.shape[0] + 1.0))
    here = h(x, t)
    ahead = h(x + probe, t) - here
    behind = here - h(x - probe, t)
    whole = jnp.abs(ahead) + jnp.abs(behind)
    turned = jnp.abs(ahead - behind) / jnp.where(whole > 0.0, whole, 1.0)
    return jnp.where(turned > _KINK, turned, 0.0)


def _next(model: ReducedOrderModel, psi: Scalar, alpha: Callable[[Any], Any]) -> Scalar:
    """Return ψ̇ along the drift, plus α(ψ)."""
    rate = _lie(model, psi)
    return lambda x, t: rate(x, t) + alpha(psi(x, t))
