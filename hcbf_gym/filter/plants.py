"""Records that the compiled core shares: constants and plants, as its `plants.hpp` has them."""

from functools import cache
from typing import Any

import numpy as np

from hcbf_gym.arrays import Array, record_type

COMPARED, CHANGED = 1, 2
"""The values of a plant's `change`: its barriers changed and are compared with those before; or
they changed without a comparison, or its state comes after an invalid one."""

CONSTANTS = record_type("plants.Constants")
"""The type of the constants of a filter."""


@cache
def plant_dtype(n_u: int) -> np.dtype[np.void]:
    """Return the type of the record of one plant with n_u inputs; it is 0 at a reset.

    Behind the struct are `input`, which was applied since the last sample, and `stop`, the input of
    U that brings a plant of another model to rest.
    """
    return record_type("plants.Plant", input=n_u, stop=n_u)


def constants(fields: dict[str, Any]) -> tuple[Array, Array]:
    """Return a filter's constants and its program as numbers, for the core.

    Args:
        fields: of `CONSTANTS`; and `vertices` (1, V, 2) of U and `weights` (K, 1 + L).

    Returns:
        The numbers of a `CONSTANTS` record; the numbers of the vertices, then of the weights.
    """
    record = np.zeros(1, dtype=CONSTANTS)
    vertices, weights = fields.pop("vertices"), fields.pop("weights")
    for name, number in fields.items():
        record[name] = number
    record["corners"], record["weights"] = vertices.shape[1], weights.shape[1]
    return record.view(np.float64), np.concatenate([vertices.ravel(), weights.ravel()])
