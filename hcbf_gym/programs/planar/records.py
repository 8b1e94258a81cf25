"""A program of two inputs in numbers, as the core reads it."""

from typing import NamedTuple

from hcbf_gym.arrays import Array


class Settings(NamedTuple):
    """A program's plan, its prices and U; `program_records::Settings` of the core.

    Attributes:
        lower: its place in `plans.LOWER`.
        by_level: whether each priority is a stage; if not there are two, strict rows and others.
        lock: its place in `plans.LOCK`.
        ranks: whether rows of priority 1 come before the others.
        guided: whether guidance may add a row of the last rank, which costs the others nothing.
        radius: the largest norm of an input in U.
        lambda_u: λ_u.
        known_offset: whether δ_min comes from α₂(ψ) (``epsilon="known"``); 0 if not.
        vertices: (K, V, 2) the corners of U, counter-clockwise; K is 1, or N for N states with a U
            of their own.
        weights: (K, 1 + L) Δγ and γ₀ of the priorities from 2 on, the last one repeated; infinity
            is a strict level. K as above.
    """

    lower: int
    by_level: bool
    lock: int
    ranks: bool
    guided: bool
    radius: float
    lambda_u: float
    known_offset: bool
    vertices: Array
    weights: Array
