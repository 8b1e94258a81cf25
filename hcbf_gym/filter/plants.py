"""What the compiled core reads and writes: constants and plants, as its `plants.hpp` has them."""

from functools import cache

import numpy as np

from hcbf_gym.arrays import Array, record_type
from hcbf_gym.programs.planar import Settings

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


def constants(settings: Settings, others: dict[str, object]) -> tuple[Array, Array]:
    """Return the numbers of a `CONSTANTS`; and the corners of U, the program's weights behind them.

    Args:
        settings: of the program.
        others: the rest of the constants, by their names.
    """
    record = np.zeros(1, dtype=CONSTANTS)
    own = settings._asdict()
    vertices, weights = own.pop("vertices"), own.pop("weights")
    sizes = {"corners": vertices.shape[1], "weights": weights.shape[1]}
    for name, number in (own | sizes | others).items():
        record[name] = number
    return record.view(np.float64), np.concatenate([vertices.ravel(), weights.ravel()])


def solved_outside(radius: float) -> Settings:
    """Return the settings of a program that a solver outside answers.

    Args:
        radius: the largest norm of an input.
    """
    nothing = np.zeros((1, 1, 2)), np.zeros((1, 1))
    return Settings(0, False, 0, True, False, radius, 0.0, False, *nothing)
