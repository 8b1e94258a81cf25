"""What the compiled core reads and writes: constants and plants, as its `plants.hpp` has them."""

from functools import cache
from typing import Any

import numpy as np

from hcbf_gym.arrays import Array, record_type

COMPARED, CHANGED = 1, 2
"""What came in unforeseen: barriers that are compared with those before; whatever it is, others, or
a state after none."""

CONSTANTS = record_type("plants.Constants")
"""What a filter never changes."""


@cache
def plant_dtype(n_u: int) -> np.dtype[np.void]:
    """Return what is known of one plant of so many inputs; zeros at a reset.

    Behind the struct are `input`, applied since the last sample, and `stop`, of U, which brings a
    plant of another model to rest.
    """
    return record_type("plants.Plant", input=n_u, stop=n_u)


PLANT = plant_dtype(2)
"""What is known of one plant of two inputs."""


def constants(fields: dict[str, Any]) -> tuple[Array, Array]:
    """Return the numbers of a `CONSTANTS`; and the corners of U, the program's weights behind them.

    Args:
        fields: of the constants, and (1, V, 2) `vertices` and (K, 1 + L) `weights`.
    """
    record = np.zeros(1, dtype=CONSTANTS)
    vertices, weights = fields.pop("vertices"), fields.pop("weights")
    for name, number in fields.items():
        record[name] = number
    record["corners"], record["weights"] = vertices.shape[1], weights.shape[1]
    return record.view(np.float64), np.concatenate([vertices.ravel(), weights.ravel()])
