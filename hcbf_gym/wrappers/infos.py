"""Infos for the readers of a plant: copies, and NaN for values that no environment reports."""

from collections.abc import Mapping
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.arrays import Info, Mask


def copied(value: Any) -> Any:
    """Return a copy of an array, a tensor, or a container with copies of all arrays in it.

    Other values are returned as they are, and so is what its own code cannot copy.
    """
    try:
        return _copied(value)
    except Exception:  # a user's own object may raise anything when it is copied
        return value


def _copied(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.copy()
    if type(value) is dict:
        return {key: copied(entry) for key, entry in value.items()}
    if isinstance(value, dict):
        same_class = copy(value)
        same_class.update((key, copied(entry)) for key, entry in value.items())
        return same_class
    if isinstance(value, tuple):
        entries = map(copied, value)
        return type(value)(*entries) if hasattr(value, "_fields") else tuple(entries)
    if isinstance(value, list):
        return list(map(copied, value))
    return value.clone() if callable(getattr(value, "clone", None)) else value  # a tensor


def reported(infos: Info, reports: Mask | None = None) -> Info:
    """Return a vector environment's infos with NaN where an environment does not report an entry.

    Gymnasium fills in zeros or None there. Whole numbers become floats where one is missing.

    Args:
        infos: the infos, in which the mask `_key` (N,) marks the environments that report `key`.
        reports: (N,) the environments that report entries without a mask; None for all.
    """
    filled = dict(infos)
    for key, value in infos.items():
        mask = infos.get(f"_{key}", reports)
        if isinstance(value, Mapping):
            filled[key] = reported(dict(value), mask)
        elif isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and not mask.all():
            array = np.asarray(value)
            is_mask = key.startswith("_") and key[1:] in infos
            if array.shape[:1] == mask.shape and not is_mask:
                filled[key] = _with_nan(array, mask)
    return filled


def joined(infos: Info, before: Info, begins: Mask) -> Info:
    """Return the new infos of the environments that were reset, and the old infos of the others.

    Args:
        infos: the infos of a reset of some environments, as `reported` returns them.
        before: the infos before the reset.
        begins: (N,) the environments that were reset.
    """
    combined = dict(before) | infos
    for key, value in before.items():
        if isinstance(value, Mapping):
            combined[key] = joined(dict(infos.get(key, {})), dict(value), begins)
        elif isinstance(value, np.ndarray) and value.shape[:1] == begins.shape:
            fresh = infos.get(key)
            if not (isinstance(fresh, np.ndarray) and fresh.shape == value.shape):
                fresh = _with_nan(value, np.zeros_like(begins))
            is_fresh = begins.reshape(-1, *[1] * (value.ndim - 1))
            combined[key] = np.where(is_fresh, fresh, value)
    return combined


def _with_nan(array: NDArray[Any], mask: Mask) -> NDArray[Any]:
    """Return an array (N, …) with NaN where the mask (N,) is False."""
    if array.dtype.kind in "fc":
        filled = array.copy()
    else:
        filled = array.astype(np.float64 if array.dtype.kind in "iub" else object)
    example = array[np.argmax(mask)] if mask.any() else None
    for i in np.flatnonzero(~mask):
        filled[i] = _nan_like(example) if filled.dtype == object else np.nan
    return filled


def _nan_like(value: Any) -> Any:
    """Return NaN in the form of a value that another environment reports."""
    if isinstance(value, Mapping):
        return {key: _nan_like(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_nan_like(entry) for entry in value]
    return np.full(value.shape, np.nan) if isinstance(value, np.ndarray) else np.nan
