"""Models as the core evaluates them: those that ship in C++, others by their own functions."""

from collections.abc import Callable, Iterator

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.errors import UNREADABLE
from hcbf_gym.models.reduced_order import BuiltIn, ReducedOrderModel


def compiled(model: ReducedOrderModel) -> _core.Model:
    """Return a model for the core."""
    if isinstance(model, BuiltIn) and model.is_own:
        return model.core
    return _core.PythonModel(model.n, model.n_u, model.n_p, Answers(model))


class Answers:
    """What a model ẋ = f(x) + g(x)u returns at N states; NaN at those where it fails."""

    def __init__(self, model: ReducedOrderModel) -> None:
        self._model, self._n, self._n_u = model, model.n, model.n_u

    def terms(self, x: Array) -> tuple[Array, Array]:
        """Return f (N, n) and g (N, n, n_u)."""
        shapes = (self._n,), (self._n, self._n_u)
        f, g = _each(self._model.terms_of, len(x), shapes, x)
        return f, g

    def jacobians(self, x: Array) -> Array:
        """Return ∂f/∂x (N, n, n)."""
        return _each(lambda x: (self._model.jacobians_of(x),), len(x), ((self._n, self._n),), x)[0]

    def steps(self, x: Array, u: Array, dt: float) -> Array:
        """Return (N, n) the states after dt [s]."""
        step = self._model.steps_of
        return _each(lambda x, u: (step(x, u, dt),), len(x), ((self._n,),), x, u)[0]

    def brakes(self, x: Array, dt: float) -> Array:
        """Return (N, n_u) the inputs that stop the plants within dt [s]."""
        brakes = self._model.brakes_of
        return _each(lambda x: (brakes(x, dt),), len(x), ((self._n_u,),), x)[0]


def _each(
    function: Callable[..., tuple[Array, ...]],
    count: int,
    shapes: tuple[tuple[int, ...], ...],
    *at: Array,
) -> tuple[Array, ...]:
    """Return what a function of N states returns, in the given shapes; NaN where it fails."""

    def answers(*part: Array) -> Iterator[Array]:
        for answer, shape in zip(function(*part), shapes, strict=True):
            numbers = np.ascontiguousarray(answer, dtype=np.float64)
            if numbers.shape != (len(part[0]), *shape):
                raise ValueError(f"got shape {numbers.shape}")
            yield numbers

    try:
        return tuple(answers(*at))
    except UNREADABLE:
        if count == 1:
            return tuple(np.full((1, *shape), np.nan) for shape in shapes)
    parts = [_each(function, 1, shapes, *(one[i : i + 1] for one in at)) for i in range(count)]
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))
