"""Checks of the arguments that environments get in `reset` and `step`."""

from collections.abc import Sequence

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.errors import InvalidInputError, as_array, count, floats


def check_action(action: object, shape: tuple[int, ...]) -> Array:
    """Return the action as float64.

    Raises:
        InvalidInputError: if it is no array of 32 or 64 bits of this shape with finite entries.
    """
    array = floats("action", action, shape).astype(np.float64, copy=False)
    if not _core.are_finite(array):
        raise InvalidInputError(f"action: got {array.tolist()}, expected finite accelerations")
    return array


def check_seed(seed: object) -> int | None:
    """Return the seed of a reset, which is None or an integer from 0 on."""
    return None if seed is None else count("seed", seed, minimum=0, maximum=np.inf)


def check_seeds(seed: object, n: int) -> list[int | None]:
    """Return N seeds, from a sequence of them or from one, from which the others count up.

    Raises:
        InvalidInputError: if a sequence does not have N entries, or an entry is no seed.
    """
    if isinstance(seed, Sequence) and not isinstance(seed, str | bytes):
        if len(seed) != n:
            raise InvalidInputError(f"seed: got {len(seed)} seeds, expected {n}")
        return [check_seed(entry) for entry in seed]
    first_seed = check_seed(seed)
    return [None if first_seed is None else first_seed + i for i in range(n)]


def check_mask(mask: object, n: int) -> Mask:
    """Return the mask (N,) of the environments that a reset begins anew.

    Raises:
        InvalidInputError: if it is no array of N truth values with a True.
    """
    array = as_array("reset_mask", mask)
    if array.shape != (n,) or array.dtype != np.bool_ or not array.any():
        raise InvalidInputError(
            f"reset_mask: got shape {array.shape} of {array.dtype}, "
            f"expected ({n},) of bool with a True"
        )
    return array


def check_started(started: bool) -> None:
    """Refuse a step before the first reset."""
    if not started:
        raise InvalidInputError("step: the episode has not begun, expected env.reset(seed=…) first")
