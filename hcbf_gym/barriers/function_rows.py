"""The rows of users' functions, compiled together, by automatic differentiation."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.class_k import BrakeClassK, ClassK, LinearClassK
from hcbf_gym.barriers.function import Function, Scalar
from hcbf_gym.barriers.relative_degree import VANISHED, Reach, first_reach, samples
from hcbf_gym.models.autodiff import compile64, import_jax, run64
from hcbf_gym.models.reduced_order import ReducedOrderModel

_Alphas = tuple[Callable[[Any], Any], Callable[[Any], Any]]  # α₁ and α₂, in jax.numpy
_PROBE = 1e-6  # how far to both sides of x a kink is looked for, relative to 1 + |x|
_LEAST_KINK = 1e-2  # the relative change of slope that counts as a kink; curvature is below


class FunctionRow(NamedTuple):
    """One row, whose columns the core reads in the order of these fields.

    Conditioning is 0 where no input enters the row or L_g ψ_{r−1} is not finite, and less than 1
    where L_g ψ_{r−1} is small or h has a kink. Early inputs are the largest entry of |L_g ψ_k| for
    k < r − 1, relative to `Reach.size`; they are NaN where h is not, so that one test finds both.
    """

    a: Any  # (n_u,) L_g ψ_{r−1}
    b: Any
    h: Any  # without the margin
    alpha2_psi: Any  # α₂(ψ_{r−1})
    conditioning: Any
    early_inputs: Any

    @classmethod
    def column(cls, field: str) -> int:
        """Return the column of a field behind a (n_u,), counted from the end."""
        return cls._fields.index(field) - len(cls._fields)


class RowsKernel:
    """The rows of m functions for one model, by the equations of `GeneralRows`.

    A row is a `FunctionRow`. Where a derivative is not finite, the row is not either.

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
        at_state: x, t, margins, their rates and parameters in one array → the rows (m, n_u + 5).
        at_states: the same in five arrays with a leading K → (m (n_u + 5), K).
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
        run = compile64 if compiled else run64
        batched = jax.vmap(kernel)
        self.at_state = run(_with_one_array(kernel, model.n, len(functions)))
        self.at_states = run(lambda *inputs: jax.numpy.stack(batched(*inputs)))


def reach_of_function(model: ReducedOrderModel, function: Function) -> Reach:
    """Return how inputs reach a function; raise an error if not by one of n derivatives."""
    jax = import_jax("barriers.Function")
    states, times = samples(model)

    def at_samples(derivative: Callable[[Any, Any], Any]) -> Array:
        return np.array(run64(jax.vmap(derivative))(states, times))

    def lie_derivatives() -> Iterator[Array]:
        psi: Scalar = function.traced
        for _ in range(model.n):
            yield at_samples(_lie_along_inputs(model, psi)).T
            psi = _lie_along_drift(model, psi)

    gradients = at_samples(jax.grad(function.traced))
    return first_reach(function, model, gradients, lie_derivatives())


def _lie_along_drift(model: ReducedOrderModel, h: Scalar) -> Scalar:
    """Return (x, t) → L_f h + ∂h/∂t."""
    jax = import_jax("barriers.Function")
    return lambda x, t: jax.jvp(h, (x, t), (model.f(x), 1.0))[1]


def _lie_along_inputs(model: ReducedOrderModel, h: Scalar) -> Callable[[Any, Any], list[Any]]:
    """Return (x, t) → L_g h, a list of n_u scalars."""
    jax = import_jax("barriers.Function")

    def lie_derivatives(x: Any, t: Any) -> list[Any]:
        g, zero = model.g(x), 0.0 * t
        return [jax.jvp(h, (x, t), (g[:, j], zero))[1] for j in range(model.n_u)]

    return lie_derivatives


def _traced_class_k(alpha: ClassK) -> Callable[[Any], Any]:
    """Return α written in jax.numpy; its slope at 0 is defined, too."""
    jnp = import_jax("barriers.Function").numpy
    parameters = alpha.parameters()[1:].tolist()
    if alpha.code == LinearClassK.code:
        gain = parameters[0]
        return lambda h: gain * h
    if alpha.code == BrakeClassK.code:
        deceleration, _, offset = parameters

        def brake(h: Any) -> Any:
            # equal to sign(h) (√(2a|h| + c²) − c), but with a slope at 0, as there is no sign
            root = jnp.sqrt(2.0 * deceleration * jnp.abs(h) + offset * offset)
            return 2.0 * deceleration * h / (root + offset)

        return brake
    phi1, phi2, phi3 = parameters

    def logarithm(h: Any) -> Any:
        sign = jnp.where(h >= 0.0, 1.0, -1.0)  # jnp.sign would have no slope at 0
        return sign * phi1 * jnp.log1p(sign * h * (phi2 / phi3))

    return logarithm


def _rows_kernel(
    model: ReducedOrderModel,
    functions: Sequence[Function],
    reaches: Sequence[Reach],
    alphas: _Alphas,
) -> Callable[..., list[Any]]:
    """Return (x, t, margins (m,), rates (m,), parameters) → the numbers of all rows in one list."""
    jax = import_jax("barriers.Function")
    ends = np.cumsum([function.packed.size for function in functions])[:-1].tolist()

    def kernel(x: Any, t: Any, margins: Any, rates: Any, parameters: Any) -> list[Any]:
        t = jax.numpy.asarray(t, dtype=x.dtype)
        parameters_of = jax.numpy.split(parameters, ends)
        numbers: list[Any] = []
        for k, (function, reach) in enumerate(zip(functions, reaches, strict=True)):
            # without it XLA fuses rows with each other, which costs time and compilation
            inputs = jax.lax.optimization_barrier((x, t, margins[k], rates[k], parameters_of[k]))
            row = _function_row(model, function, reach, alphas, inputs)
            numbers += [*row.a, *row[1:]]
        return numbers

    return kernel


def _function_row(
    model: ReducedOrderModel,
    function: Function,
    reach: Reach,
    alphas: _Alphas,
    inputs: tuple[Any, ...],
) -> FunctionRow:
    """Return the row of one function, while JAX traces it."""
    jnp = import_jax("barriers.Function").numpy
    alpha1, alpha2 = alphas
    x, t, margin, margin_rate, parameters = inputs
    h = function.with_parameters(parameters)

    def psi_0(x: Any, time: Any) -> Any:
        return h(x, time) - margin - margin_rate * (time - t)

    psi: Scalar = psi_0
    early_inputs = jnp.zeros(())
    for _ in range(reach.degree - 1):
        early_inputs = _largest(jnp, [early_inputs, *_lie_along_inputs(model, psi)(x, t)])
        psi = _next_psi(model, psi, alpha1)
    a = _lie_along_inputs(model, psi)(x, t)
    alpha2_psi = alpha2(psi(x, t))
    b = -alpha2_psi - _lie_along_drift(model, psi)(x, t)
    size = _largest(jnp, a)
    value = h(x, t)
    kink = _kink(jnp, h, x, t)
    has_vanished = size <= VANISHED * reach.size
    conditioning = jnp.where(size < reach.size, size / reach.size, 1.0) * (1.0 - kink)
    return FunctionRow(
        [jnp.where(has_vanished, 0.0, entry) for entry in a],
        b,
        value,
        alpha2_psi,
        jnp.where(has_vanished | ~jnp.isfinite(size), 0.0, conditioning),
        jnp.where(jnp.isfinite(value), early_inputs / reach.size, jnp.nan),
    )


def _with_one_array(kernel: Callable[..., list[Any]], n: int, m: int) -> Callable[[Any], Any]:
    """Return the kernel with one array in, and one out: each costs several microseconds."""
    jnp = import_jax("barriers.Function").numpy
    ends = n, n + 1, n + 1 + m, n + 1 + 2 * m  # of x, t, margins and rates; parameters follow

    def packed_kernel(inputs: Any) -> Any:
        x, t, margins, rates, parameters = jnp.split(inputs, ends)
        return jnp.stack(kernel(x, t[0], margins, rates, parameters)).reshape(m, -1)

    return packed_kernel


def _largest(jnp: Any, values: Sequence[Any]) -> Any:
    """Return max |v_i|."""
    largest, *others = (jnp.abs(value) for value in values)
    for other in others:
        largest = jnp.where(other > largest, other, largest)
    return largest


def _kink(jnp: Any, h: Scalar, x: Any, t: Any) -> Any:
    """Return by how much the slope of h changes within `_PROBE` of x: 0 if smooth, 1 at most.

    It is ``|Δ₊ − Δ₋| / (|Δ₊| + |Δ₋|)``, of the differences of h to both sides of x.
    """
    oblique = np.cos(np.arange(1.0, x.shape[0] + 1.0))  # along no axis and no diagonal
    probe = _PROBE * (1.0 + jnp.abs(x)) * oblique
    here = h(x, t)
    ahead = h(x + probe, t) - here
    behind = here - h(x - probe, t)
    total = jnp.abs(ahead) + jnp.abs(behind)
    change = jnp.abs(ahead - behind) / jnp.where(total > 0.0, total, 1.0)
    return jnp.where(change > _LEAST_KINK, change, 0.0)


def _next_psi(model: ReducedOrderModel, psi: Scalar, alpha: Callable[[Any], Any]) -> Scalar:
    """Return ψ_{k+1} = L_f ψ_k + ∂ψ_k/∂t + α(ψ_k)."""
    rate = _lie_along_drift(model, psi)
    return lambda x, t: rate(x, t) + alpha(psi(x, t))
