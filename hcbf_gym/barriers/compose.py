"""Functions h(x, t) from others: minimum, maximum, product, and their smooth forms, for JAX.

Each takes functions, `Function` barriers or built-in shapes, and returns a function that
`barriers.Function` takes. `minimum` and `maximum` have kinks, where a row's conditioning falls;
instead of a minimum, prefer two barriers of one priority.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from hcbf_gym.barriers.barrier import Barrier, PlanarBarrier
from hcbf_gym.barriers.function import Function, Scalar
from hcbf_gym.barriers.shapes import ConvexPolygon, Disc, Ellipse, HalfPlane, SpeedLimit
from hcbf_gym.errors import InvalidInputError, finite_float
from hcbf_gym.models.autodiff import import_jax

Part = Scalar | Barrier

_TINY = 1e-9


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


def product(*parts: Part) -> Scalar:
    """Return ``∏ h_i``; it is positive, too, where an even number of parts is negative."""
    functions = _functions(parts)
    jnp = import_jax("product").numpy
    return lambda x, t: jnp.stack([h(x, t) for h in functions]).prod()


def smooth_minimum(*parts: Part, sharpness: float) -> Scalar:
    """Return ``−log Σ exp(−k h_i) / k``, below the minimum by at most ``log(parts) / k``.

    Args:
        parts: functions or barriers.
        sharpness: k, in units of 1/h, positive.
    """
    functions, k = _functions(parts), _sharpness(sharpness)
    jax = import_jax("smooth_minimum")
    return lambda x, t: -_log_sum_exp(jax, [-k * h(x, t) for h in functions]) / k


def smooth_maximum(*parts: Part, sharpness: float) -> Scalar:
    """Return ``(log Σ exp(k h_i) − log parts) / k``, below the maximum by at most the last term.

    Args:
        parts: functions or barriers.
        sharpness: k, in units of 1/h, positive.
    """
    functions, k = _functions(parts), _sharpness(sharpness)
    jax, excess = import_jax("smooth_maximum"), np.log(len(parts))
    return lambda x, t: (_log_sum_exp(jax, [k * h(x, t) for h in functions]) - excess) / k


def traced(barrier: Barrier) -> Scalar:
    """Return h(x, t) of a built-in shape or a `Function`, for JAX.

    Raises:
        InvalidInputError: on other barriers.
    """
    if isinstance(barrier, Function):
        return barrier.of(barrier.packed)
    jnp = import_jax("compose").numpy
    if isinstance(barrier, SpeedLimit):
        v_max = barrier.v_max
        return lambda x, t: (v_max**2 - x[2] ** 2 - x[3] ** 2) / (2.0 * v_max)
    if isinstance(barrier, PlanarBarrier) and type(barrier) in _PLANAR:
        value, (wx, wy) = _PLANAR[type(barrier)](barrier, jnp), barrier.frame_velocity.tolist()
        return lambda x, t: value(x[0] - wx * t, x[1] - wy * t)
    raise InvalidInputError(
        f"{barrier.name}: got {type(barrier).__name__}, expected a built-in shape or a Function"
    )


def _functions(parts: tuple[Part, ...]) -> list[Scalar]:
    if not parts:
        raise InvalidInputError("compose: nothing is given, expected a function or barrier")
    return [traced(part) if isinstance(part, Barrier) else part for part in parts]


def _sharpness(value: float) -> float:
    return finite_float("sharpness", value, minimum=0.0, exclusive=True)


def _log_sum_exp(jax: Any, values: list[Any]) -> Any:
    return jax.nn.logsumexp(jax.numpy.stack(values))


Planar = Callable[[Any, Any], Any]


def _half_plane(barrier: HalfPlane, jnp: Any) -> Planar:
    (nx, ny), offset = barrier.normal, barrier.offset
    return lambda x, y: nx * x + ny * y - offset


def _disc(barrier: Disc, jnp: Any) -> Planar:
    (cx, cy), radius = barrier.center, barrier.radius
    return lambda x, y: _norm(jnp, x - cx, y - cy) - radius


def _ellipse(barrier: Ellipse, jnp: Any) -> Planar:
    (cx, cy), scale = barrier.center, min(barrier.semi_axes)
    (sxx, sxy), (syx, syy) = barrier.scaling.tolist()

    def value(x: Any, y: Any) -> Any:
        dx, dy = x - cx, y - cy
        return scale * (_norm(jnp, sxx * dx + sxy * dy, syx * dx + syy * dy) - 1.0)

    return value


def _polygon(barrier: ConvexPolygon, jnp: Any) -> Planar:
    corners = np.array(barrier.vertices)
    sides = np.concatenate([corners, np.roll(corners, -1, axis=0) - corners], axis=1).tolist()
    stop_gradient = import_jax("compose").lax.stop_gradient

    def nearest_side(x: Any, y: Any) -> tuple[Any, Any]:
        """Return whether (x, y) is outside, and the side that decides h: corner and direction."""
        height, nearest2, highest, nearest = -np.inf, np.inf, sides[0], sides[0]
        for side in sides:
            ax, ay, ex, ey = side
            length2, dx, dy = ex * ex + ey * ey, x - ax, y - ay
            above = (ey * dx - ex * dy) / np.sqrt(length2)
            along = jnp.clip((dx * ex + dy * ey) / length2, 0.0, 1.0)
            distance2 = (dx - along * ex) ** 2 + (dy - along * ey) ** 2
            higher, nearer = above > height, distance2 < nearest2
            highest = [jnp.where(higher, new, old) for new, old in zip(side, highest, strict=True)]
            nearest = [jnp.where(nearer, new, old) for new, old in zip(side, nearest, strict=True)]
            height, nearest2 = jnp.maximum(height, above), jnp.minimum(nearest2, distance2)
        outside = height > 0.0
        side = [jnp.where(outside, n, i) for n, i in zip(nearest, highest, strict=True)]
        return outside, side

    def value(x: Any, y: Any) -> Any:
        # which side it is has no derivative: only the chosen one is differentiated
        outside, (ax, ay, ex, ey) = nearest_side(stop_gradient(x), stop_gradient(y))
        length2, dx, dy = ex * ex + ey * ey, x - ax, y - ay
        above = (ey * dx - ex * dy) / jnp.sqrt(length2)
        along = (dx * ex + dy * ey) / length2
        end = (along <= 0.0) | (along >= 1.0)
        far = jnp.where(along > 0.5, 1.0, 0.0)
        to_corner = _norm(jnp, dx - far * ex, dy - far * ey)
        return jnp.where(outside & end, to_corner, above)

    return value


def _norm(jnp: Any, x: Any, y: Any) -> Any:
    """Return ‖(x, y)‖; at 0 its gradient is taken along +x, as the built-in shapes do."""
    square = x * x + y * y
    apart = square > _TINY**2
    return jnp.where(apart, jnp.sqrt(jnp.where(apart, square, 1.0)), x)


_PLANAR: dict[type[Barrier], Callable[[Any, Any], Planar]] = {
    HalfPlane: _half_plane,
    Disc: _disc,
    Ellipse: _ellipse,
    ConvexPolygon: _polygon,
}
