"""Infos of one or N environments, as a plant's readers see them: NaN for what is missing."""

from collections.abc import Mapping
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.arrays import Info, Mask


def copied(value: Any) -> Any:
    """Return a value with copies of the arrays in it, and of what holds them; the rest as it is."""
    if isinstance(value, np.ndarray):
        return value.copy()
    if type(value) is dict:
        return {name: copied(one) for name, one in value.items()}
    if isinstance(value, dict):
        kept = copy(value)  # of the same kind
        kept.update((name, copied(one)) for name, one in value.items())
        return kept
    if isinstance(value, tuple):
        parts = map(copied, value)
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    if isinstance(value, list):
        return list(map(copied, value))
    return value.clone() if callable(getattr(value, "clone", None)) else value  # a tensor


def reported(infos: Info, reports: Mask | None = None) -> Info:
    """Return a vector's infos with NaN for what an environment does not report.

    Gymnasium fills in zeros or None there. Whole numbers become floats where one is missing.

    Args:
        infos: `_key` is (N,) which environments report `key`.
        reports: (N,) which environments report entries without such a mask; None for all.
    """
    found = dict(infos)
    for key, value in infos.items():
        mask = infos.get(f"_{key}", reports)
        if isinstance(value, Mapping):
            found[key] = reported(dict(value), mask)
        elif isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and not mask.all():
            known = np.asarray(value)
            if known.shape[:1] == mask.shape and not (key[:1] == "_" and key[1:] in infos):
                found[key] = _without(known, mask)
    return found


def joined(infos: Info, before: Info, begins: Mask) -> Info:
    """Return the infos of those who begin (N,) with those from before of the others.

    Args:
        infos: of a reset of some environments, as `reported` returns them.
        before: the infos before it.
        begins: (N,) which were reset.
    """
    found = dict(before) | infos
    for key, value in before.items():
        if isinstance(value, Mapping):
            found[key] = joined(dict(infos.get(key, {})), dict(value), begins)
        elif isinstance(value, np.ndarray) and value.shape[:1] == begins.shape:
            now = infos.get(key)
            if not (isinstance(now, np.ndarray) and now.shape == value.shape):
                now = _without(value, np.zeros_like(begins))
            others = begins.reshape(-1, *[1] * (value.ndim - 1))
            found[key] = np.where(others, now, value)
    return found


def _without(known: NDArray[Any], mask: Mask) -> NDArray[Any]:
    """Return an array (N, …) with NaN where the mask (N,) is False."""
    if known.dtype.kind in "fc":
        left = known.copy()
    else:
        left = known.astype(np.float64 if known.dtype.kind in "iub" else object)
    first = known[np.argmax(mask)] if mask.any() else None
    for i in np.flatnonzero(~mask):
        left[i] = _nothing_like(first) if left.dtype == object else np.nan
    return left


def _nothing_like(value: Any) -> Any:
    """Return NaN in the form of what another environment reports."""
    if isinstance(value, Mapping):
        return {name: _nothing_like(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_nothing_like(one) for one in value]
    return np.full(value.shape, np.nan) if isinstance(value, np.ndarray) else np.nan
