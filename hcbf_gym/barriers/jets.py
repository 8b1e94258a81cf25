"""The jets of users' own barriers, checked."""

import math
from typing import Any

import numpy as np

from hcbf_gym.barriers.barrier import Barrier, Jet
from hcbf_gym.errors import InvalidInputError


def checked(barrier: Barrier, jet: Any, n: int, finite: bool = True) -> Jet:
    """Return what a barrier says of h and its derivatives.

    Args:
        barrier: which said it.
        jet: what it said.
        n: the number of states.
        finite: whether every number must be finite.

    Raises:
        InvalidInputError: if it is no jet of a function of n states, or not finite.
    """
    if isinstance(jet, Jet) and is_plain(jet, n):
        return jet
    shapes = (), (n,), (n, n), (), (n,), ()
    try:
        fields = [np.asarray(field) for field in jet]
        fits = len(fields) == len(shapes) and all(
            getattr(given, "shape", ()) == shape and field.dtype.kind in "fiu"
            for given, field, shape in zip(jet, fields, shapes, strict=False)
        )
    except (TypeError, ValueError):  # nothing to go through, or a ragged list
        fields = []
        fits = False
    if not fits:
        raise InvalidInputError(
            f"{barrier.name}: got the jet {jet!r}, expected a barriers.Jet of real numbers and "
            f"arrays: h, ∇h ({n},), ∇²h ({n}, {n}), ∂h/∂t, ∂∇h/∂t ({n},), ∂²h/∂t²"
        )
    if finite and not all(np.isfinite(field).all() for field in fields):
        raise InvalidInputError(f"{barrier.name}: got the jet {jet}, expected finite numbers")
    return Jet._make(jet)


def is_plain(jet: Jet, n: int) -> bool:
    """Tell in a few microseconds whether a jet is made of finite floats; False may be wrong."""
    h, gradient, hessian, rate, gradient_rate, rate_rate = jet
    arrays = gradient, hessian, gradient_rate
    if not all(type(part) is np.ndarray and part.dtype == np.float64 for part in arrays):
        return False
    if not all(isinstance(part, float) for part in (h, rate, rate_rate)):
        return False
    if gradient.shape != (n,) or hessian.shape != (n, n) or gradient_rate.shape != (n,):
        return False
    sizes = np.vdot(gradient, gradient) + np.vdot(hessian, hessian)
    sizes += np.vdot(gradient_rate, gradient_rate)
    return math.isfinite(sizes + abs(h) + abs(rate) + abs(rate_rate))
