"""What rows of any model are made of and where they have their numbers.

They are computed by core/include/hcbf/general_rows.hpp.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers.barrier import Jet

MARGIN, RATE, QUICKENING, LEANING, REACH, FAST, DIP, CONDITIONING, PLACED, WIDTH = range(4, 14)
"""Where a row that is made for any model has its numbers, behind those of `rows`: those of
`margins.of_models`, what it reserves besides, how well it is conditioned, and 1 where its barrier
reads the position. a (n_u,) follows."""

ELSEWHERE = -1
"""The kind of a barrier whose row is made elsewhere: a function."""


class Scene(NamedTuple):
    """The barriers of N scenes.

    Attributes:
        kind: (N, m) as `layout` has it, `NONE` behind a shorter scene; or `ELSEWHERE`.
        parameters: (N, m, WIDTH) the blocks of built-in ones.
        degree: (N, m) the derivative of h that an input enters first, 1 or 2.
    """

    kind: Integers
    parameters: Array
    degree: Integers


def jet_width(n: int) -> int:
    """Return how many numbers a jet has."""
    return 3 + 2 * n + n * n


def pack(jet: Jet, out: Array) -> None:
    """Write a jet of n states into an array (jet_width,), as general_rows.hpp reads it."""
    n = np.size(jet.gradient)
    out[0], out[1], out[2] = jet.h, jet.rate, jet.rate_rate
    out[3 : 3 + n], out[3 + n : 3 + 2 * n] = jet.gradient, jet.gradient_rate
    out[3 + 2 * n :] = np.ravel(jet.hessian)
