"""Models for the core: built-in ones in C++, and others, which call back into Python."""

from collections.abc import Callable, Iterator

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.errors import reals
from hcbf_gym.models.reduced_order import BuiltIn, ReducedOrderModel

Shapes = tuple[tuple[int, ...], ...]


def compiled(model: ReducedOrderModel) -> _core.Model:
    """Return the core's object of a model."""
    if isinstance(model, BuiltIn) and model.is_own:
        return model.core
    return _core.PythonModel(model.n, model.n_u, model.n_p, PythonModel(model))


class PythonModel:
    """The functions of a model at N states, for the core; rows are NaN where a function fails."""

    def __init__(self, model: ReducedOrderModel) -> None:
        self._model, self._n, self._n_u = model, model.n, model.n_u

    def terms(self, x: Array) -> tuple[Array, Array]:
        """Return f (N, n) and g (N, n, n_u) at states x (N, n)."""
        shapes = (self._n,), (self._n, self._n_u)
        f, g = _evaluated(self._model.terms_of, shapes, x)
        return f, g

    def jacobians(self, x: Array) -> Array:
        """Return ∂f/∂x (N, n, n) at states x (N, n)."""
        shape = (self._n, self._n)
        return _evaluated(lambda x: (self._model.jacobians_of(x),), (shape,), x)[0]

    def steps(self, x: Array, u: Array, dt: float) -> Array:
        """Return the states (N, n) that follow x (N, n) after dt [s] under inputs u (N, n_u)."""
        return _evaluated(lambda x, u: (self._model.steps_of(x, u, dt),), ((self._n,),), x, u)[0]

    def brakes(self, x: Array, dt: float) -> Array:
        """Return the inputs (N, n_u) that stop plants at states x (N, n) within dt [s]."""
        return _evaluated(lambda x: (self._model.brakes_of(x, dt),), ((self._n_u,),), x)[0]


def _evaluated(
    function: Callable[..., tuple[Array, ...]], shapes: Shapes, *arguments: Array
) -> tuple[Array, ...]:
    """Return the results (N, *shape) of a function of arguments (N, …), NaN where it fails.

    If the function fails for all states at once, it is called again for each of them.
    """
    count = len(arguments[0])
    try:
        return tuple(_checked(function(*arguments), shapes, count))
    except Exception:  # a user's own model may raise anything
        if count == 1:
            return tuple(np.full((1, *shape), np.nan) for shape in shapes)
    one_by_one = ([argument[i : i + 1] for argument in arguments] for i in range(count))
    rows = [_evaluated(function, shapes, *state) for state in one_by_one]
    return tuple(np.concatenate(results) for results in zip(*rows, strict=True))


def _checked(results: tuple[Array, ...], shapes: Shapes, count: int) -> Iterator[Array]:
    """Yield results (count, *shape) as float64 arrays; refuse others by a ValueError."""
    for result, shape in zip(results, shapes, strict=True):
        numbers = np.ascontiguousarray(reals("result", result))
        if numbers.shape != (count, *shape):
            raise ValueError(f"got shape {numbers.shape}")
        yield numbers
