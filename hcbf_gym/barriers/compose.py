"""Functions h(x, t) from others: their minimum and maximum, for JAX.

Each takes functions, `Function` barriers or built-in shapes, and returns a function that
`barriers.Function` takes. `minimum` and `maximum` have kinks, where a row's conditioning falls;
instead of a minimum, prefer two barriers of one priority.
"""

from typing import Any

from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.barriers.function import Function, Scalar
from hcbf_gym.barriers.shape import Shape
from hcbf_gym.barriers.shapes import SHAPES
from hcbf_gym.barriers.speed_limit import SpeedLimit
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.autodiff import import_jax

Part = Scalar | Barrier


def minimum(*parts: Part) -> Scalar:
    """Return ``min h_i``: every part holds."""
    functions = _functions(parts)
    jnp = import_jax("minimum").numpy

    def least(x: Any, t: Any) -> Any:
        value, *others = (h(x, t) for h in functions)
        for other in others:
            value = jnp.where(other < value, other, value)  # one part's derivatives, never a mean
        return value

    return least


def maximum(*parts: Part) -> Scalar:
    """Return ``max h_i``: at least one part holds."""
    functions = _functions(parts)
    jnp = import_jax("maximum").numpy

    def greatest(x: Any, t: Any) -> Any:
        value, *others = (h(x, t) for h in functions)
        for other in others:
            value = jnp.where(other > value, other, value)
        return value

    return greatest


def traced(barrier: Barrier) -> Scalar:
    """Return h(x, t) of a built-in shape or a `Function`, for JAX.

    Raises:
        InvalidInputError: on other barriers.
    """
    if isinstance(barrier, Function):
        return barrier.of(barrier.packed)
    if isinstance(barrier, SpeedLimit):
        v_max = barrier.v_max
        return lambda x, t: (v_max**2 - x[2] ** 2 - x[3] ** 2) / (2.0 * v_max)
    if isinstance(barrier, Shape) and type(barrier) in SHAPES:
        value = barrier.traced(import_jax("compose"))
        wx, wy = barrier.frame_velocity.tolist()
        return lambda x, t: value(x[0] - wx * t, x[1] - wy * t)
    raise InvalidInputError(
        f"{barrier.name}: got {type(barrier).__name__}, expected a built-in shape or a Function"
    )


def _functions(parts: tuple[Part, ...]) -> list[Scalar]:
    if not parts:
        raise InvalidInputError("compose: nothing is given, expected a function or barrier")
    return [traced(part) if isinstance(part, Barrier) else part for part in parts]
