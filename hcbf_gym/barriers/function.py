"""A user's own h(x, t), differentiated automatically (the extra `jax`); minimum and maximum."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import Barrier, Jet
from hcbf_gym.errors import InvalidInputError, finite_array, reals, shown
from hcbf_gym.models.autodiff import compile64, import_jax

Scalar = Callable[[Any, Any], Any]  # (x, t) → a scalar, while JAX traces it
Signature = tuple[Callable[..., Any], tuple[int, ...] | None]  # with the parameters' shape


@dataclass(frozen=True, eq=False)
class Function(Barrier):
    """A condition ``h(x, t) ≥ 0``, or ``h(x, t, p) ≥ 0``, written with jax.numpy.

    Rows compile once for each tuple of functions, however many `Function` objects hold them. What
    moves or is sensed is therefore an argument and no constant of the function: `parameters` p,
    the time t, or x, with states of the model that no input drives. Constants are Python numbers
    or NumPy arrays (arrays of jax.numpy would hold 32 bit).

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        function: (x (n,), t) → h, a scalar; (x, t, p) → h where there are parameters.
        parameters: p, an array of any shape; objects with the same `function` and p of the same
            shape share what was compiled.

    Raises:
        InvalidInputError: if `function` cannot be called or the parameters are not finite.
        MissingDependencyError: if JAX is not installed.

    Example:
        >>> import jax.numpy as jnp
        >>> from hcbf_gym import barriers
        >>> def clear(x, t, p):  # the distance of a pillar, which a sensor sees at p
        ...     return jnp.hypot(x[0] + 0.2 * jnp.cos(x[2]) - p[0], x[1] - p[1]) - 0.7
        >>> seen = barriers.Function("pillar", 1, clear, parameters=[1.0, 0.0])
        >>> round(seen.h(np.array([0.0, 0.0, 0.0])), 3)
        0.1
    """

    function: Callable[..., Any]
    parameters: ArrayLike | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not callable(self.function):
            raise InvalidInputError(
                f"{self.name}: got {shown(self.function)}, expected a function h(x, t)"
            )
        if self.parameters is not None:
            label = f"{self.name}: parameters"
            any_shape = (None,) * reals(label, self.parameters).ndim
            parameters = finite_array(label, self.parameters, any_shape)
            parameters.flags.writeable = False
            object.__setattr__(self, "parameters", parameters)
        import_jax("barriers.Function")

    def __eq__(self, other: object) -> bool:
        """Return whether both are the same condition."""
        return (
            isinstance(other, Function)
            and (self.name, self.priority) == (other.name, other.priority)
            and self.signature == other.signature
            and np.array_equal(self.packed, other.packed)
        )

    def __hash__(self) -> int:
        return hash((self.name, self.priority, self.signature))

    @property
    def signature(self) -> Signature:
        """The function and the shape of its parameters: equal ones share what is compiled."""
        return self.function, None if self.parameters is None else np.shape(self.parameters)

    @property
    def packed(self) -> Array:
        """The parameters as an array (k,); it is empty where there are none."""
        return np.zeros(0) if self.parameters is None else np.ravel(self.parameters)

    @cached_property
    def _compiled(self) -> Callable[..., Any]:
        return _compile_jet(*self.signature)

    def __getstate__(self) -> dict[str, object]:
        """Return the fields alone, because compiled code cannot be copied."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def with_parameters(self, packed: Any) -> Scalar:
        """Return (x, t) → h with these parameters (k,), for JAX to trace.

        A call raises an InvalidInputError if `function` is not in jax.numpy or returns no scalar.
        """
        return _traced(self.name, *self.signature, packed)

    def traced(self, x: Any, t: Any) -> Any:
        """Return h with the function's own parameters, while JAX traces it."""
        return self.with_parameters(self.packed)(x, t)

    def batch(self, x: Array, t: Array) -> Jet:
        """Return h and its derivatives at N states (N, n) and times (N,), in one compiled call."""
        traced_fields = _compile_jet(*self.signature, batched=True)(x, t, self.packed)
        return Jet._make(map(np.array, traced_fields))

    def jet(self, x: Array, t: float = 0.0) -> Jet:
        """Return h and its derivatives at the state x (n,) and time t [s]."""
        traced_fields = self._compiled(x, float(t), self.packed)
        return Jet._make(np.array(one) if np.ndim(one) else float(one) for one in traced_fields)


def _traced(
    name: str, function: Callable[..., Any], shape: tuple[int, ...] | None, packed: Any
) -> Scalar:
    """Return (x, t) → h with the parameters (k,), which are first given their shape again."""
    jax = import_jax("barriers.Function")

    def traced(x: Any, t: Any) -> Any:
        parameters = () if shape is None else (jax.numpy.reshape(packed, shape),)
        try:
            h = jax.numpy.asarray(function(x, t, *parameters))
        except (jax.errors.TracerArrayConversionError, jax.errors.ConcretizationTypeError) as error:
            raise InvalidInputError(
                f"{name}: got NumPy or a branch on the state, expected h(x, t) in jax.numpy "
                "(and jnp.where)"
            ) from error
        if h.shape != ():
            raise InvalidInputError(f"{name}: got h of shape {h.shape}, expected a scalar")
        if jax.numpy.iscomplexobj(h):  # JAX would differentiate its real part
            raise InvalidInputError(f"{name}: got h of {h.dtype}, expected a real number")
        return h

    return traced


@lru_cache(maxsize=32)
def _compile_jet(
    function: Callable[..., Any], shape: tuple[int, ...] | None, batched: bool = False
) -> Callable[..., Any]:
    """Return (x, t, parameters (k,)) → the fields of a `Jet`, at one state or at N if batched."""
    jax = import_jax("barriers.Function")

    def jet(x: Any, t: Any, packed: Any) -> tuple[Any, ...]:
        h = _traced("function", function, shape, packed)
        gradient, rate = jax.grad(h, 0), jax.grad(h, 1)
        hessian, gradient_rate = jax.jacfwd(gradient, (0, 1))(x, t)
        rate_rate = jax.grad(rate, 1)(x, t)
        return h(x, t), gradient(x, t), hessian, rate(x, t), gradient_rate, rate_rate

    return compile64(jax.vmap(jet, (0, 0, None)) if batched else jet)


def minimum(*parts: Scalar | Function) -> Scalar:
    """Return ``min h_i``, a function for `Function`: it is ≥ 0 where every part is.

    It has kinks, where a row's conditioning falls; prefer conditions of one priority.
    """
    return _extreme(parts, lambda value, best: value < best)


def maximum(*parts: Scalar | Function) -> Scalar:
    """Return ``max h_i``, which is ≥ 0 where at least one part is; it has kinks as `minimum`."""
    return _extreme(parts, lambda value, best: value > best)


def _extreme(parts: tuple[Scalar | Function, ...], is_better: Callable[[Any, Any], Any]) -> Scalar:
    """Return the best of the parts at every state, by `is_better(value, best)`."""
    if not parts:
        raise InvalidInputError("minimum, maximum: got nothing, expected functions h(x, t)")
    functions = [part.traced if isinstance(part, Function) else part for part in parts]
    jnp = import_jax("minimum, maximum").numpy

    def extreme(x: Any, t: Any) -> Any:
        best, *others = (h(x, t) for h in functions)
        for value in others:
            # jnp.minimum would give the mean of two derivatives where the parts are equal
            best = jnp.where(is_better(value, best), value, best)
        return best

    return extreme
