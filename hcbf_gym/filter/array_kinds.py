"""Arrays of NumPy, torch and JAX: read without a copy where they lie on the CPU, and given back."""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.errors import as_array, library_of

Numbers = NDArray[Any]


def numpy_of(name: str, value: Any) -> Numbers:
    """Return `value` as `as_array` does; what a mask hides is NaN.

    Args:
        name: the argument's name, for the message.
        value: an array of NumPy, a tensor of torch, an array of JAX, or lists of numbers.

    Raises:
        InvalidInputError: on what is no array.
    """
    if np.ma.is_masked(value) and value.dtype.kind in "fiu":
        return np.ma.filled(value.astype(np.float64), np.nan)
    return as_array(name, value)


def like(example: object) -> Callable[[Numbers], Any]:
    """Return what turns an array of NumPy into the kind that `example` is."""
    kind = library_of(example)
    if kind == "torch":
        return sys.modules["torch"].as_tensor
    if kind == "jax":
        return sys.modules["jax"].numpy.asarray
    return lambda array: array
