"""The records that the compiled cascade passes on: settings, rows, the cost of a stage, space."""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Integers, Records
from hcbf_gym.barriers.layout import LOWEST_RANK
from hcbf_gym.compilation import kernel

Point = tuple[float, float]

NOTHING, RELAXED, DRAWN = range(3)
"""What the rows that are not strict pay for: `plans.LOWER`."""

PIN, BOUND = 1, 2
"""What a level locks: `plans.LOCK`."""

ROW = np.dtype(
    (
        np.record,
        [
            ("index", np.int64),  # where the row stood before rows were sorted by stage
            ("ax", np.float64),  # gradient
            ("ay", np.float64),
            ("norm", np.float64),  # ‖a‖
            ("b", np.float64),  # bound, a·u ≥ b
            ("strict", np.bool_),  # whether the stage meets the row, instead of paying for it
            ("weight", np.float64),  # λ_δ(h); 1 for a strict row
            ("least", np.float64),  # δ_min; 0 for a strict row
            ("target", np.float64),  # a·û
            ("state", np.int64),  # working space of `soft`
        ],
    )
)
"""A row as the stages read it."""


class Settings(NamedTuple):
    """A program in the form that the kernels read: its plan, its prices and U.

    Attributes:
        lower: `NOTHING`, `RELAXED` or `DRAWN`.
        by_level: whether each priority is a stage; if not there are two, strict rows and others.
        lock: `PIN`, `BOUND` or 0.
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


class Own(NamedTuple):
    """What a state may have for itself: corners (V, 2) of U, and weights (1 + L,)."""

    vertices: Array
    weights: Array


@kernel(error_model="numpy", inline="always")
def own_of(settings: Settings, i: int) -> Own:
    """Return what state i of N has."""
    vertices, weights = settings.vertices, settings.weights
    return Own(
        vertices[i if vertices.shape[0] > 1 else 0], weights[i if weights.shape[0] > 1 else 0]
    )


class Line(NamedTuple):
    """The line ``n·u = d`` with a unit normal; a cut keeps the side ``n·u ≥ d``."""

    nx: float
    ny: float
    d: float


class Cost(NamedTuple):
    """``λ_u ‖u − u*‖² + Σ w_k max(m_k, b_k − a_k·u)²`` over the rows of one stage."""

    rows: Records
    lambda_u: float
    ux: float
    uy: float


FEASIBLE, TRIAL, CELL, COPY = range(4)
"""The inputs that the stages so far leave; a copy of them that may be thrown away; what
`soft_minimum` cuts down; what `minimise` cuts."""


class Workspace(NamedTuple):
    """What the kernels write to; made once for a whole batch.

    Attributes:
        radius: the largest norm of an input, which sets the scale of rounding.
        polygons: (4, 2 capacity, 2) the polygons `FEASIBLE`, `TRIAL`, `CELL` and `COPY`, each with
            as much room again behind its corners, which a cut writes to.
        rows: (m,) `ROW`, sorted by stage.
        start: (LOWEST_RANK + 4,) where each stage's rows start; as far as there are stages.
    """

    radius: float
    polygons: Array
    rows: Records
    start: Integers


@kernel(error_model="numpy")
def make_workspace(radius: float, corners: int, m: int) -> Workspace:
    """Return the working space for a U with so many corners, and m rows."""
    polygons = np.empty((4, 2 * (corners + m + 4), 2))
    rows = np.zeros(m, dtype=ROW)
    start = np.empty(LOWEST_RANK + 4, dtype=np.int64)  # guidance may come below the lowest
    return Workspace(radius, polygons, rows, start)


@kernel(error_model="numpy")
def row_line(row: np.record, bound: float) -> Line:
    """Return the line ``a·u = bound`` of a row whose gradient does not vanish."""
    return Line(row.ax / row.norm, row.ay / row.norm, bound / row.norm)
