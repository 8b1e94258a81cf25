"""Arrays of NumPy, torch and JAX: read without a copy where they lie on the CPU, and given back."""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.errors import InvalidInputError, as_array, shown

Numbers = NDArray[Any]


def numpy_of(name: str, value: Any) -> Numbers:
    """Return an array of NumPy that looks into the memory of `value`, where that can be.

    Args:
        name: the argument's name, for the message.
        value: an array of NumPy, a tensor of torch, an array of JAX, or lists of numbers.

    Raises:
        InvalidInputError: on a tensor that needs a gradient or lies on another device, on an array
            that JAX traces, and on what is no array.
    """
    kind = _kind(value)
    if kind == "torch":
        if value.requires_grad:
            raise InvalidInputError(
                f"{name}: got a tensor that needs a gradient, expected one without: "
                f"{name}.detach(); the filter is no part of the graph"
            )
        if value.device.type != "cpu":
            raise InvalidInputError(
                f"{name}: got a tensor on {value.device}, expected one on the CPU: {name}.cpu()"
            )
        return as_array(name, value.numpy())
    if kind == "jax":
        jax = sys.modules["jax"]
        if isinstance(value, jax.core.Tracer):
            raise InvalidInputError(
                f"{name}: got {shown(value)}, which JAX traces, expected an array; inside jit call "
                "the filter by jax.pure_callback"
            )
    if np.ma.is_masked(value) and value.dtype.kind in "fiu":  # what a mask hides is no number
        return np.ma.filled(value.astype(np.float64), np.nan)
    return as_array(name, value)


def like(example: object) -> Callable[[Numbers], Any]:
    """Return what turns an array of NumPy into the kind that `example` is."""
    kind = _kind(example)
    if kind == "torch":
        return sys.modules["torch"].as_tensor
    if kind == "jax":
        return sys.modules["jax"].numpy.asarray
    return lambda array: array


def _kind(value: object) -> str:
    """Return "torch", "jax" or "numpy", without importing any of them."""
    torch, jax = sys.modules.get("torch"), sys.modules.get("jax")
    if torch is not None and isinstance(value, torch.Tensor):
        return "torch"
    if jax is not None and isinstance(value, jax.Array):
        return "jax"
    return "numpy"
