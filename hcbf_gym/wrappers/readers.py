"""A plant's readers at every step: one that raises is one that knows nothing."""

import math
from collections.abc import Mapping
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.arrays import Info, Mask
from hcbf_gym.errors import SafetyWarning, warn_caller
from hcbf_gym.models.plant import Coverage, Estimate, Plant

Seen = tuple[Any, Estimate, tuple[Any, Any] | None]
"""Barriers, estimate, and goal and extent where guidance leads; of a reader that raised None, of an
extent NaN."""


class Readers:
    """Reads a plant; what raises is warned of once, and nothing is known.

    Args:
        plant: whose readers they are.
        guides: whether guidance leads it, so that goal and extent are read.
    """

    def __init__(self, plant: Plant, guides: bool):
        self._plant, self._guides = plant, guides
        self._said: set[str] = set()

    def __call__(self, env: object, observation: object, info: Info, first: bool = False) -> Seen:
        """Return what is known of the plant now.

        Args:
            env: unwrapped.
            observation: the latest.
            info: the latest.
            first: whether nothing has been filtered yet: what a reader raises is raised.
        """
        plant, seen = self._plant, (env, observation, info)
        barriers = self._read("barriers", plant.barriers, seen, first)
        state = self._read("state", plant.state, seen, first)
        world = None
        if self._guides:
            goal = self._read("goal", plant.goal, seen, first)
            world = goal, self._read("extent", plant.extent, seen, first, unknown=math.nan)
        return barriers, state if isinstance(state, Estimate) else Estimate(state), world

    def covered(self, env: object, observation: object, info: Info, first: bool) -> Any:
        """Return whether the promise was tested for the episodes that begin."""
        said = self._read("covered", self._plant.covered, (env, observation, info), first)
        return Coverage.OUTSIDE if said is None else said

    def _read(
        self,
        name: str,
        source: Any,
        seen: tuple[Any, Any, Info],
        first: bool,
        unknown: float | None = None,
    ) -> Any:
        """Return a field of the plant as it is now, `unknown` where its reader raises."""
        if not callable(source):
            return source
        try:
            return source(*seen)
        except Exception as error:  # whatever a user's sensor raises, the robot has to stop
            if first:
                error.add_note(f"raised by the plant's reader of the {name}, at the first reset")
                raise
            self._say(name, error)
            return unknown

    def _say(self, name: str, error: Exception) -> None:
        """Warn of a reader that raised, once of each."""
        if name not in self._said:
            self._said.add(name)
            warn_caller(
                f"safety filter: the reader of the {name} raised {error!r}; "
                + ("covered is 0" if name == "covered" else "the filter brakes until that ends"),
                SafetyWarning,
            )


def copied(value: Any) -> Any:
    """Return a value with copies of the arrays in it, and of what holds them; the rest as it is."""
    if isinstance(value, np.ndarray):
        return value.copy()
    if type(value) is dict:
        return {name: copied(one) for name, one in value.items()}
    if isinstance(value, dict):
        kept = copy(value)  # of its own kind
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
        infos: beside an entry `key` stands `_key`, (N,) which environments report it.
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
        before: the infos before it, likewise.
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
