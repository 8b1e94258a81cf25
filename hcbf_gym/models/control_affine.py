"""Control-affine models from two functions of a user."""

from collections.abc import Callable
from typing import Any

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, count, finite_array, in_words, reals, shown
from hcbf_gym.models.autodiff import compile64, import_jax, is_jax
from hcbf_gym.models.reduced_order import ReducedOrderModel, namespace


class ControlAffine(ReducedOrderModel):
    """The model ``ẋ = f(x) + g(x)u`` of two functions, written with NumPy or with jax.numpy.

    Functions that use jax.numpy are compiled, for N states at once too, and ∂f/∂x is exact; with
    NumPy it comes by central differences. `barriers.Function` of a relative degree above 1 needs
    the functions in jax.numpy.

    Args:
        f: x (n,) → (n,) the drift.
        g: x (n,) → (n, n_u) the input matrix.
        n: the number of states.
        n_u: the number of inputs.
        velocity_at: the index in x at which the planar velocity begins, which speed limits read;
            None if x has no such velocity.

    Raises:
        InvalidInputError: if a count is not positive, or a function raises an error or does not
            return numbers of its shape.

    Examples:
        >>> import numpy as np
        >>> from hcbf_gym import models
        >>> pendulum = models.ControlAffine(
        ...     f=lambda x: np.array([x[1], 15.0 * np.sin(x[0])]),
        ...     g=lambda x: np.array([[0.0], [3.0]]),
        ...     n=2,
        ...     n_u=1,
        ... )
    """

    def __init__(
        self,
        f: Callable[[Any], Any],
        g: Callable[[Any], Any],
        n: int,
        n_u: int,
        velocity_at: int | None = None,
    ) -> None:
        self.n = count("n", n)
        self.n_u = count("n_u", n_u)
        if velocity_at is not None:
            velocity_at = count("velocity_at", velocity_at, minimum=0, maximum=self.n - 2)
        self.velocity_at = velocity_at
        self._f, self._g = f, g
        probe = np.linspace(0.1, 0.9, self.n)
        drift, input_matrix = _value_at("f", f, probe), _value_at("g", g, probe)
        finite_array("f(x)", drift, (self.n,))
        finite_array("g(x)", input_matrix, (self.n, self.n_u))
        self._compiled_f = compile64(f) if is_jax(drift) else f
        self._compiled_g = compile64(g) if is_jax(input_matrix) else g
        self._jacobian: Callable[..., Any] | None = None
        self._batched_terms: Callable[..., Any] | None = None
        if is_jax(drift):
            self._jacobian = compile64(import_jax("f").jacfwd(f))
            if is_jax(input_matrix):
                self._batched_terms = compile64(import_jax("f").vmap(lambda x: (f(x), g(x))))

    def f(self, x: Any) -> Any:
        """Return (n,) the drift."""
        if isinstance(x, np.ndarray):
            return reals("f", self._compiled_f(x))
        return self._traced("f", self._f, x)

    def g(self, x: Any) -> Any:
        """Return (n, n_u) the input matrix."""
        if isinstance(x, np.ndarray):
            return reals("g", self._compiled_g(x))
        return self._traced("g", self._g, x)

    def terms_of(self, x: Array) -> tuple[Array, Array]:
        """Return f (N, n) and g (N, n, n_u) at N states x (N, n)."""
        if self._batched_terms is None or len(x) == 1:
            return super().terms_of(x)
        f, g = self._batched_terms(x)
        return reals("f", f), reals("g", g)

    def f_jacobian(self, x: Array) -> Array:
        """Return (n, n) ∂f/∂x."""
        return super().f_jacobian(x) if self._jacobian is None else np.asarray(self._jacobian(x))

    def _traced(self, name: str, function: Callable[[Any], Any], x: Any) -> Any:
        """Return the function's value while JAX differentiates through it."""
        errors = import_jax("Function").errors
        try:
            value = namespace(x).asarray(function(x))
        except (errors.TracerArrayConversionError, errors.ConcretizationTypeError) as error:
            raise InvalidInputError(
                f"{name}: got NumPy or a branch on the state, expected jax.numpy (and jnp.where), "
                "as barriers.Function differentiates through the model"
            ) from error
        if namespace(x).iscomplexobj(value):  # JAX would differentiate its real part
            raise InvalidInputError(f"{name}: got {value.dtype}, expected real numbers")
        return value


def _value_at(name: str, function: Callable[[Any], Any], x: Array) -> Any:
    """Return the value of a user's function at a state x (n,); refuse one that raises an error."""
    if not callable(function):
        raise InvalidInputError(f"{name}: got {shown(function)}, expected a function of x (n,)")
    try:
        return function(x.copy())
    except Exception as error:  # a user's function may raise anything
        raise InvalidInputError(
            f"{name}: got {in_words(error)} at x = {shown(x.tolist())}, expected numbers"
        ) from error
