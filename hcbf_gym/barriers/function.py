"""A user's own h(x, t): its derivatives and rows by automatic differentiation (the extra `jax`)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.barriers.barrier import Barrier, Jet
from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.autodiff import compile64, import_jax
from hcbf_gym.models.reduced_order import ReducedOrderModel

Array = NDArray[np.float64]
Scalar = Callable[[Any, Any], Any]

VANISHED = 1e-9
"""Below it, relative to its size at sampled states, L_g ψ counts as zero."""

_SAMPLES = 64
_PROBE = 1e-6  # how far to both sides a kink is looked for, relative to 1 + |x|
_KINK = 1e-2  # least relative turn that counts as one; curvature and rounding stay below


@dataclass(frozen=True)
class Function(Barrier):
    """A condition ``h(x, t) ≥ 0`` written with jax.numpy.

    Rows compile once for each tuple of `Function` objects: keep the objects. What moves or is
    sensed goes into t, or into x as states of the model that no input drives. Constants are Python
    numbers or NumPy arrays (arrays of jax.numpy would hold 32 bit).

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        function: (x (n,), t) → h, a scalar.

    Raises:
        InvalidInputError: if `function` cannot be called.
        MissingDependencyError: if JAX is not installed.

    Example:
        >>> import jax.numpy as jnp
        >>> from hcbf_gym import barriers
        >>> ahead = barriers.Function(
        ...     "pillar", 1, lambda x, t: jnp.hypot(x[0] + 0.2 * jnp.cos(x[2]) - 1.0, x[1]) - 0.7
        ... )
        >>> round(ahead.h(np.array([0.0, 0.0, 0.0])), 3)
        0.1
    """

    function: Scalar

    def __post_init__(self) -> None:
        super().__post_init__()
        if not callable(self.function):
            raise InvalidInputError(
                f"{self.name}: got {self.function!r}, expected a function h(x, t)"
            )
        import_jax("barriers.Function")

    @cached_property
    def _compiled(self) -> Callable[..., Any]:
        return _compile_jet(self)

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields alone: what is compiled is not copied."""
        return {"name": self.name, "priority": self.priority, "function": self.function}

    def traced(self, x: Any, t: Any) -> Any:
        """Return h while JAX traces it.

        Raises:
            InvalidInputError: if `function` is not written with jax.numpy or returns no scalar.
        """
        jax = import_jax("barriers.Function")
        try:
            h = jax.numpy.asarray(self.function(x, t))
        except (jax.errors.TracerArrayConversionError, jax.errors.ConcretizationTypeError) as error:
            raise InvalidInputError(
                f"{self.name}: got NumPy or a branch on the state, expected h(x, t) in jax.numpy "
                "(and jnp.where)"
            ) from error
        if h.shape != ():
            raise InvalidInputError(f"{self.name}: got h of shape {h.shape}, expected a scalar")
        return h

    def jet(self, x: Array, t: float = 0.0) -> Jet:
        """Return h and its derivatives."""
        h, gradient, hessian, rate, gradient_rate, rate_rate = self._compiled(x, float(t))
        return Jet(
            float(h),
            np.array(gradient),
            np.array(hessian),
            float(rate),
            np.array(gradient_rate),
            float(rate_rate),
        )


def _compile_jet(barrier: Function) -> Callable[..., Any]:
    jax = import_jax("barriers.Function")
    h = barrier.traced
    of_x, of_t = jax.grad(h, 0), jax.grad(h, 1)

    def jet(x: Any, t: Any) -> tuple[Any, ...]:
        hessian, gradient_rate = jax.jacfwd(of_x, (0, 1))(x, t)
        return h(x, t), of_x(x, t), hessian, of_t(x, t), gradient_rate, jax.grad(of_t, 1)(x, t)

    return compile64(jet)


class FunctionRows:
    r"""The rows of m functions for one model, compiled together.

    With r the relative degree, :math:`ψ_0 = h − \text{margin}` and
    :math:`ψ_k = L_f ψ_{k−1} + ∂ψ_{k−1}/∂t + α_1(ψ_{k−1})` for 0 < k < r, the row is
    :math:`a = L_g ψ_{r−1}`, :math:`b = −α_2(ψ_{r−1}) − L_f ψ_{r−1} − ∂ψ_{r−1}/∂t`.

    The relative degree is the least r at which L_g ψ differs from 0 at a sampled state. Every call
    checks that no input appears earlier. Where L_g ψ vanishes at a state, or has no finite value,
    a is 0; b then says that the row is violated unless it holds whatever the input is.

    Args:
        model: ẋ = f(x) + g(x)u, with f and g in jax.numpy (the models of this package are).
        functions: m ≥ 1 conditions.
        alpha1: α₁, applied to every ψ but the last.
        alpha2: α₂, applied to the last ψ.

    Raises:
        InvalidInputError: if no input reaches a function, or f, g or h cannot be differentiated.

    Attributes:
        degrees: (m,) relative degrees.
    """

    def __init__(
        self,
        model: ReducedOrderModel,
        functions: Sequence[Function],
        alpha1: ClassK,
        alpha2: ClassK,
    ) -> None:
        self.model, self.functions = model, tuple(functions)
        self.degrees, self._scales = _relative_degrees(model, self.functions)
        self._priority = np.array([f.priority for f in self.functions], dtype=np.int64)
        alphas = _traced_class_k(alpha1), _traced_class_k(alpha2)
        kernel = _rows_kernel(model, self.functions, self.degrees, self._scales, alphas)
        jax = import_jax("barriers.Function")
        many = jax.vmap(kernel, (0, 0, None, None))
        self._one = compile64(_packed(kernel, model.n, len(self.functions)))
        self._many = compile64(lambda *inputs: jax.numpy.stack(many(*inputs)))

    def __call__(
        self, x: Array, t: Any, margin: Array, margin_rate: Array
    ) -> tuple[CbfRows, Array]:
        """Return the rows of one state x (n,), or of N states (N, n), and their conditioning.

        Args:
            x: (n,) or (N, n) states.
            t: time [s]; (N,) for N states.
            margin: (m,) what each row keeps between h and zero.
            margin_rate: (m,) d margin/dt.

        Returns:
            The rows and (…, m) numbers from 0 to 1: 0 where a row does not depend on the input or
            is not finite, less than 1 where L_g ψ is small or turns at a kink of h.

        Raises:
            InvalidInputError: if h is not finite, or an input appears below the relative degree.
        """
        m, n_u = len(self.functions), self.model.n_u
        if x.ndim == 1:
            inputs = np.concatenate((x, (t,), margin, margin_rate))
            out = np.asarray(self._one(inputs))
        else:
            out = np.asarray(self._many(x, t, margin, margin_rate))
            out = np.moveaxis(out.reshape(m, n_u + 5, len(x)), -1, 0)
        a, b, h = out[..., :n_u], out[..., n_u], out[..., n_u + 1]
        early = out[..., n_u + 4]
        if not early.max() <= VANISHED:
            self._refuse(h, early)
        priority = self._priority
        if x.ndim == 2:
            priority = np.broadcast_to(priority, b.shape)
        return CbfRows(a, b, h, priority, out[..., n_u + 2]), out[..., n_u + 3]

    def _refuse(self, h: Array, early: Array) -> None:
        """Raise the error that says which function is wrong."""
        for k, function in enumerate(self.functions):
            if not np.isfinite(h[..., k]).all():
                raise InvalidInputError(f"{function.name}: got h = {h[..., k]}, expected finite h")
            if not (early[..., k] <= VANISHED).all():
                raise InvalidInputError(
                    f"{function.name}: got an input in a derivative below the relative degree "
                    f"{self.degrees[k]} of all sampled states, expected one degree everywhere"
                )


def _lie(model: ReducedOrderModel, h: Scalar) -> Scalar:
    """Return L_f h + ∂h/∂t."""
    jax = import_jax("barriers.Function")
    return lambda x, t: jax.jvp(h, (x, t), (model.f(x), 1.0))[1]


def _along_inputs(model: ReducedOrderModel, h: Scalar) -> Callable[[Any, Any], list[Any]]:
    """Return L_g h, n_u scalars."""
    jax = import_jax("barriers.Function")

    def lie(x: Any, t: Any) -> list[Any]:
        inputs, zero = model.g(x), 0.0 * t
        return [jax.jvp(h, (x, t), (inputs[:, j], zero))[1] for j in range(model.n_u)]

    return lie


def _relative_degrees(
    model: ReducedOrderModel, functions: Sequence[Function]
) -> tuple[NDArray[np.int64], Array]:
    """Return the relative degrees (m,) and the size (m,) of L_g at sampled states.

    Raises:
        InvalidInputError: if no input reaches a function.
    """
    jax = import_jax("barriers.Function")
    rng = np.random.default_rng(0)
    states, times = rng.normal(size=(_SAMPLES, model.n)), rng.uniform(0.0, 1.0, _SAMPLES)
    degrees, scales = np.zeros(len(functions), dtype=np.int64), np.ones(len(functions))
    derivatives: dict[int, Scalar] = {k: function.traced for k, function in enumerate(functions)}
    for degree in range(1, model.n + 1):
        for k, h in list(derivatives.items()):
            looks = compile64(jax.vmap(_along_inputs(model, h)))(states, times)
            size = np.abs(np.array(looks)).max(axis=0)
            size = size[np.isfinite(size)]
            if size.size and size.max() > VANISHED:
                degrees[k], scales[k] = degree, np.median(size[size > VANISHED])
                del derivatives[k]
            else:
                derivatives[k] = _lie(model, h)
        if not derivatives:
            return degrees, scales
    name = functions[min(derivatives)].name
    raise InvalidInputError(
        f"{name}: got a function whose first {model.n} derivatives no input of {model} reaches at "
        f"any of {_SAMPLES} sampled states, expected a finite relative degree"
    )


def _traced_class_k(alpha: ClassK) -> Callable[[Any], Any]:
    """Return α for JAX, with its slope at 0."""
    jnp = import_jax("barriers.Function").numpy
    kind, *numbers = alpha.parameters().tolist()
    if kind == 0.0:
        return lambda h: numbers[0] * h
    phi1, phi2, phi3 = numbers

    def logarithm(h: Any) -> Any:
        sign = jnp.where(h >= 0.0, 1.0, -1.0)
        return sign * phi1 * jnp.log1p(sign * h * (phi2 / phi3))

    return logarithm


def _rows_kernel(
    model: ReducedOrderModel,
    functions: Sequence[Function],
    degrees: NDArray[np.int64],
    scales: Array,
    alphas: tuple[Callable[[Any], Any], Callable[[Any], Any]],
) -> Callable[..., Any]:
    """Return (x, t, margin, rate) → (m, n_u + 5): a, b, h, α₂(ψ), conditioning, early inputs.

    The last is nan where h is not finite, so that one comparison finds both.
    """
    jax = import_jax("barriers.Function")
    jnp, barrier = jax.numpy, jax.lax.optimization_barrier
    alpha1, alpha2 = alphas

    def row(k: int, x: Any, t: Any, margin: Any, rate: Any) -> list[Any]:
        psi: Scalar = lambda x, s: functions[k].traced(x, s) - margin - rate * (s - t)  # noqa: E731
        early = jnp.zeros(())
        for _ in range(degrees[k] - 1):
            early = _largest(jnp, [early, *_along_inputs(model, psi)(x, t)])
            psi = _next(model, psi, alpha1)
        a, bound = _along_inputs(model, psi)(x, t), alpha2(psi(x, t))
        b, size = -bound - _lie(model, psi)(x, t), _largest(jnp, a)
        h, bend = functions[k].traced(x, t), _bend(jnp, functions[k].traced, x, t)
        finite = jnp.isfinite(b) & jnp.isfinite(size)
        gone = ~finite | (size <= VANISHED * scales[k])
        conditioning = jnp.where(size < scales[k], size / scales[k], 1.0) * (1.0 - bend)
        return [
            *(jnp.where(gone, 0.0, entry) for entry in a),
            jnp.where(finite, b, jnp.abs(alpha2(h)) + VANISHED),
            h,
            jnp.where(finite, bound, 0.0),
            jnp.where(gone, 0.0, conditioning),
            jnp.where(jnp.isfinite(h), early / scales[k], jnp.nan),
        ]

    def kernel(x: Any, t: Any, margin: Any, rate: Any) -> list[Any]:
        t = jnp.asarray(t, dtype=x.dtype)
        # the barriers keep XLA from fusing rows with each other, which costs time and compilation
        rows = (row(k, *barrier((x, t, margin[k], rate[k]))) for k in range(len(functions)))
        return [entry for entries in rows for entry in entries]

    return kernel


def _packed(kernel: Callable[..., Any], n: int, m: int) -> Callable[[Any], Any]:
    """Return the kernel with one array in, (x, t, margin, rate), and one out, (m, n_u + 5).

    Every array that JAX takes costs several microseconds.
    """
    jnp = import_jax("barriers.Function").numpy

    def packed(inputs: Any) -> Any:
        x, t, margin, rate = jnp.split(inputs, (n, n + 1, n + 1 + m))
        return jnp.stack(kernel(x, t[0], margin, rate)).reshape(m, -1)

    return packed


def _largest(jnp: Any, values: Sequence[Any]) -> Any:
    """Return max |v_i|."""
    largest, *others = (jnp.abs(value) for value in values)
    for other in others:
        largest = jnp.where(other > largest, other, largest)
    return largest


def _bend(jnp: Any, h: Scalar, x: Any, t: Any) -> Any:
    """Return how much h turns within `_PROBE` of x: 0 where it is smooth, up to 1 at a kink."""
    probe = _PROBE * (1.0 + jnp.abs(x)) * np.cos(np.arange(1.0, x.shape[0] + 1.0))
    here = h(x, t)
    ahead, behind = h(x + probe, t) - here, here - h(x - probe, t)
    whole = jnp.abs(ahead) + jnp.abs(behind)
    turned = jnp.abs(ahead - behind) / jnp.where(whole > 0.0, whole, 1.0)
    return jnp.where(turned > _KINK, turned, 0.0)


def _next(model: ReducedOrderModel, psi: Scalar, alpha: Callable[[Any], Any]) -> Scalar:
    """Return ψ̇ along the drift, plus α(ψ)."""
    rate = _lie(model, psi)
    return lambda x, t: rate(x, t) + alpha(psi(x, t))
